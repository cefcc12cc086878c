"""Compiled loops over the pixels and cells of patches: votes of gradients for directions, and their normalisation."""

from __future__ import annotations

import math

from numba import njit


# The signatures compile when the module is imported (and are kept on disk), not when the first target is selected.
@njit("void(f4[:,:,::1],f4[:,:,::1],f4[:,:,:,::1],i8,i8,f8)", cache=True, nogil=True)
def vote(length, place, cells, directions, cell_px, weight):  # type: ignore[no-untyped-def]
    """Add each gradient to the two directions next to it, in shares.

    Args:
        length: (n, H, W) float32.
        place: of its direction among D, (n, H, W) float32, 0 to D.
        cells: (n, H / cell_px, W / cell_px, at least D) float32, whose first D entries are added to.
        directions: D.
        cell_px: side of a cell, px.
        weight: factor on every vote.
    """
    for n in range(length.shape[0]):
        for row in range(cells.shape[1]):
            for y in range(row * cell_px, (row + 1) * cell_px):
                for column in range(cells.shape[2]):
                    for x in range(column * cell_px, (column + 1) * cell_px):
                        low = int(place[n, y, x])
                        share = place[n, y, x] - low
                        votes = length[n, y, x] * weight
                        low = low if low < directions else 0
                        high = low + 1 if low + 1 < directions else 0
                        cells[n, row, column, low] += votes * (1.0 - share)
                        cells[n, row, column, high] += votes * share


@njit("void(f4[:,:,:,::1],f4[:,:,::1],i8,f8,f8)", cache=True, nogil=True, error_model="numpy")
def normalise(cells, energy, unsigned, least_energy, largest):  # type: ignore[no-untyped-def]
    """Add opposite directions to entries of their own, and divide all by the root mean energy of the neighbourhood.

    Args:
        cells: (n, rows, columns, 3 U) float32, changed: 2 U directions are there, U are written.
        energy: (n, rows, columns) float32, written: of each cell.
        unsigned: U.
        least_energy: added to the root of the mean energy of 3 x 3 cells; beyond the edge it repeats.
        largest: bound of an entry.
    """
    signed, rows, columns = 2 * unsigned, cells.shape[1], cells.shape[2]
    for n in range(cells.shape[0]):
        for i in range(rows):
            for j in range(columns):
                total = 0.0
                for d in range(unsigned):
                    both = cells[n, i, j, d] + cells[n, i, j, unsigned + d]
                    cells[n, i, j, signed + d] = both
                    total += both * both
                energy[n, i, j] = total
        for i in range(rows):
            up, down = max(i - 1, 0), min(i + 1, rows - 1)
            for j in range(columns):
                left, right = max(j - 1, 0), min(j + 1, columns - 1)
                total = energy[n, up, left] + energy[n, up, j] + energy[n, up, right]
                total += energy[n, i, left] + energy[n, i, j] + energy[n, i, right]
                total += energy[n, down, left] + energy[n, down, j] + energy[n, down, right]
                scale = 1.0 / (math.sqrt(total / 9) + least_energy)
                for d in range(cells.shape[3]):
                    cells[n, i, j, d] = min(cells[n, i, j, d] * scale, largest)
