"""Horizon-based ambient occlusion.

Elevations stand on the plane at right angles to the pixel's view ray. LANES neighbours of a row
walk together: each loop over them does one thing and vectorises, but for the one that fetches
depths from all over the image.
"""

import numpy as np

from adret._kernels.jit import index, inline, kernel, parallel_kernel, prange
from adret._kernels.screen.containment import tangents
from adret._kernels.screen.falloffs import HARD, NONE, QUADRATIC, weight
from adret._kernels.screen.noise import uniform

LANES = 64
ANGLE = 0  # counters of the noise
STEP = 1
LOW = -2.0  # below any sine
# Rows of the scratch array: what a lane keeps for a pixel,
Z, X, Y, N_FIRST, N_SECOND, N_RAY, COS, SIN, JITTER, COUNT = (index(LANES * k) for k in range(10))
# the axes across its view ray and the one to the eye,
RIGHT_1, UP_1, BACK_1, RIGHT_2, UP_2, BACK_2, RIGHT_3, UP_3, BACK_3 = (
    index(LANES * k) for k in range(10, 19)
)
# the images of the projected radius along the first two [pixels],
ROW_1, COLUMN_1, ROW_2, COLUMN_2 = (index(LANES * k) for k in range(19, 23))
# along a direction,
STEP_ROW, STEP_COLUMN, TANGENT, TOP, GROUND = (index(LANES * k) for k in range(23, 28))
BANK = index(2 * LANES)  # from one bank of TOP and GROUND to the other
# and of a sample.
AT_ROW, AT_COLUMN, THERE, DISTANCE, ELEVATION, ABOVE, WEIGHT, TOTAL, SEEN = (
    index(LANES * k) for k in range(30, 39)
)
SCRATCH = 39 * LANES


@kernel
def begin_pixels(
    row,
    column0,
    lanes,
    s,
    depth,
    normal,
    rays,
    perspective,
    origin,
    seed,
    jitter,
    turn,
    steps,
    spacing,
    radius,
):
    """Fill what a lane keeps for its pixel; the number of steps is 0 where there is no surface."""
    ax, bx, ay, by = rays[0], rays[1], rays[2], rays[3]
    diagonal = np.hypot(depth.shape[0] * ay, depth.shape[1] * ax)
    for j in range(lanes):
        i = index(j)
        column = column0 + j
        z = np.float64(depth[row, column])
        grow = z if perspective else 1.0
        s[Z + i] = z
        s[X + i] = grow * (ax * column + bx)
        s[Y + i] = grow * (ay * row + by)
        first, second, third = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
        u, v, stretch = 0.0, 0.0, 1.0
        if perspective:
            u, v = ax * column + bx, ay * row + by
            stretch = np.sqrt(1.0 + u * u + v * v)
            third = (-u / stretch, -v / stretch, 1.0 / stretch)
            first, second = tangents(third[0], third[1], third[2])
        s[RIGHT_1 + i], s[UP_1 + i], s[BACK_1 + i] = first
        s[RIGHT_2 + i], s[UP_2 + i], s[BACK_2 + i] = second
        s[RIGHT_3 + i], s[UP_3 + i], s[BACK_3 + i] = third
        right = np.float64(normal[0, row, column])
        up = np.float64(normal[1, row, column])
        back = np.float64(normal[2, row, column])
        s[N_FIRST + i] = right * first[0] + up * first[1] + back * first[2]
        s[N_SECOND + i] = right * second[0] + up * second[1] + back * second[2]
        s[N_RAY + i] = max(right * third[0] + up * third[1] + back * third[2], 1e-4)
        # The image bounds what can be met.
        reach = min(radius, diagonal * grow) / grow
        s[COLUMN_1 + i] = reach * (first[0] + first[2] * u) / ax
        s[ROW_1 + i] = reach * (first[1] + first[2] * v) / ay
        s[COLUMN_2 + i] = reach * (second[0] + second[2] * u) / ax
        s[ROW_2 + i] = reach * (second[1] + second[2] * v) / ay
        long = reach * stretch / min(ax, -ay)
        s[COUNT + i] = 0.0
        if z == z:
            s[COUNT + i] = np.floor(long / spacing) if spacing > 0.0 else min(steps, np.floor(long))
        s[COS + i], s[SIN + i], s[JITTER + i] = 1.0, 0.0, 0.0
        if jitter:
            angle = turn * uniform(row + origin[0], column + origin[1], seed, ANGLE)
            s[COS + i], s[SIN + i] = np.cos(angle), np.sin(angle)
            s[JITTER + i] = uniform(row + origin[0], column + origin[1], seed, STEP)


