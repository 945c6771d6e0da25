"""The command line: what it writes, and one line for everything that cannot be done."""

import json
import os
import re
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from importlib import metadata
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import rasterio
from PIL import Image

import adret
from adret import cli
from raster_files import save

COMMANDS = cli.COMMANDS
Run = Callable[..., "SimpleNamespace"]


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str]) -> Run:
    """Run the command in this process; gives code, out and err."""

    def run_(*arguments: Any) -> SimpleNamespace:
        code = cli.main([str(argument) for argument in arguments])
        caught = capsys.readouterr()
        return SimpleNamespace(code=code, out=caught.out, err=caught.err)

    return run_


@pytest.fixture
def dem(tmp_path: Path) -> Path:
    rows, columns = np.mgrid[0:30, 0:36]
    heights = 500.0 - 6.0 * np.hypot(rows - 15, columns - 18)
    return save(tmp_path / "dem.tif", heights.astype(np.float32), nodata=-9999.0)


def python(code: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)


# ---------------------------------------------------------------- what it writes


def test_horizon_writes_what_the_library_computes(run: Run, dem: Path, tmp_path: Path) -> None:
    done = run("horizon", dem, tmp_path / "h.tif", "--directions", 8, "--near", 4)
    assert (done.code, done.out, done.err) == (0, "", "")
    with rasterio.open(tmp_path / "h.tif") as source:
        values = source.read() * source.scales[0] + source.offsets[0]
        assert source.tags()["ADRET_NEAR"] == "4"
        assert source.crs.to_epsg() == 32633
    want = np.degrees(adret.horizon_map(adret.Terrain.open(dem), 8, near=4).elevation)
    np.testing.assert_allclose(values, want, atol=1.5e-3)


def test_every_product_writes_a_raster_and_a_picture(run: Run, dem: Path, tmp_path: Path) -> None:
    for command, options in [
        ("horizon", ["--azimuths", "0,90.5"]),
        ("sky", ["--kind", "normal", "--directions", "8", "--no-clip"]),
        ("openness", ["--sign", "-1", "--directions", "8"]),
        ("shadow", ["--sun", "135,20"]),
        ("light", ["--sun", "315,35", "--sky", "overcast", "--directions", "8"]),
        ("bounce", ["--sun", "315,35", "--bounces", "converge", "--directions", "8"]),
        ("viewshed", ["--observer", "15,18", "--observer", "3,4", "--curvature"]),
        ("visibility", ["--measure", "sight-distance", "--directions", "8"]),
    ]:
        out, picture = tmp_path / f"{command}.tif", tmp_path / f"{command}.png"
        done = run(command, dem, out, "--preview", picture, *options)
        assert (done.code, done.err) == (0, ""), command
        with rasterio.open(out) as source:
            assert source.shape == (30, 36)
            assert source.tags()["ADRET_DEFINITION"]
        with Image.open(picture) as image:
            assert image.size == (36, 30)


def test_shadow_of_the_command_is_that_of_the_sun_given(
    run: Run, dem: Path, tmp_path: Path
) -> None:
    run("shadow", dem, tmp_path / "s.tif", "--sun", "90,20")
    with rasterio.open(tmp_path / "s.tif") as source:
        code = source.read(1)
    assert (code[10:20, 22:34] == 0).all()  # the east side is lit
    assert (code[10:20, 4:14] != 0).all()  # a 31 degree cone under a sun at 20


def test_viewshed_takes_cells_places_and_limits(run: Run, dem: Path, tmp_path: Path) -> None:
    options = ["--observer", "15,18", "--at", "500055,4999945", "--observer-height", "2.5"]
    options += ["--azimuth-range", "300,60", "--layer", "count"]
    assert run("viewshed", dem, tmp_path / "v.tif", *options).err == ""
    with rasterio.open(tmp_path / "v.tif") as source:
        count, tags = source.read(1), source.tags()
    want = adret.viewshed(
        adret.Terrain.open(dem),
        [(15, 18), (5, 5)],
        observer_height=2.5,
        azimuth_range=np.radians((300.0, 60.0)),
    )
    np.testing.assert_array_equal(count, want.count)
    assert tags["ADRET_OBSERVERS"] == "row 15 column 18; row 5 column 5"
    assert tags["ADRET_AZIMUTH_RANGE"] == "300 to 60 deg"


