"""Whether the far field can rise over the near horizon anywhere (see `adret.sweep`)."""

import numpy as np

from adret._kernels.jit import kernel

POOLED = 4  # most samples that enter a hull as one
ZERO = np.float32(0.0)
MILLIONTH = np.float32(1e-6)


@kernel
def far_can_rise(z, pad, top, near, limits, rows, columns, best, answer):
    """Set ``answer[0]`` if a point as high as `top` beyond `near` steps could raise some `best`.

    Ends at the first row where one could: on rough ground that is soon. Receivers whose rays leave
    the raster within the near field have no far field.
    """
    observer, per_step, drop, shear, _ = limits
    # A vertex is beyond the near field of the last receiver of a pool, not yet of the first.
    least = max(near + 1 - (POOLED - 1), 1)
    nearest = np.float32(least)
    per = per_step / nearest
    lower = drop * nearest
    for i in range(max(rows[0], least), rows[1]):
        first = max(columns[0], np.int64(least * shear) + 1 if shear > ZERO else 0)
        if first >= columns[1]:
            continue
        receiver = z[i + pad[0], pad[1] + first : pad[1] + columns[1]]
        known = best[i, first : columns[1]]
        hopes = 0
        for x in range(len(known)):
            rise = top - receiver[x] - observer
            # Below the eye the slope to a farther point comes nearer to level: to 0 at most.
            bound = (rise * per if rise > ZERO else rise * ZERO) - lower
            hopes += bound + abs(bound) * MILLIONTH > known[x]
        if hopes > 0:
            answer[0] = True
            return
