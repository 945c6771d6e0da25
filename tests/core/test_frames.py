"""Rasters turned into sweep frames, against NumPy."""

import itertools

import numpy as np
import pytest

from adret._kernels.frames import angles_oriented, copy_oriented


@pytest.mark.parametrize("shape", [(1, 1), (7, 9), (8, 8), (33, 70)])
def test_turning_moves_every_cell_to_its_place(shape: tuple[int, int]) -> None:
    rows, columns = shape
    whole = np.random.default_rng(0).random((rows + 3, columns + 5)).astype(np.float32)
    for swap, flip_rows, flip_columns in itertools.product((False, True), repeat=3):
        for source in (whole[1 : 1 + rows, 2 : 2 + columns], whole[:rows, :columns].copy()):
            source.flags.writeable = False
            wanted = source.T if swap else source
            wanted = wanted[::-1] if flip_rows else wanted
            wanted = wanted[:, ::-1] if flip_columns else wanted
            turned = np.zeros(wanted.shape, np.float32)
            copy_oriented(source, turned, swap, flip_rows, flip_columns)
            np.testing.assert_array_equal(turned, wanted)


@pytest.mark.parametrize("shape", [(1, 1), (9, 7), (33, 70)])
def test_angles_are_those_of_the_slopes_that_were_turned(shape: tuple[int, int]) -> None:
    whole = np.random.default_rng(1).standard_cauchy((shape[0] + 3, shape[1] + 5))
    source = whole.astype(np.float32)[1 : 1 + shape[0], 2 : 2 + shape[1]]
    source[0, 0] = -np.inf
    source[-1, -1] = np.nan if source.size > 1 else np.inf
    source.flags.writeable = False
    for swap, flip_rows, flip_columns in itertools.product((False, True), repeat=3):
        wanted = source.T if swap else source
        wanted = wanted[::-1] if flip_rows else wanted
        wanted = wanted[:, ::-1] if flip_columns else wanted
        turned = np.zeros(wanted.shape, np.float32)
        angles_oriented(source, turned, swap, flip_rows, flip_columns)
        np.testing.assert_allclose(turned, np.arctan(wanted.astype(np.float64)), atol=2e-7, rtol=0)
