"""Hostile and broken uploads against a real server: refused with a reason, nothing left behind."""

import socket
import struct
import time
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio
from servers import Server, command_line, descendants, hill, write_dem

SECRET = "the contents of another file"


def vrt(folder: Path) -> bytes:
    (folder / "secret.tif").write_bytes(write_dem(folder / "s.tif", hill(8, 8)).read_bytes())
    return (
        '<VRTDataset rasterXSize="8" rasterYSize="8"><VRTRasterBand dataType="Float32" band="1">'
        f"<SimpleSource><SourceFilename>{folder}/secret.tif</SourceFilename>"
        "<SourceBand>1</SourceBand></SimpleSource></VRTRasterBand></VRTDataset>"
    ).encode()


def wms(folder: Path) -> bytes:
    return (
        b"<GDAL_WMS><Service name='TMS'><ServerUrl>http://127.0.0.1:9/${z}</ServerUrl></Service>"
        b"<DataWindow><SizeX>64</SizeX><SizeY>64</SizeY></DataWindow></GDAL_WMS>"
    )


def tiff(width: int, height: int, rows_a_strip: int, *, bits: int = 32) -> bytes:
    """A TIFF of one strip that declares more than it holds."""
    data = zlib.compress(b"\0" * 4096)
    entries = [
        (256, 4, width),
        (257, 4, height),
        (258, 3, bits),
        (259, 3, 8),
        (262, 3, 1),
        (273, 4, 200),
        (277, 3, 1),
        (278, 4, rows_a_strip),
        (279, 4, len(data)),
        (339, 3, 3),
    ]
    directory = struct.pack("<H", len(entries))
    for tag, kind, value in entries:
        directory += struct.pack("<HHII", tag, kind, 1, value)
    return (b"II*\0\x08\0\0\0" + directory + b"\0\0\0\0").ljust(200, b"\0") + data


