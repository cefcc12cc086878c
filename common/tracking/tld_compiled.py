"""Compiled loops over all windows of a picture: variance, then ferns (Kalal et al. 2012, section 5.3), and overlaps."""

from __future__ import annotations

from numba import njit


# The signature compiles when the module is imported (and is kept on disk), not when the first target is selected.
# Indices have no sign: whether one counts from the end would be asked of each, which takes half as long again.
@njit(
    "void(u1[::1],f8[:,::1],f8[:,::1],u4[:,::1],u4[::1],u4[:,:,:,::1],f4[:,::1],u8,f8,f8,i4[:,::1],f4[::1])",
    cache=True,
    nogil=True,
)
def scan(  # type: ignore[no-untyped-def]
    pixels, sums, squares, windows, kinds, pairs, posteriors, stride,
    least_variance, least_confidence, codes, confidence,
):  # fmt: skip
    """Codes and mean posterior of each window that is not plainer than the target; -1 for the others.

    Args:
        pixels: (H * W,) uint8, the blurred picture.
        sums: (H + 1, W + 1) float64, integral of the picture.
        squares: (H + 1, W + 1) float64, integral of its squares.
        windows: (n, 4) uint32, x, y, width, height, px.
        kinds: (n,) uint32, the size of each window.
        pairs: (sizes, ferns, bits, 2) uint32, distance of the two pixels of each comparison from the window's corner.
        posteriors: (ferns, 2^bits) float32.
        stride: W.
        least_variance: of a window.
        least_confidence: a window whose mean posterior cannot reach it any more is given up.
        codes: (n, ferns) int32, written where there is a confidence.
        confidence: (n,) float32, written; -1 where a window was given up.
    """
    ferns, bits = pairs.shape[1], pairs.shape[2]
    for i in range(windows.shape[0]):
        x, y, w, h = windows[i, 0], windows[i, 1], windows[i, 2], windows[i, 3]
        area = float(w * h)
        total = sums[y + h, x + w] - sums[y, x + w] - sums[y + h, x] + sums[y, x]
        square = squares[y + h, x + w] - squares[y, x + w] - squares[y + h, x] + squares[y, x]
        confidence[i] = -1.0
        if square * area - total * total < least_variance * area * area:
            continue
        corner, kind, total = y * stride + x, kinds[i], 0.0
        for f in range(ferns):
            code = 0
            for b in range(bits):
                brighter = pixels[corner + pairs[kind, f, b, 0]] > pixels[corner + pairs[kind, f, b, 1]]
                code = 2 * code + int(brighter)
            codes[i, f] = code
            total += posteriors[f, code]
            if total + (ferns - f - 1) < least_confidence * ferns:
                break
        else:
            confidence[i] = total / ferns


@njit("void(u4[:,::1],f8,f8,f8,f8,f4[::1])", cache=True, nogil=True, error_model="numpy")
def overlaps(windows, x, y, width, height, out):  # type: ignore[no-untyped-def]
    """Jaccard index of each window (n, 4) uint32 with a box, px, written to (n,) float32."""
    for i in range(windows.shape[0]):
        left, top = float(windows[i, 0]), float(windows[i, 1])
        across, down = float(windows[i, 2]), float(windows[i, 3])
        out[i] = 0.0
        if left < x + width and x < left + across and top < y + height and y < top + down:
            shared = (min(left + across, x + width) - max(left, x)) * (min(top + down, y + height) - max(top, y))
            out[i] = shared / (across * down + width * height - shared)
