"""Filters over occlusion: means of neighbours, weighted by distance and by likeness of depth.

NaN in values or depths takes no part; a pixel where they are NaN becomes NaN. Rows are padded by
the caller, so that neighbours need no check of bounds: `pad` rows and columns of NaN on each side.
"""

import numpy as np

from adret._kernels.jit import index, inline, kernel, parallel_kernel, prange

ZERO = np.float32(0.0)
ONE = np.float32(1.0)
PER_1024 = np.float32(1.0 / 1024.0)


@inline
def bell(q):
    """exp(-q) of q >= 0 to within 3e-4, as a loop over it vectorises: (1 - q/1024)^1024."""
    e = ONE - q * PER_1024
    e = e if e > ZERO else ZERO
    for _ in range(10):
        e = e * e
    return e


@kernel
def add_tap(values, depths, at, sharp, place, top, bottom):
    """Add a neighbour to each pixel of a row: those within 1/sqrt(sharp) in depth, all alike."""
    for x in range(len(at)):
        v = values[x]
        d = (depths[x] - at[x]) * sharp
        w = place if d * d < ONE else ZERO
        w = w if v == v else ZERO
        top[x] += w * (v if v == v else ZERO)
        bottom[x] += w


@kernel
def add_soft_tap(values, depths, at, sharp, place, top, bottom):
    """Add a neighbour to each pixel of a row, by the Gaussian of the difference in depth."""
    for x in range(len(at)):
        v = values[x]
        d = (depths[x] - at[x]) * sharp
        q = d * d
        w = place * bell(q)
        w = w if q == q and v == v else ZERO
        top[x] += w * (v if v == v else ZERO)
        bottom[x] += w


@kernel
def add_plain_tap(values, place, top, bottom):
    """Add a neighbour to each pixel of a row whatever its depth."""
    for x in range(len(top)):
        v = values[x]
        w = place if v == v else ZERO
        top[x] += w * (v if v == v else ZERO)
        bottom[x] += w


@kernel
def divide(values, top, bottom, out):
    """Quotients; NaN where the value itself is NaN, the value where nothing was added."""
    for x in range(len(out)):
        v = values[x]
        mean = top[x] / bottom[x] if bottom[x] > ZERO else v
        out[x] = mean if v == v else v


@parallel_kernel
def filtered(values, depth, pad, row_steps, column_steps, places, sharp, kind, out):
    """Weighted mean over the neighbours at (row_steps, column_steps) with weights `places`.

    `values` and `depth` are padded, `out` is not. `kind` 0 goes without depth, 1 is the threshold,
    2 the Gaussian.
    """
    for row in prange(out.shape[0]):
        columns = out.shape[1]
        top = np.zeros(columns, np.float32)
        bottom = np.zeros(columns, np.float32)
        here = index(pad)
        at = depth[row + pad, here : here + columns]
        for k in range(len(places)):
            left = index(pad + column_steps[k])
            v = values[row + pad + row_steps[k], left : left + columns]
            d = depth[row + pad + row_steps[k], left : left + columns]
            if kind == 0:
                add_plain_tap(v, places[k], top, bottom)
            elif kind == 1:
                add_tap(v, d, at, sharp, places[k], top, bottom)
            else:
                add_soft_tap(v, d, at, sharp, places[k], top, bottom)
        divide(values[row + pad, here : here + columns], top, bottom, out[row])


@parallel_kernel
def filtered_at(rows, columns, values, depth, samples, radius, places, sharp, out):
    """Non-separable filter at single pixels, once for each of their samples of depth, averaged.

    `samples` (samples, pixels) are the depths about which the filter is centred; NaN ones take no
    part. Values and depth are unpadded, `places` (2 radius + 1)² weights.
    """
    side = 2 * radius + 1
    for p in prange(len(rows)):
        total = 0.0
        count = 0
        for s in range(samples.shape[0]):
            at = samples[s, p]
            if at == at:
                top = ZERO
                bottom = ZERO
                for i in range(side):
                    row = rows[p] + i - radius
                    for j in range(side):
                        column = columns[p] + j - radius
                        if (
                            row >= 0
                            and column >= 0
                            and row < values.shape[0]
                            and column < values.shape[1]
                        ):
                            v = values[row, column]
                            d = (depth[row, column] - at) * sharp
                            q = d * d
                            if q == q and v == v:
                                w = places[i, j] * bell(q)
                                top += w * v
                                bottom += w
                if bottom > ZERO:
                    total += top / bottom
                    count += 1
        if count > 0:
            out[rows[p], columns[p]] = total / count


@parallel_kernel
def upsampled(
    low, low_depth, depth, ratio_rows, ratio_columns, shift_rows, shift_columns, sharp, reach, out
):
    """Joint bilateral upsampling of `low` to the pixels of `depth`.

    The pixel in row i lies in row i ratio_rows + shift_rows of `low`; so do columns.
    A pixel's value is the mean of the low pixels round it, weighted by a tent over their distance
    in low pixels (it is 0 at `reach`) and by the Gaussian of the difference in depth. Where all
    of them are far off in depth, the nearest in depth stands in.
    """
    for row in prange(out.shape[0]):
        place_row = row * ratio_rows + shift_rows
        first_row = np.int64(np.floor(place_row)) - (reach - 1)
        for column in range(out.shape[1]):
            place = column * ratio_columns + shift_columns
            first = np.int64(np.floor(place)) - (reach - 1)
            at = depth[row, column]
            top = ZERO
            bottom = ZERO
            nearest = np.float32(np.nan)
            least = np.float32(np.inf)
            for i in range(max(first_row, 0), min(first_row + 2 * reach, low.shape[0])):
                down = ONE - np.float32(abs(i - place_row)) / np.float32(reach)
                for j in range(max(first, 0), min(first + 2 * reach, low.shape[1])):
                    v = low[i, j]
                    d = (low_depth[i, j] - at) * sharp
                    q = d * d
                    if q == q and v == v:
                        across = ONE - np.float32(abs(j - place)) / np.float32(reach)
                        w = max(down, ZERO) * max(across, ZERO) * bell(q)
                        top += w * v
                        bottom += w
                        if q < least:
                            least = q
                            nearest = v
            out[row, column] = top / bottom if bottom > np.float32(1e-6) else nearest
