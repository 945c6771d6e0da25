"""What goes wrong with a batch is one line that says what, and leaves what was there."""

import errno
import json
import os
from pathlib import Path
from typing import Any

import pytest

import raster_files
from adret.cli.batch import _grouped
from adret.errors import InputError, RasterError
from adret.tiling import prepare, run_batch
from adret.tiling.batches import check_folder
from adret.tiling.jobs import FOLDER, known_datum, tile_path
from tile_runs import Here, batch, job_of

SHADOW: dict[str, dict[str, Any]] = {"shadow": {"sun_deg": (250.0, 12.0)}}


@pytest.fixture
def small(example_dem: Path, tmp_path: Path) -> Path:
    return raster_files.crop(example_dem, tmp_path / "small.tif", 60, 70)


@pytest.mark.parametrize(
    ("given", "size", "words"),
    [
        (
            {"shadow": {"sun_deg": (250.0, 13.0)}},
            32,
            r"its products shadow sun_deg was \[250.0, 12",
        ),
        ({"shadow": {"sun_deg": (250.0, 12.0), "curvature": True}}, 32, "shadow curvature was Fal"),
        (SHADOW | {"openness": {}}, 32, "its products openness was None"),
        (SHADOW, 64, "its tile_size was 32"),
    ],
)
def test_a_resumption_names_the_first_option_that_differs(
    given: dict[str, Any], size: int, words: str, small: Path, tmp_path: Path
) -> None:
    prepare(job_of([small], 32, SHADOW), tmp_path / "out")
    with pytest.raises(InputError, match=words):
        prepare(job_of([small], size, given), tmp_path / "out", resume=True)


def test_a_resumption_names_a_raster_that_changed(small: Path, tmp_path: Path) -> None:
    prepare(job_of([small], 32, SHADOW), tmp_path / "out")
    os.utime(small, (1.0, 1.0))
    with pytest.raises(InputError, match="its pieces 0 modified was"):
        prepare(job_of([small], 32, SHADOW), tmp_path / "out", resume=True)


@pytest.mark.parametrize("text", ["", "{", "[1]", '{"datum": "x"}'])
def test_a_job_that_cannot_be_read_is_not_resumed(text: str, small: Path, tmp_path: Path) -> None:
    out, job = tmp_path / "out", job_of([small], 32, SHADOW)
    prepare(job, out)
    (out / FOLDER / "job.json").write_text(text)
    assert known_datum(out) is None
    with pytest.raises((InputError, RasterError), match="resume: must be of"):
        prepare(job, out, resume=True)
    with pytest.raises(RasterError, match="a new folder"):
        prepare(job, out)
    batch(job, out, overwrite=True)


@pytest.mark.parametrize("text", ["", "{", "[1]", "{}", '{"products": {}}'])
def test_a_manifest_that_cannot_be_read_is_written_anew(
    text: str, small: Path, tmp_path: Path
) -> None:
    out, job = tmp_path / "out", job_of([small], 32, SHADOW)
    batch(job, out)
    before = (out / "manifest.json").read_text()
    (out / "manifest.json").write_text(text)
    assert batch(job, out, resume=True).orders
    keep = ("sha256", "file", "tiles")
    known, again = (json.loads(each)["products"]["shadow"] for each in (before, _text(out)))
    assert [known[name] for name in keep] == [again[name] for name in keep]


def _text(out: Path) -> str:
    return (out / "manifest.json").read_text()


def test_folders_that_cannot_hold_results_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(RasterError, match="out: must be in a folder that exists"):
        check_folder(tmp_path / "none" / "out")
    (tmp_path / "file").touch()
    with pytest.raises(RasterError, match="out: must be a folder"):
        check_folder(tmp_path / "file")
    monkeypatch.setattr(os, "access", lambda path, mode: False)
    with pytest.raises(RasterError, match="out: must be in a folder that can be written"):
        check_folder(tmp_path / "out")


def test_a_full_disk_fails_the_tile_and_says_so(
    small: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from adret.tiling import jobs

    out, job = tmp_path / "out", job_of([small], 32, SHADOW)
    prepare(job, out)
    write, left = jobs.write_json, [2]

    def full(path: Path, document: Any) -> None:
        left[0] -= 1
        if left[0] < 0:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        write(path, document)

    monkeypatch.setattr(jobs, "write_json", full)
    report = run_batch(job, out, Here())
    assert report.failed
    (product,) = report.products
    assert len(product.errors) == 4
    assert _grouped(product.errors) == [
        "shadow at row 0 column 64: No space left on device (and 3 more tiles)"
    ]
    monkeypatch.undo()
    again = batch(job, out, resume=True)
    assert len(again.orders) == 4


def test_a_tile_that_cannot_be_read_is_one_error_and_made_anew_by_resuming(
    small: Path, tmp_path: Path
) -> None:
    out, job = tmp_path / "out", job_of([small], 32, SHADOW)
    prepare(job, out)

    class Spoiling(Here):
        """Spoils a tile after it was made."""

        def map(self, orders: Any) -> Any:
            yield from super().map(orders)
            path = tile_path(out, "shadow", job.tiles[3])
            path.write_bytes(b"x" * path.stat().st_size)

    with pytest.raises(OSError, match="not recognized"):
        run_batch(job, out, Spoiling())
    assert not (out / "shadow.tif").exists()
    again = batch(job, out, resume=True)
    assert [(order.row, order.column) for order in again.orders] == [(32, 0)]