def test_info_tells_what_was_read(run: Run, example_dem: Path, dem: Path) -> None:
    done = run("info", example_dem, "--json")
    facts = json.loads(done.out)
    assert (facts["rows"], facts["columns"]) == (310, 358)
    assert facts["cell_size_m"] == pytest.approx([200.0, 200.0])
    assert facts["crs_code"] == "EPSG:2056"
    assert facts["lowest_m"] == pytest.approx(502.0, abs=0.05)
    assert facts["highest_m"] == pytest.approx(4216.3, abs=0.05)
    assert facts["grid_convergence_deg"] == pytest.approx(0.35, abs=0.01)
    assert (facts["latitude_bands"], facts["vertical_unit"]) == (1, "m")
    table = run("info", dem).out
    assert re.search(r"cell size m\W+10 x 10", table)
    assert re.search(r"nodata share\W+0.00 %", table)


def test_cell_size_and_unit_can_be_said(run: Run, tmp_path: Path) -> None:
    picture = tmp_path / "heights.png"
    Image.fromarray(np.arange(12, dtype=np.uint16).reshape(3, 4)).save(picture)
    done = run("info", picture, "--json", "--cell-size", "2,3", "--vertical-unit", "ft")
    facts = json.loads(done.out)
    assert (facts["cell_size_m"], facts["vertical_unit"]) == ([2.0, 3.0], "ft")
    assert facts["highest_m"] == pytest.approx(11 * 0.3048)


# ---------------------------------------------------------------- one line for what is wrong


def test_wrong_input_ends_with_one_line_and_no_file(run: Run, dem: Path, tmp_path: Path) -> None:
    (tmp_path / "text.tif").write_text("hello")
    (tmp_path / "vrt.tif").write_text("<VRTDataset/>")
    (tmp_path / "empty.tif").touch()
    (tmp_path / "grid.asc").write_text(
        "ncols 2\nnrows 1\nxllcorner 0\nyllcorner 0\ncellsize nan\n1 2\n"
    )
    void = save(tmp_path / "void.tif", np.full((3, 3), -1.0), nodata=-1.0)
    nowhere = save(tmp_path / "nowhere.tif", np.eye(3), crs=None, transform=None)
    (tmp_path / "there.tif").write_bytes(b"older")
    before = sorted(os.listdir(tmp_path))
    out = tmp_path / "out.tif"
    wrong: list[tuple[list[Any], str]] = [
        (["horizon", tmp_path / "no.tif", out], "path: must be an existing file, got "),
        (["horizon", tmp_path / "text.tif", out], "path: must be a GeoTIFF, an Arc/Info"),
        (["horizon", tmp_path / "vrt.tif", out], "path: must be a GeoTIFF, an Arc/Info"),
        (["horizon", tmp_path / "empty.tif", out], "path: must be a raster file that is not empty"),
        (["horizon", tmp_path, out], "path: must be a regular file"),
        (["horizon", "/vsicurl/http://x/y", out], "path: must be a plain file path"),
        (
            ["horizon", tmp_path / "grid.asc", out],
            "cell size: must be finite and not zero, got 'nan x nan'",
        ),
        (["sky", void, out], "heights: must be a number in at least one cell, got 'all nodata'"),
        (["sky", nowhere, out], "cell_size: must be given"),
        (["sky", nowhere, out, "--cell-size", "nan,1"], "cell_size: must be between 1e-06"),
        (["sky", nowhere, out, "--cell-size", "3"], "cell_size: must be 2 numbers separated"),
        (["horizon", dem, out, "--directions", "0"], "directions: must be a whole number between"),
        (["horizon", dem, out, "--directions", "x"], "directions: must be a whole number between"),
        (
            ["horizon", dem, out, "--azimuths", "1,b"],
            "azimuths: must be numbers separated by commas",
        ),
        (["horizon", dem, out, "--near", "2.5"], "near: must be a whole number"),
        (["horizon", dem, out, "--refraction", "0.1"], "refraction: must be 0 without curvature"),
        (["horizon", dem, out, "--band", "2"], "band: must be between 1 and 1, got 2"),
        (["horizon", dem, out, "--band", "x"], "band: must be a whole number, got 'x'"),
        (["horizon", dem, out, "--threads", "0"], "threads: must be a whole number between 1 and"),
        (["shadow", dem, out, "--sun", "135"], "sun: must be 2 numbers separated by commas, got"),
        (["shadow", dem, out, "--sun", "135,95"], "sun: must be an elevation between -90 and 90"),
        (["light", dem, out], "sky: must be lit by at least one of sun, sky and environment"),
        (["light", dem, out, "--environment", tmp_path / "no.hdr"], "no.hdr"),
        (["sky", dem, tmp_path / "no" / "out.tif"], "out: must be in a folder that exists, got "),
        (["sky", dem, tmp_path], "out: must be a file name, not a folder, got "),
        (
            ["sky", dem, tmp_path / "there.tif"],
            "out: must be a new file (or ask to overwrite), got",
        ),
        (["sky", dem, dem, "--overwrite"], "out: must be another file than the input, got "),
        (["sky", dem, out, "--preview", dem, "--overwrite"], "preview: must be another file than"),
        (["sky", dem, out, "--preview", "no/x.png"], "preview: must be in a folder that exists"),
        (["sky", dem], "OUT: must be given, got nothing"),
        (["ssao", dem, "ao.tif"], "camera: must be given, got nothing"),
        (["sky", dem, out, "--colour", "red"], "option: must be one of those in --help, got"),
        (["sky", dem, out, "--kind", "blue"], "kind: must be one of visible, horizontal, normal"),
        (["viewshed", dem, out], "observer: must be given at least once, as a cell or as a place"),
        (["viewshed", dem, out, "--observer", "3"], "observer: must be 2 numbers separated by"),
        (["viewshed", dem, out, "--observer", "3.5,1"], "observer: must be a whole number of at"),
        (["viewshed", dem, out, "--observer", "30,1"], "observer: must be a cell between (0, 0)"),
        (["viewshed", dem, out, "--at", "0,0"], "at: must be inside the raster, got (0.0, 0.0)"),
        (["viewshed", dem, out, "--observer=1,-1"], "observer: must be a whole number of at least"),
        (
            ["viewshed", dem, out, "--observer", "1,1", "--azimuth-range", "360,0"],
            "azimuth_range: must be two different azimuths, got (360.0, 0.0)",
        ),
        (
            ["viewshed", dem, out, "--observer", "1,1", "--pitch-range", "10,-10"],
            "pitch_range: must be two elevations, the lower one first, got (10.0, -10.0)",
        ),
        (
            ["viewshed", dem, out, "--observer", "1,1", "--max-distance", "nan"],
            "max_distance: must be a number above 0 m, got nan",
        ),
        (
            ["viewshed", dem, out, "--observer", "1,1", "--target-height=-2"],
            "target_height: must be a number between 0 and 1e+06 m, got -2.0",
        ),
        (
            ["viewshed", dem, out, "--layer", "seen-by", *["--observer=1,1"] * 65],
            "observer: must be at most 64 for layer seen-by, got 65",
        ),
        (["bounce", dem, out], "sky: must be lit by at least one of sun, sky and environment"),
        (["bounce", dem, out, "--sky", "uniform", "--bounces", "0"], "bounces: must be a whole"),
        (["bounce", dem, out, "--sky", "uniform", "--bounces", "all"], "or converge, got 'all'"),
        (["visibility", dem, out, "--measure", "all"], "measure: must be one of visible-count,"),
        (["info", tmp_path / "no.tif"], "path: must be an existing file"),
        (["frobnicate"], "No such command 'frobnicate'."),
    ]
    for arguments, message in wrong:
        done = run(*arguments)
        assert done.code == 2, arguments
        assert done.err.count("\n") == 1, done.err
        assert done.err.startswith("adret: "), done.err
        assert message in done.err
        assert done.out == ""
        assert sorted(os.listdir(tmp_path)) == before, arguments


