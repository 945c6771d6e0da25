"""STAC documents as lists of rasters: local files, and no others."""

import json
from pathlib import Path
from typing import Any

import pytest

import raster_files
from adret.cli import main
from adret.cli.tiling import expand
from adret.errors import RasterError
from adret.tiling.item_collections import rasters_of
from tile_runs import batch, job_of


def item(name: str, **assets: Any) -> dict[str, Any]:
    return {"type": "Feature", "stac_version": "1.0.0", "id": name, "assets": assets}


def write(path: Path, *items: dict[str, Any]) -> str:
    path.write_text(json.dumps({"type": "FeatureCollection", "features": list(items)}))
    return str(path)


def test_an_item_collection_is_one_surface(example_dem: Path, tmp_path: Path) -> None:
    """Two halves named by a collection give the file of the whole."""
    whole = raster_files.crop(example_dem, tmp_path / "whole.tif", 60, 80)
    (tmp_path / "parts").mkdir()
    raster_files.crop(whole, tmp_path / "parts" / "west.tif", 60, 40)
    east = raster_files.crop(whole, tmp_path / "parts" / "east.tif", 60, 40, corner=(0, 40))
    items = write(
        tmp_path / "items.json",
        item(
            "west",
            picture={"href": "west.png", "type": "image/png", "roles": ["thumbnail"]},
            heights={"href": "./parts/west.tif", "roles": ["data"]},
        ),
        item("east", dem={"href": str(east)}),
    )
    assert rasters_of(items) == [str(tmp_path / "parts" / "west.tif"), str(east)]
    chosen: dict[str, dict[str, Any]] = {"shadow": {"sun_deg": (250.0, 12.0)}}
    for name, sources in (("out", expand([items])), ("whole", [str(whole)])):
        batch(job_of(sources, 32, chosen), tmp_path / name)
    made, wanted = (tmp_path / name / "shadow.tif" for name in ("out", "whole"))
    assert made.read_bytes() == wanted.read_bytes()


@pytest.mark.parametrize(
    ("href", "words"),
    [
        ("https://example.com/a.tif", "href: must be a path on this machine"),
        ("s3://bucket/a.tif", "href: must be a path on this machine"),
        ("/vsicurl/https://example.com/a.tif", "href: must be a path on this machine"),
        ("../a.tif", "href: must be inside the document's folder"),
        ("a/../../b.tif", "href: must be inside the document's folder"),
        ("a\0.tif", "href: must be a path on this machine"),
    ],
)
def test_hrefs_that_lead_elsewhere_are_refused(href: str, words: str, tmp_path: Path) -> None:
    with pytest.raises(RasterError, match=words):
        rasters_of(write(tmp_path / "items.json", item("a", data={"href": href})))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("{", "a JSON document"),
        ("[" * 100_000, "a JSON document"),
        ("[]", "a STAC ItemCollection or Item"),
        ('{"type": "FeatureCollection", "features": []}', "with assets"),
        ('{"type": "FeatureCollection", "features": [3]}', "items with assets"),
        ('{"type": "Feature", "id": "a", "assets": {}}', "one asset with the role data"),
        (
            '{"type": "Feature", "assets": {"a": {"type": "image/tiff", "href": "a"},'
            ' "b": {"type": "image/tiff", "href": "b"}}}',
            "one asset with the role data",
        ),
    ],
)
def test_documents_that_name_no_raster_are_refused(text: str, words: str, tmp_path: Path) -> None:
    path = tmp_path / "items.json"
    path.write_text(text)
    with pytest.raises(RasterError, match=words):
        rasters_of(str(path))


def test_a_document_that_is_not_there_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["plan", str(tmp_path / "none.json")]) == 2
    said = capsys.readouterr().err.strip().splitlines()
    assert len(said) == 1
    assert "items: must be a file that can be read (No such file or directory)" in said[0]