@inline
def begin_direction(cosine, sine, lanes, s):
    """Set the steps of a direction and clear its horizon."""
    for j in range(lanes):
        i = index(j)
        per_step = 1.0 / (s[COUNT + i] + 1.0)
        along = (cosine * s[COS + i] - sine * s[SIN + i]) * per_step
        aside = -(sine * s[COS + i] + cosine * s[SIN + i]) * per_step  # rows count downwards
        s[STEP_COLUMN + i] = along * s[COLUMN_1 + i] + aside * s[COLUMN_2 + i]
        s[STEP_ROW + i] = along * s[ROW_1 + i] + aside * s[ROW_2 + i]
        s[TOP + i] = LOW
        s[GROUND + i] = 0.0
        s[TANGENT + i] = LOW


@inline
def places(row, column0, step, lanes, s, rows, columns, at):
    """Find each lane's pixel at a step; -1 where there is none."""
    for j in range(lanes):
        i = index(j)
        far = step + s[JITTER + i]
        r = np.floor(row + 0.5 + far * s[STEP_ROW + i])
        c = np.floor(column0 + j + 0.5 + far * s[STEP_COLUMN + i])
        s[AT_ROW + i] = r
        s[AT_COLUMN + i] = c
        known = (r >= 0.0) & (c >= 0.0) & (r < rows) & (c < columns) & (step <= s[COUNT + i])
        at[i] = np.int32(r * columns + c if known else -1.0)
        s[SEEN + i] += 1.0 if known else 0.0


@inline
def fetch(row, column0, lanes, s, depth, at):
    """Fetch the depths there; NaN outside and for the pixel itself."""
    own = np.int32(row * depth.shape[1] + column0)
    flat = depth.ravel()
    for j in range(lanes):
        i = index(j)
        k = at[i]
        s[THERE + i] = flat[index(k)] if k >= 0 and k != own + j else np.nan


@inline
def rise(lanes, s, rays, perspective, radius2, per_sample, cos_bias, sin_bias):
    """Find distances, elevations, and how far they stand above the tangent."""
    ax, bx, ay, by = rays[0], rays[1], rays[2], rays[3]
    for j in range(lanes):
        i = index(j)
        z = s[THERE + i]
        grow = z if perspective else 1.0
        right = grow * (ax * s[AT_COLUMN + i] + bx) - s[X + i]
        up = grow * (ay * s[AT_ROW + i] + by) - s[Y + i]
        back = s[Z + i] - z
        first = right * s[RIGHT_1 + i] + up * s[UP_1 + i] + back * s[BACK_1 + i]
        second = right * s[RIGHT_2 + i] + up * s[UP_2 + i] + back * s[BACK_2 + i]
        toward = right * s[RIGHT_3 + i] + up * s[UP_3 + i] + back * s[BACK_3 + i]
        across2 = first * first + second * second
        distance2 = across2 + toward * toward
        near = distance2 <= radius2
        distance = np.sqrt(distance2)
        fall = -(s[N_FIRST + i] * first + s[N_SECOND + i] * second)
        run2 = s[N_RAY + i] * s[N_RAY + i] * across2
        run = np.sqrt(run2)
        long = np.sqrt(run2 + fall * fall)
        raised = run * cos_bias - fall * sin_bias  # cosine of the tangent raised by the bias
        sine = (fall * cos_bias + run * sin_bias) / long if raised > 0.0 else 1.0
        if not per_sample:
            sine = sine if s[TANGENT + i] == LOW or not near else s[TANGENT + i]
            s[TANGENT + i] = sine if near else s[TANGENT + i]
        elevation = toward / distance
        s[DISTANCE + i] = distance
        s[ABOVE + i] = elevation - sine
        s[ELEVATION + i] = elevation if near else LOW - 1.0