def test_a_folder_that_cannot_be_written_is_named(
    run: Run, dem: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # The administrator may write anywhere, so the system's answer is played.
    monkeypatch.setattr("adret._gdal.os.access", lambda *_: False)
    done = run("sky", dem, tmp_path / "out.tif")
    assert done.code == 2
    assert "out: must be in a folder that can be written, got" in done.err


def test_overwrite_replaces_what_is_there(run: Run, dem: Path, tmp_path: Path) -> None:
    out = tmp_path / "sky.tif"
    out.write_bytes(b"older")
    assert run("sky", dem, out, "--directions", "4").code == 2
    assert out.read_bytes() == b"older"
    assert run("sky", dem, out, "--directions", "4", "--overwrite").code == 0
    with rasterio.open(out) as source:
        assert source.count == 1


@pytest.mark.parametrize("option", ["OUT", "--preview"])
def test_a_pipe_is_never_replaced(option: str, run: Run, dem: Path, tmp_path: Path) -> None:
    pipe = tmp_path / "pipe.png"
    os.mkfifo(pipe)
    out = [pipe] if option == "OUT" else [tmp_path / "sky.tif", "--preview", pipe]
    done = run("sky", dem, *out, "--directions", "4", "--overwrite")
    assert done.code == 2
    assert "must be a regular file, not a device, pipe or socket, got" in done.err
    assert pipe.is_fifo()
    assert sorted(os.listdir(tmp_path)) == ["dem.tif", "pipe.png"]


@pytest.mark.parametrize("failure", [OSError(28, "No space left on device"), MemoryError()])
def test_a_machine_that_fails_gives_one_line_and_code_one(
    failure: Exception, run: Run, dem: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: Any, **__: Any) -> None:
        raise failure

    monkeypatch.setattr("adret.products.write", fail)
    done = run("sky", dem, tmp_path / "out.tif", "--directions", "4")
    assert done.code == 1
    assert done.err.count("\n") == 1
    assert os.listdir(tmp_path) == ["dem.tif"]


# ---------------------------------------------------------------- stopping


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_signal_ends_the_run_without_a_file(number: int, code: int, tmp_path: Path) -> None:
    dem = save(
        tmp_path / "dem.tif", np.random.default_rng(0).random((2000, 2000), dtype=np.float32)
    )
    child = subprocess.Popen(
        [
            *(sys.executable, "-c", "import sys; from adret.cli import main; sys.exit(main())"),
            *("horizon", str(dem), str(tmp_path / "out.tif"), "--directions", "720"),
        ],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    deadline = time.monotonic() + 60.0
    while not any(name.startswith(".adret-") for name in os.listdir(tmp_path)):
        assert child.poll() is None
        assert time.monotonic() < deadline
        time.sleep(0.05)
    child.send_signal(number)
    out, err = child.communicate(timeout=120)
    assert child.returncode == code
    assert out == ""
    err = err.removeprefix("adret: compiling for this machine (once) ...\n")
    assert err == ("adret: interrupted\n" if number == signal.SIGINT else "")
    assert os.listdir(tmp_path) == ["dem.tif"]


# ---------------------------------------------------------------- help and start


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_shows_examples_in_its_help(command: str, run: Run) -> None:
    done = run(command, "--help")
    assert done.code == 0
    assert "Examples:" in done.out
    assert f"\n    adret {command} " in done.out


def test_help_lists_all_commands(run: Run) -> None:
    listed = run("--help").out
    for command in COMMANDS:
        assert re.search(rf"^  {command}  ", listed, re.MULTILINE)


def test_help_loads_nothing_heavy() -> None:
    loaded = python(
        "import sys; from adret.cli import main; main(['--help']);"
        "print('loaded', *(m for m in ('numba', 'rasterio', 'numpy', 'rich', 'fastapi', 'dbos')"
        " if m in sys.modules))"
    ).stdout.splitlines()[-1]
    assert loaded == "loaded"


def test_help_takes_little_time() -> None:
    # Processor time, which other programs on the machine disturb less than the clock.
    quickest = float("inf")
    for _ in range(5):
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        python("from adret.cli import main; main(['--help'])")
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        spent = after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime
        quickest = min(quickest, spent)
    assert quickest < 0.4


def test_other_packages_add_commands(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    def add(app: Any) -> None:
        app.command("greet")(lambda: print("good morning"))

    entry = SimpleNamespace(name="greet", load=lambda: add)
    monkeypatch.setattr(metadata, "entry_points", lambda group: [entry])
    assert run("greet").out == "good morning\n"
    assert "greet" in run("--help").out


@pytest.mark.parametrize("command", ["serve", "run", "worker"])
def test_a_command_of_a_missing_extra_says_how_to_get_it(
    command: str, run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    wanted = 'must be installed with pip install "adret[service]", got'
    monkeypatch.setattr(metadata, "entry_points", lambda group: [])
    done = run(command)
    assert (done.code, wanted in done.err, done.err.count("\n")) == (2, True, 1)

    def missing(app: Any) -> None:
        raise ModuleNotFoundError("no", name="fastapi")

    entry = SimpleNamespace(name=command, load=lambda: missing)
    monkeypatch.setattr(metadata, "entry_points", lambda group: [entry])
    done = run(command)
    assert (done.code, wanted in done.err, "fastapi" in done.err) == (2, True, True)


def test_nothing_given_shows_the_help(run: Run) -> None:
    done = run()
    assert done.code == 2
    assert "Commands:" in done.out


def test_the_number_of_azimuths_can_be_left_to_the_product(
    run: Run, dem: Path, tmp_path: Path
) -> None:
    out = tmp_path / "auto.tif"
    assert run("sky", dem, out, "--directions", "auto", "--tolerance", "0.01").code == 0
    with rasterio.open(out) as found:
        chosen = found.tags()["ADRET_DIRECTIONS"]
        layer = found.read(1)
    count = int(chosen.split()[0])
    assert chosen.startswith(f"{count} (auto: changed by 0.0")
    plain = adret.sky_view_factor(adret.Terrain.open(dem), directions=count)
    np.testing.assert_allclose(layer, plain, rtol=2e-6)
    refused = run("openness", dem, tmp_path / "o.tif", "--tolerance", "0.01")
    assert (refused.code, "tolerance: must be left out" in refused.err) == (2, True)
    tiled = run("batch", dem, tmp_path / "out", "--product", "sky", "--directions", "auto")
    assert tiled.code == 2
