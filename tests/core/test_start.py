"""How quickly a first and a later run start, and what they say of it."""

import os
import resource
import subprocess
import sys
from pathlib import Path

import pytest

LINE = "adret: compiling for this machine (once) ..."
ONE_KERNEL = """
import sys
import numpy as np
from adret._kernels import jit
from adret._kernels.frames import mask_nodata
told = []
heights = np.zeros((3, 4), np.float32)
heights[1, 2] = np.nan
heights.flags.writeable = False
layer = np.ones((3, 4), np.float32)
with jit.tell_of_compilation(lambda: told.append("told")):
    mask_nodata(heights, layer)
    mask_nodata(heights, layer)
assert np.isnan(layer).sum() == 1 and np.isnan(layer[1, 2])
print(len(told), "numba.np.arraymath" in sys.modules)
"""


def python(cache: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, *arguments],
        env=os.environ | {"NUMBA_CACHE_DIR": str(cache)},
        capture_output=True,
        text=True,
        check=True,
    )


def test_a_kernel_is_compiled_once_told_of_once_and_then_loaded_without_the_compiler(
    tmp_path: Path,
) -> None:
    assert python(tmp_path, "-c", ONE_KERNEL).stdout.split() == ["1", "True"]
    assert python(tmp_path, "-c", ONE_KERNEL).stdout.split() == ["0", "False"]


@pytest.mark.slow
def test_the_first_run_says_that_it_compiles_and_the_next_ones_are_quick(
    tmp_path: Path, example_dem: Path
) -> None:
    def run(number: int) -> tuple[float, list[str]]:
        out = str(tmp_path / f"{number}.tif")
        command = "import sys; from adret.cli import main; sys.exit(main())"
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        done = python(tmp_path / "kernels", "-c", command, "horizon", str(example_dem), out)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        return spent, done.stderr.splitlines()

    cold, said = run(1)
    assert said == [LINE]
    warm, said = min(run(2), run(3))
    assert said == []
    assert warm < cold / 4.0
    first, second = (tmp_path / "1.tif").read_bytes(), (tmp_path / "3.tif").read_bytes()
    assert first == second


def test_what_a_start_leaves_out_is_there_for_who_asks_later(tmp_path: Path) -> None:
    code = """
import gc, sys
from adret.cli.running import collect_garbage_again, quick_start
with quick_start():
    import pyproj.transformer
    print("urllib.request" in sys.modules)
    try:
        pyproj.transformer._download_resource_file()
    except TypeError:  # the real one wants arguments
        print("urllib.request" in sys.modules)
import pyproj.sync, yaml
print(pyproj.sync.get_transform_grid_list.__name__, yaml.safe_load("[1]"))
gc.disable()
collect_garbage_again()
print(gc.isenabled())
"""
    said = python(tmp_path, "-c", code).stdout.splitlines()
    assert said == ["False", "True", "get_transform_grid_list [1]", "True"]


def test_a_command_that_others_call_does_not_end_their_process(tmp_path: Path) -> None:
    code = """
import gc, sys
from adret.cli import main
print(main(["horizon", "nothing.tif", "out.tif"]), gc.isenabled())
sys.argv = ["adret", "horizon", "nothing.tif", "out.tif"]
print(main(), gc.isenabled())
"""
    assert python(tmp_path, "-c", code).stdout.splitlines() == ["2 True", "2 True"]
