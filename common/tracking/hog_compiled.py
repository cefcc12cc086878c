"""Compiled loop over the pixels of patches: votes of gradients for the directions of their cells."""

from __future__ import annotations

from numba import njit


# The signature compiles when the module is imported (and is kept on disk), not when the first target is selected.
@njit("void(f4[:,:,::1],f4[:,:,::1],f4[:,:,:,::1],i8,f8)", cache=True, nogil=True)
def vote(length, place, cells, cell_px, weight):  # type: ignore[no-untyped-def]
    """Add each gradient to the two directions next to it, in shares.

    Args:
        length: (n, H, W) float32.
        place: of its direction among D, (n, H, W) float32, 0 to D.
        cells: (n, H / cell_px, W / cell_px, D) float32, added to.
        cell_px: side of a cell, px.
        weight: factor on every vote.
    """
    directions = cells.shape[3]
    for n in range(length.shape[0]):
        for y in range(cells.shape[1] * cell_px):
            for x in range(cells.shape[2] * cell_px):
                low = int(place[n, y, x])
                share = place[n, y, x] - low
                votes = length[n, y, x] * weight
                cells[n, y // cell_px, x // cell_px, low % directions] += votes * (1.0 - share)
                cells[n, y // cell_px, x // cell_px, (low + 1) % directions] += votes * share