def png(width: int, height: int) -> bytes:
    """A PNG of zeros: 1000 times larger once decoded."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        crc = zlib.crc32(kind + data)
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", crc)

    squeezer = zlib.compressobj(9)
    rows = b"".join(squeezer.compress(bytes(width + 1)) for _ in range(height)) + squeezer.flush()
    header = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    return (
        b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", rows) + chunk(b"IEND", b"")
    )


def truncated(folder: Path) -> bytes:
    whole = write_dem(
        folder / "t.tif",
        np.random.default_rng(1).normal(size=(300, 300)).astype("f4"),
        compress="deflate",
    ).read_bytes()
    return whole[: len(whole) // 2]


def with_transform(folder: Path, *numbers: float) -> bytes:
    transform = rasterio.Affine(*numbers)
    return write_dem(folder / "t.tif", hill(9, 9), transform=transform).read_bytes()


def nodata(folder: Path) -> bytes:
    return write_dem(folder / "n.tif", np.full((9, 9), np.nan, "f4")).read_bytes()


def infinite(folder: Path) -> bytes:
    return write_dem(folder / "i.tif", np.full((9, 9), np.inf, "f4")).read_bytes()


def bands(folder: Path) -> bytes:
    profile = {"driver": "GTiff", "height": 4, "width": 4, "count": 40, "dtype": "uint8"}
    with rasterio.open(
        folder / "b.tif",
        "w",
        crs="EPSG:32632",
        transform=rasterio.Affine(9, 0, 0, 0, -9, 0),
        **profile,
    ):
        pass
    return (folder / "b.tif").read_bytes()


def grid(text: str) -> Callable[[Path], bytes]:
    return lambda _: text.encode()


ASC = "ncols {c}\nnrows {r}\nxllcorner 0\nyllcorner 0\ncellsize {s}\n"

CASES: dict[str, tuple[Callable[[Path], bytes], int, str]] = {
    "nothing": (lambda _: b"", 400, "file"),
    "a VRT that names another file": (vrt, 415, "file"),
    "a WMS description": (wms, 415, "file"),
    "a zip": (lambda _: b"PK\x03\x04" + b"\0" * 100, 415, "file"),
    "HTML": (lambda _: b"<!doctype html><p>", 415, "file"),
    "noise": (lambda _: bytes(range(256)) * 20, 415, "file"),
    "a TIFF cut in half": (truncated, 400, "file"),
    "the first bytes of a TIFF": (lambda _: b"II*\0\x08\0\0\0", 400, "file"),
    "a TIFF whose directory is elsewhere": (lambda _: b"II*\0\xff\xff\xff\x7f", 400, "file"),
    "the first bytes of a PNG": (lambda _: b"\x89PNG\r\n\x1a\n", 400, "file"),
    "300 bytes that declare 10^10 cells": (lambda _: tiff(100_000, 100_000, 1), 413, "size"),
    "300 bytes that declare 10^6 columns": (lambda _: tiff(1_000_000, 1, 1), 413, "size"),
    "a TIFF of 1000 times its size": (lambda _: tiff(5000, 5000, 1), 413, "size"),
    "a PNG of 1000 times its size": (lambda _: png(5000, 5000), 413, "size"),
    "forty bands": (bands, 413, "bands"),
    "all nodata": (nodata, 400, "heights"),
    "infinite heights": (infinite, 400, "heights"),
    "a rotated raster": (lambda f: with_transform(f, 1, 1, 0, 1, -1, 0), 400, "transform"),
    "cells of NaN metres": (
        lambda f: with_transform(f, float("nan"), 0, 0, 0, -1, 0),
        400,
        "cell size",
    ),
    "an ASCII grid of words": (grid(ASC.format(c=2, r=2, s=5) + "a b\nc d\n"), 400, "file"),
    "an ASCII grid without its rows": (grid(ASC.format(c=50, r=50, s=5) + "1 2\n"), 400, "file"),
    "an ASCII grid that declares 10^12 cells": (
        grid(ASC.format(c=10**6, r=10**6, s=5) + "1\n"),
        413,
        "size",
    ),
    "an ASCII grid of negative size": (grid(ASC.format(c=-5, r=5, s=5) + "1\n"), 400, "file"),
    "more than the limit": (lambda _: b"II*\0" + b"\0" * (5 << 20), 413, "file"),
}


def left_behind(server: Server) -> list[str]:
    """Everything in the scratch space and the store."""
    found = [p for folder in ("tmp", "store") for p in (server.data / folder).rglob("*")]
    return sorted(str(path.relative_to(server.data)) for path in found)


@pytest.mark.parametrize("raw", [False, True], ids=["form", "raw"])
@pytest.mark.parametrize("case", CASES)
def test_a_bad_file_is_refused_and_leaves_nothing(
    case: str, raw: bool, server: Server, dataset: str, tmp_path: Path
) -> None:
    make, status, field = CASES[case]
    content = make(tmp_path)
    before = left_behind(server)
    began = time.monotonic()
    if raw:
        headers = {"Content-Disposition": 'attachment; filename="/vsicurl/http://x/../dem.tif"'}
        answer = server.http.post("/uploads", content=content, headers=headers)
    else:
        answer = server.http.post("/uploads", files={"file": ("../../dem.tif", content)})
    assert answer.status_code == status, answer.text
    assert time.monotonic() - began < 5.0
    body = answer.json()
    assert [error["field"] for error in body["errors"]] == [field], body
    assert body["errors"][0]["limit"]
    assert body["detail"].startswith(f"{field}: must be ")
    for leak in (str(server.data), SECRET, str(tmp_path), "/work", "Traceback"):
        assert leak not in answer.text
    assert left_behind(server) == before


def decoder_children(server: Server) -> list[int]:
    assert server.process is not None
    return [
        child
        for pid in descendants(server.process.pid)
        if b"adret_service.decoder" in command_line(pid)
        for child in descendants(pid)
    ]


def test_the_decoder_keeps_no_child(server: Server, dataset: str) -> None:
    assert decoder_children(server) == []


@pytest.mark.parametrize(
    ("content", "kind", "field"),
    [
        (b"x", "multipart/form-data", "content-type"),
        (b"x", "multipart/form-data; boundary=" + "b" * 300, "content-type"),
        (b"--b\r\n", "multipart/form-data; boundary=b", "body"),
        (b"no boundary at all", "multipart/form-data; boundary=b", "body"),
        (
            b'--b\r\nContent-Disposition: form-data; name="file"\r\n\r\nabc',
            "multipart/form-data; boundary=b",
            "body",
        ),
        (
            b'--b\r\nContent-Disposition: form-data; name="other"\r\n\r\nabc\r\n--b--\r\n',
            "multipart/form-data; boundary=b",
            "other",
        ),
        (
            b"--b\r\nX-Long: " + b"a" * 20_000 + b"\r\n\r\nabc\r\n--b--\r\n",
            "multipart/form-data; boundary=b",
            "body",
        ),
        (b"--b--\r\n", "multipart/form-data; boundary=b", "file"),
        (
            b'--b\r\nContent-Disposition: form-data; name="file"\r\n\r\nabc\r\n'
            b'--b\r\nContent-Disposition: form-data; name="file"\r\n\r\nabc\r\n--b--\r\n',
            "multipart/form-data; boundary=b",
            "file",
        ),
    ],
)
def test_a_broken_form_is_refused(
    content: bytes, kind: str, field: str, server: Server, dataset: str
) -> None:
    before = left_behind(server)
    answer = server.http.post("/uploads", content=content, headers={"Content-Type": kind})
    assert answer.status_code == 400, answer.text
    assert [error["field"] for error in answer.json()["errors"]] == [field], answer.text
    assert left_behind(server) == before


def test_an_upload_without_a_declared_length_is_stopped_at_the_limit(
    server: Server, dataset: str
) -> None:
    before = left_behind(server)

    def endless() -> Any:
        for _ in range(64):
            yield b"\0" * (1 << 20)

    answer = server.http.post("/uploads", content=endless())
    assert answer.status_code == 413, answer.text
    assert answer.json()["errors"][0]["limit"] == f"at most {4 << 20} bytes"
    assert left_behind(server) == before


def test_a_client_that_goes_away_leaves_nothing(server: Server, dataset: str) -> None:
    before = left_behind(server)
    with socket.create_connection(("127.0.0.1", server.port)) as line:
        line.sendall(
            b"POST /uploads HTTP/1.1\r\nHost: localhost\r\nContent-Length: 1000000\r\n\r\n"
        )
        line.sendall(b"II*\0" * 1000)
        time.sleep(0.3)
        assert len(left_behind(server)) > len(before)
    deadline = time.monotonic() + 5.0
    while left_behind(server) != before and time.monotonic() < deadline:
        time.sleep(0.05)
    assert left_behind(server) == before


def test_a_picture_becomes_a_dataset_once_its_cell_size_is_given(
    server: Server, tmp_path: Path
) -> None:
    from PIL import Image

    path = tmp_path / "heights.png"
    heights = np.arange(600, dtype=np.uint16).reshape(20, 30)
    Image.fromarray(heights).save(path)
    refused = server.upload(path)
    assert refused.status_code == 400
    assert refused.json()["errors"][0]["field"] == "cell_size"
    for wrong in (-1.0, 0.0, 1e30):
        answer = server.upload(path, cell_size=wrong)
        assert answer.status_code == 400
        assert answer.json()["errors"][0]["field"] == "cell_size"
    found = server.upload(path, cell_size=12.5, vertical_unit="ft").json()
    assert found["cell_size"] == [12.5, 12.5]
    assert found["highest"] == pytest.approx(599 * 0.3048, abs=1e-3)
    assert found["crs"] is None
    job = server.submit("sky-view", dataset=found["id"], directions=4)
    assert server.wait(job)["status"] == "successful"


def test_equal_uploads_share_a_dataset_and_special_reading_does_not(
    server: Server, small_dem: Path
) -> None:
    first = server.upload(small_dem).json()["id"]
    assert server.upload(small_dem).json()["id"] == first
    assert server.upload(small_dem, vertical_unit="ft").json()["id"] != first
    assert server.upload(small_dem, band=2).status_code == 400
    assert server.upload(small_dem, vertical_unit="parsec").status_code == 400
    assert server.upload(small_dem, colour="red").status_code == 400
