"""What `benchmarks/visibility.py` measures the convex-hull tree against, along each cell's own ray.

Both walk the raster's rows towards smaller rows and columns, one sample a row, interpolated between
two cells, and count the samples that are seen, in float32.
"""

import numpy as np

from adret._kernels.jit import greater, index, kernel, parallel_kernel, prange


@parallel_kernel
def walk_as_published(z, t, count):
    """P2's naive walk: one receiver after the other, the height field sampled at every step."""
    for i in prange(z.shape[0]):
        for c in range(z.shape[1]):
            eye = z[i, c]
            best = np.float32(-np.inf)
            seen = 0
            for j in range(1, i + 1):
                column = c - t * j
                if column < 0.0:
                    break
                left = int(column)
                weight = np.float32(column - left)
                row = index(i - j)
                a = z[row, index(left)]
                b = z[row, index(min(left + 1, c))]
                slope = (a + (b - a) * weight - eye) / np.float32(j)
                if slope >= best:
                    best = slope
                    seen += 1
            count[i, c] = seen


@kernel
def _step(left, right, eye, p, q, v, best, seen):
    for x in range(len(eye)):
        slope = left[x] * p + right[x] * q - eye[x] * v
        seen[x] += np.float32(1.0) if slope >= best[x] else np.float32(0.0)
        best[x] = greater(slope, best[x])


@parallel_kernel
def walk_of_neighbours(z, t, count):
    """The same walk, a step of all receivers of a row at once: they share offsets and weights."""
    n, m = z.shape
    for i in prange(n):
        best = np.full(m, np.float32(-np.inf))
        count[i] = 0.0
        for j in range(1, i + 1):
            shift = int(np.ceil(t * j))
            if shift >= m:
                break
            q = np.float32(t * j - np.floor(t * j))
            right = 0 if q == 0.0 else 1
            per = np.float32(1.0) / np.float32(j)
            row = z[i - j]
            # The ray passes between the cells `shift` and `shift - 1` columns to the left.
            _step(
                row[: m - shift],
                row[right : m - shift + right],
                z[i, shift:],
                q * per if right else per,
                (np.float32(1.0) - q) * per if right else np.float32(0.0),
                per,
                best[shift:],
                count[i, shift:],
            )
