"""Compiled loops of floor and clusters: sums over a plane's points, and density clustering on a grid.

The clustering is DBSCAN (Ester et al. 1996). Points seen by a camera fill a plane, so they are sorted into square
columns along z rather than into a tree; and a point that has its cluster is taken out of its column, so that a dense
cloud costs little more than a thin one.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit


@njit("Tuple((i8,f8[::1],f8[:,::1]))(f4[:,::1],f8[::1],f8,f8)", cache=True, nogil=True, fastmath={"reassoc", "nsz"})
def plane_moments(points, normal, offset, band):  # type: ignore[no-untyped-def]
    """Count, sum (3,) and sum of outer products (3, 3) of the points (N, 3) within `band` of a plane.

    Args:
        points: (N, 3), m.
        normal: (3,) unit normal.
        offset: a point's signed distance is normal · p + offset, m.
        band: m.
    """
    a, b, c = normal[0], normal[1], normal[2]
    count = 0.0
    sx = sy = sz = xx = xy = xz = yy = yz = zz = 0.0
    for i in range(points.shape[0]):
        x, y, z = np.float64(points[i, 0]), np.float64(points[i, 1]), np.float64(points[i, 2])
        # A weight instead of a branch: the sums then run in vector registers.
        w = 1.0 if abs(a * x + b * y + c * z + offset) < band else 0.0
        count += w
        wx, wy, wz = w * x, w * y, w * z
        sx += wx
        sy += wy
        sz += wz
        xx += wx * x
        xy += wx * y
        xz += wx * z
        yy += wy * y
        yz += wy * z
        zz += wz * z
    first = np.array([sx, sy, sz])
    second = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return int(count), first, second


@njit("Tuple((i8,f8[::1]))(f4[:,::1],i8[:,::1],f8[::1],f8,f8)", cache=True, nogil=True, fastmath={"reassoc", "nsz"})
def best_plane(points, triples, up, least_cosine, band):  # type: ignore[no-untyped-def]
    """Most points within `band` of one of the planes through triples, and that plane (4,): normal towards `up`, offset.

    Args:
        points: (N, 3), m.
        triples: (K, 3) rows of them.
        up: (3,) unit vector.
        least_cosine: planes whose normal leans more from `up` than this says are left out.
        band: m.
    """
    # One coordinate after the other in memory: the loop over the votes then runs in vector registers.
    xs, ys, zs = points[:, 0].copy(), points[:, 1].copy(), points[:, 2].copy()
    reach = np.float32(band)
    most, best = 0, np.zeros(4)
    for t in range(triples.shape[0]):
        p, q, r = points[triples[t, 0]], points[triples[t, 1]], points[triples[t, 2]]
        ux, uy, uz = np.float64(q[0]) - p[0], np.float64(q[1]) - p[1], np.float64(q[2]) - p[2]
        vx, vy, vz = np.float64(r[0]) - p[0], np.float64(r[1]) - p[1], np.float64(r[2]) - p[2]
        nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        length = math.sqrt(nx * nx + ny * ny + nz * nz)
        cosine = nx * up[0] + ny * up[1] + nz * up[2]
        # Walls, and three points in a line.
        if length < 1e-9 or abs(cosine) < least_cosine * length:
            continue
        scale = 1.0 / length if cosine > 0 else -1.0 / length
        nx, ny, nz = nx * scale, ny * scale, nz * scale
        offset = -(nx * p[0] + ny * p[1] + nz * p[2])
        a, b, c, d = np.float32(nx), np.float32(ny), np.float32(nz), np.float32(offset)
        votes = np.int32(0)
        for i in range(xs.shape[0]):
            votes += np.int32(abs(a * xs[i] + b * ys[i] + c * zs[i] + d) < reach)
        if votes > most:
            most = votes
            best[0], best[1], best[2], best[3] = nx, ny, nz, offset
    return most, best


@njit("f4[::1](f4[:,::1],f8[::1],f8)", cache=True, nogil=True)
def heights_above(points, normal, offset):  # type: ignore[no-untyped-def]
    """Signed distances (N,) of points (N, 3) from a plane, m."""
    a, b, c, d = np.float32(normal[0]), np.float32(normal[1]), np.float32(normal[2]), np.float32(offset)
    heights = np.empty(points.shape[0], np.float32)
    for i in range(points.shape[0]):
        heights[i] = a * points[i, 0] + b * points[i, 1] + c * points[i, 2] + d
    return heights


@njit("f4(f4[:,::1],i8,i8)", cache=True, nogil=True, inline="always")
def _squared(points, i, j):  # type: ignore[no-untyped-def]
    dx, dy, dz = points[i, 0] - points[j, 0], points[i, 1] - points[j, 1], points[i, 2] - points[j, 2]
    return dx * dx + dy * dy + dz * dz


@njit("Tuple((i4[::1],i4[::1],i4[::1],i8))(f4[:,::1],f8)", cache=True, nogil=True)
def _columns(points, side):  # type: ignore[no-untyped-def]
    """Points sorted into square columns along z: cell of each point (N,), order (N,), first of each cell (C + 1,), and
    cells of one row. A rim of empty cells all round spares the loops the borders."""
    n = points.shape[0]
    left, top, right, bottom = points[0, 0], points[0, 1], points[0, 0], points[0, 1]
    for i in range(n):
        left, right = min(left, points[i, 0]), max(right, points[i, 0])
        top, bottom = min(top, points[i, 1]), max(bottom, points[i, 1])
    # A stray point far away must not ask for more cells than there is memory.
    while (np.float64(right - left) / side + 3.0) * (np.float64(bottom - top) / side + 3.0) > 4e6:
        side *= 2.0
    row = int((right - left) / side) + 3
    cell_of = np.empty(n, np.int32)
    starts = np.zeros(row * (int((bottom - top) / side) + 3) + 1, np.int32)
    for i in range(n):
        cell_of[i] = (int((points[i, 1] - top) / side) + 1) * row + int((points[i, 0] - left) / side) + 1
        starts[cell_of[i] + 1] += 1
    for c in range(1, starts.shape[0]):
        starts[c] += starts[c - 1]
    fill = starts.copy()
    order = np.empty(n, np.int32)
    for i in range(n):
        order[fill[cell_of[i]]] = i
        fill[cell_of[i]] += 1
    return cell_of, order, starts, row


@njit("b1[::1](f4[:,::1],i4[::1],i4[::1],i4[::1],i8,f4,i8)", cache=True, nogil=True)
def _cores(points, cell_of, order, starts, row, squared, least):  # type: ignore[no-untyped-def]
    core = np.zeros(points.shape[0], np.bool_)
    # The point's own column first: in a dense cloud that settles it.
    steps = np.array([0, -1, 1, -row, row, -row - 1, -row + 1, row - 1, row + 1])
    for i in range(points.shape[0]):
        count = 0
        for step in steps:
            cell = cell_of[i] + step
            for k in range(starts[cell], starts[cell + 1]):
                if _squared(points, i, order[k]) <= squared:
                    count += 1
                    if count >= least:
                        break
            if count >= least:
                core[i] = True
                break
    return core


@njit("i4[::1](f4[:,::1],f8,i8)", cache=True, nogil=True)
def dbscan(points, radius, least):  # type: ignore[no-untyped-def]
    """Cluster number of each point, from 0 in the order of the points, or -1 for noise.

    Args:
        points: (N, 3), m.
        radius: points this close are neighbours, m.
        least: points within the radius, itself included, that make a point a core point.
    """
    labels = np.full(points.shape[0], -1, np.int32)
    if points.shape[0] == 0:
        return labels
    squared = np.float32(radius * radius)
    cell_of, order, starts, row = _columns(points, radius)
    core = _cores(points, cell_of, order, starts, row, squared, least)
    ends = starts[1:].copy()
    stack = np.empty(points.shape[0], np.int32)
    found = np.int32(-1)
    for seed in range(points.shape[0]):
        if labels[seed] >= 0 or not core[seed]:
            continue
        found += np.int32(1)
        stack[0], depth = seed, 1
        while depth > 0:
            depth -= 1
            i = stack[depth]
            for up in range(-row, row + 1, row):
                for cell in range(cell_of[i] + up - 1, cell_of[i] + up + 2):
                    k = starts[cell]
                    while k < ends[cell]:
                        j = order[k]
                        if _squared(points, i, j) > squared:
                            k += 1
                            continue
                        # Found once is enough: it leaves its column, so that nobody looks at it again.
                        ends[cell] -= 1
                        order[k] = order[ends[cell]]
                        labels[j] = found
                        if core[j]:
                            stack[depth] = j
                            depth += 1
    return labels