@inline
def weigh(lanes, s, code, radius, scale, table):
    """Weigh distances by the falloff."""
    if code in (NONE, HARD):
        for j in range(lanes):
            i = index(j)
            s[WEIGHT + i] = 1.0 if s[DISTANCE + i] < radius else 0.0
    elif code == QUADRATIC:
        per_radius2 = 1.0 / (radius * radius)
        for j in range(lanes):
            i = index(j)
            s[WEIGHT + i] = max(1.0 - s[DISTANCE + i] * s[DISTANCE + i] * per_radius2, 0.0)
    else:
        for j in range(lanes):
            i = index(j)
            s[WEIGHT + i] = weight(code, radius, scale, table, s[DISTANCE + i])


@inline
def climb(lanes, s, before, after):
    """Add the samples that raise the horizon.

    It is read from one bank and written to the other: a value that is stored where it came from
    becomes a masked store, and the loop does not vectorise.
    """
    for j in range(lanes):
        i = index(j)
        top, ground = s[before + TOP + i], s[before + GROUND + i]
        elevation, above = s[ELEVATION + i], s[ABOVE + i]
        higher = (elevation > top) & ((top > LOW) | (above > 0.0))
        s[after + TOP + i] = elevation if higher else top
        s[after + GROUND + i] = above if higher else ground
        s[TOTAL + i] += s[WEIGHT + i] * (above - ground) if higher else 0.0


@kernel
def horizons_of_row(
    row,
    depth,
    normal,
    rays,
    perspective,
    frame,
    origin,
    seed,
    jitter,
    directions,
    steps,
    spacing,
    per_sample,
    bias,
    code,
    radius,
    scale,
    table,
    occlusion,
    confidence,
):
    """One row of `horizons`."""
    turn = 2.0 * np.pi / directions
    cos_bias, sin_bias = np.cos(bias), np.sin(bias)
    rows, columns = depth.shape
    s = np.empty(SCRATCH)
    at = np.empty(LANES, np.int32)
    for first in range(frame[2], frame[3], LANES):
        lanes = min(LANES, frame[3] - first)
        begin_pixels(
            row,
            first,
            lanes,
            s,
            depth,
            normal,
            rays,
            perspective,
            origin,
            seed,
            jitter,
            turn,
            steps,
            spacing,
            radius,
        )
        most = 0
        for j in range(lanes):
            i = index(j)
            most = max(most, np.int64(s[COUNT + i]))
            s[TOTAL + i] = 0.0
            s[SEEN + i] = 0.0
        for k in range(directions):
            begin_direction(np.cos(turn * k), np.sin(turn * k), lanes, s)
            for step in range(1, most + 1):
                places(row, first, step, lanes, s, rows, columns, at)
                fetch(row, first, lanes, s, depth, at)
                rise(lanes, s, rays, perspective, radius * radius, per_sample, cos_bias, sin_bias)
                weigh(lanes, s, code, radius, scale, table)
                climb(lanes, s, index(step + 1) % 2 * BANK, index(step) % 2 * BANK)
        for j in range(lanes):
            i = index(j)
            here = first - frame[2] + j
            taken = directions * s[COUNT + i]
            occlusion[here] = s[TOTAL + i] / directions
            confidence[here] = s[SEEN + i] / taken if taken > 0.0 else 1.0


@parallel_kernel
def horizons(
    depth,
    normal,
    rays,
    perspective,
    frame,
    origin,
    seed,
    jitter,
    directions,
    steps,
    spacing,
    per_sample,
    bias,
    code,
    radius,
    scale,
    table,
    occlusion,
    confidence,
):
    """Equation 9 with `steps` samples a direction, or one every `spacing` pixels where above 0.

    Samples are pixels; a direction of less than one pixel a step gets fewer steps. `per_sample`
    false grounds all samples of a direction on one tangent, equation 8.
    """
    for row in prange(frame[0], frame[1]):
        horizons_of_row(
            row,
            depth,
            normal,
            rays,
            perspective,
            frame,
            origin,
            seed,
            jitter,
            directions,
            steps,
            spacing,
            per_sample,
            bias,
            code,
            radius,
            scale,
            table,
            occlusion[row - frame[0]],
            confidence[row - frame[0]],
        )
