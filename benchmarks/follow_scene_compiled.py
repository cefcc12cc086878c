"""Compiled loops over the pixels of the hall's picture: ray casting, light and noise."""

from __future__ import annotations

import numpy as np
from numba import njit


# The signatures compile when the module is imported (and are kept on disk), not with the first picture.
@njit(
    "void(u1[:,:,::1],f8[:,:],f8[:],f8[:],f8,UniTuple(f8,2),u1[:,:,::1])", cache=True, nogil=True, error_model="numpy"
)
def cast(atlas, turn, eye, half, focal, centre, out):  # type: ignore[no-untyped-def]
    """Fill a picture (H, W, 3) with walls, floor and ceiling: the nearest plane that each ray meets."""
    walls, floor, wide = 256, 512, 1024  # rows of a wall, side of the floor, columns of a wall: `follow_scene`, px
    for v in range(out.shape[0]):
        y = (v - centre[1]) / focal
        for u in range(out.shape[1]):
            x = (u - centre[0]) / focal
            north = x * turn[0, 0] + y * turn[1, 0] + turn[2, 0]
            east = x * turn[0, 1] + y * turn[1, 1] + turn[2, 1]
            down = x * turn[0, 2] + y * turn[1, 2] + turn[2, 2]
            to_north = ((half[0] if north > 0 else -half[0]) - eye[0]) / north
            to_east = ((half[1] if east > 0 else -half[1]) - eye[1]) / east
            to_level = ((0.0 if down > 0 else -half[2]) - eye[2]) / down
            if to_level < min(to_north, to_east):
                row = (eye[0] + to_level * north) * 64.0 % (floor - 1) + walls
                column = (eye[1] + to_level * east) * 64.0 % (floor - 1) + (0.0 if down > 0 else floor)
            else:
                if to_north < to_east:
                    reach = to_north
                    along = eye[1] + reach * east + (0.0 if north > 0 else 5.3)
                else:
                    reach = to_east
                    along = eye[0] + reach * north + (2.9 if east > 0 else 8.1)
                row = walls - 1 - (-(eye[2] + reach * down) * 64.0) % (walls - 1)
                column = along * 64.0 % (wide - 1)
            i, j = int(row), int(column)
            a, b = row - i, column - j
            k, m = min(i + 1, atlas.shape[0] - 1), min(j + 1, atlas.shape[1] - 1)
            for c in range(3):
                upper = atlas[i, j, c] * (1.0 - b) + atlas[i, m, c] * b
                lower = atlas[k, j, c] * (1.0 - b) + atlas[k, m, c] * b
                out[v, u, c] = upper * (1.0 - a) + lower * a


@njit("void(u1[:,:,::1],f4[::1],i1[:,:,:])", cache=True, nogil=True)
def expose(picture, gain, noise):  # type: ignore[no-untyped-def]
    """Light and noise of the sensor, in place, on a picture (H, W, 3)."""
    for v in range(picture.shape[0]):
        for u in range(picture.shape[1]):
            for c in range(3):
                lit = picture[v, u, c] * gain[c] + np.float32(noise[v, u, c])
                picture[v, u, c] = np.uint8(min(max(lit, np.float32(0.0)), np.float32(255.0)))
