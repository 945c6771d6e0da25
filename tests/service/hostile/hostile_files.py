"""Files that a stranger might send: broken, lying, or meant to do harm. All are built here.

`FILES` maps a name to (query, status, field, builder): how the file is uploaded, and the refusal
that it must get. Builders take an empty folder and the address of a listener that must stay silent.
"""

import io
import json
import struct
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

Builder = Callable[[Path, str], bytes]
Case = tuple[dict[str, Any], int, str, Builder]

SECRET = "the contents of another file"
CODES = {"B": 1, "s": 2, "H": 3, "I": 4, "d": 12, "Q": 16}
ROWS = np.arange(64, dtype="<f4").tobytes()

Tags = dict[int, tuple[str, list[Any]]]

PLAIN: Tags = {
    256: ("I", [8]),  # width
    257: ("I", [8]),  # height
    258: ("H", [32]),  # bits
    259: ("H", [1]),  # compression
    262: ("H", [1]),  # photometric
    273: ("I", [-1]),  # offset of the strip: filled in
    277: ("H", [1]),  # bands
    278: ("I", [8]),  # rows a strip
    279: ("I", [256]),  # bytes of the strip
    339: ("H", [3]),  # floating point
    33550: ("d", [30.0, 30.0, 0.0]),
    33922: ("d", [0.0, 0.0, 0.0, 4e5, 5e6, 0.0]),
    34735: ("H", [1, 1, 0, 3, 1024, 0, 1, 1, 1025, 0, 1, 1, 3072, 0, 1, 32632]),
}


def tiff(changes: Tags | None = None, data: bytes = ROWS, order: str = "<") -> bytes:
    """A TIFF of one directory: `PLAIN` with changed tags; an empty list leaves a tag out."""
    tags = {tag: value for tag, value in (PLAIN | (changes or {})).items() if value[1]}
    head = 8 + 2 + 12 * len(tags) + 4
    beyond = b""
    entries = b""
    for tag, (kind, values) in sorted(tags.items()):
        if kind == "s":
            raw, count = values[0], len(values[0])
        else:
            numbers = [head + 65536 if value == -1 else value for value in values]
            raw, count = struct.pack(f"{order}{len(numbers)}{kind}", *numbers), len(numbers)
        if len(raw) > 4:
            place = struct.pack(order + "I", head + len(beyond))
            beyond += raw + b"\0" * (len(raw) % 2)
        else:
            place = raw.ljust(4, b"\0")
        entries += struct.pack(order + "HHI", tag, CODES[kind], count) + place
    start = (b"II*\0" if order == "<" else b"MM\0*") + struct.pack(order + "I", 8)
    directory = struct.pack(order + "H", len(tags)) + entries + b"\0\0\0\0"
    return (start + directory + beyond).ljust(head + 65536, b"\0") + data


def raw_entry(tag: int, code: int, count: int, value: int) -> bytes:
    """A plain TIFF with one directory entry overwritten, whatever it then says."""
    whole = bytearray(tiff())
    for k in range(len(PLAIN)):
        at = 10 + 12 * k
        if struct.unpack_from("<H", whole, at)[0] == tag:
            struct.pack_into("<HHII", whole, at, tag, code, count, value)
    return bytes(whole)


def deflated(width: int, height: int, strip: int, size: int) -> bytes:
    """A TIFF whose one short strip of `size` zeros claims to be all of the raster."""
    data = zlib.compress(bytes(size), 9)
    changes: Tags = {
        256: ("I", [width]),
        257: ("I", [height]),
        259: ("H", [8]),
        278: ("I", [strip]),
        279: ("I", [len(data)]),
    }
    return tiff(changes, data)


def metadata(text: str) -> bytes:
    return tiff({42112: ("s", [text.encode() + b"\0"])})


def geo(*numbers: int) -> Tags:
    return {34735: ("H", list(numbers))}


def xml(text: str) -> Builder:
    """A text that makes GDAL open something else; the names of a file and a listener go in."""

    def build(folder: Path, address: str) -> bytes:
        (folder / "secret.tif").write_bytes(tiff())
        return text.format(secret=folder / "secret.tif", address=address).encode()

    return build


def given(data: bytes) -> Builder:
    return lambda _folder, _address: data


# --- PNG ------------------------------------------------------------------------------------------


def chunk(kind: bytes, data: bytes, crc: int | None = None) -> bytes:
    crc = zlib.crc32(kind + data) if crc is None else crc
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", crc)


def png(width: int, height: int, rows: bytes | None = None, *more: bytes, bits: int = 8) -> bytes:
    header = struct.pack(">IIBBBBB", width, height, bits, 0, 0, 0, 0)
    if rows is None:
        squeezer = zlib.compressobj(9)
        pieces = [squeezer.compress(bytes(width + 1)) for _ in range(height)]
        rows = b"".join(pieces) + squeezer.flush()
    return b"".join(
        [
            b"\x89PNG\r\n\x1a\n",
            chunk(b"IHDR", header),
            *more,
            chunk(b"IDAT", rows),
            chunk(b"IEND", b""),
        ]
    )


# --- NumPy ----------------------------------------------------------------------------------------


def npy(header: str, data: bytes = b"", version: tuple[int, int] = (1, 0)) -> bytes:
    text = header.encode("latin-1")
    size = struct.pack("<H" if version == (1, 0) else "<I", len(text))
    return b"\x93NUMPY" + bytes(version) + size + text + data


def described(descr: str, shape: str, order: str = "False") -> str:
    return f"{{'descr': {descr}, 'fortran_order': {order}, 'shape': {shape}, }}\n"


def saved(array: Any, **options: Any) -> bytes:
    memory = io.BytesIO()
    np.save(memory, array, **options)
    return memory.getvalue()


HEIGHTS = saved(np.ones((4, 4), "f4"))


class Bomb:
    """What runs when somebody unpickles it."""

    def __reduce__(self) -> Any:
        return (open, ("/tmp/adret-was-here", "w"))


def archive(members: dict[str, bytes], method: int = zipfile.ZIP_DEFLATED) -> bytes:
    memory = io.BytesIO()
    with zipfile.ZipFile(memory, "w", method) as target:
        for name, data in members.items():
            target.writestr(name, data)
    return memory.getvalue()


def twice() -> bytes:
    """An archive with two members of one name: the second is renamed after it was written."""
    whole = archive({"heights.npy": HEIGHTS, "heightz.npy": HEIGHTS})
    return whole.replace(b"heightz.npy", b"heights.npy")


def encrypted() -> bytes:
    data = bytearray(archive({"heights.npy": saved(np.ones((4, 4)))}))
    for magic, at in ((b"PK\x03\x04", 6), (b"PK\x01\x02", 8)):
        data[data.index(magic) + at] |= 1
    return bytes(data)


def lying_archive() -> bytes:
    """A member that says it is small and is not."""
    data = bytearray(archive({"heights.npy": saved(np.zeros((1000, 1000)))}))
    at = data.index(b"PK\x01\x02")
    struct.pack_into("<I", data, at + 24, 200)
    return bytes(data)


GRID = "ncols {c}\nnrows {r}\nxllcorner 0\nyllcorner 0\ncellsize {s}\n"
CELL = {"cell_size": 5}
CAMERA = {"camera": json.dumps({"width": 48, "height": 32, "fov_y_deg": 60})}
LAUGHS = (
    '<?xml version="1.0"?><!DOCTYPE l [<!ENTITY a "ha">'
    + "".join(
        f'<!ENTITY {b} "&{a};&{a};&{a};&{a};&{a};&{a};&{a};&{a};&{a};&{a};">'
        for a, b in zip("abcdefgh", "bcdefghi", strict=True)
    )
    + "]><GDALMetadata><Item>&i;</Item></GDALMetadata>"
)

FILES: dict[str, Case] = {
    # Texts that make a careless reader open other files or call other hosts.
    "a VRT that names another file": (
        {},
        415,
        "file",
        xml(
            '<VRTDataset rasterXSize="8" rasterYSize="8">'
            '<VRTRasterBand dataType="Float32" band="1">'
            "<SimpleSource><SourceFilename>{secret}</SourceFilename><SourceBand>1</SourceBand>"
            "</SimpleSource></VRTRasterBand></VRTDataset>"
        ),
    ),
    "a VRT that names an address": (
        {},
        415,
        "file",
        xml(
            '<VRTDataset rasterXSize="8" rasterYSize="8">'
            '<VRTRasterBand dataType="Float32" band="1">'
            "<SimpleSource><SourceFilename>/vsicurl/{address}/x.tif</SourceFilename>"
            "</SimpleSource></VRTRasterBand></VRTDataset>"
        ),
    ),
    "a VRT with code in it": (
        {},
        415,
        "file",
        xml(
            '<VRTDataset rasterXSize="8" rasterYSize="8">'
            '<VRTRasterBand dataType="Float32" band="1" '
            'subClass="VRTDerivedRasterBand"><PixelFunctionLanguage>Python</PixelFunctionLanguage>'
            "</VRTRasterBand></VRTDataset>"
        ),
    ),
    "a warped VRT after a blank": (
        {},
        415,
        "file",
        xml(
            ' \n<VRTDataset subClass="VRTWarpedDataset"><GDALWarpOptions><SourceDataset>{secret}'
            "</SourceDataset></GDALWarpOptions></VRTDataset>"
        ),
    ),
    "a WMS description": (
        {},
        415,
        "file",
        xml(
            "<GDAL_WMS><Service name='TMS'>"
            "<ServerUrl>{address}/${{z}}/${{x}}/${{y}}.png</ServerUrl>"
            "</Service><DataWindow><SizeX>64</SizeX><SizeY>64</SizeY></DataWindow></GDAL_WMS>"
        ),
    ),
    "a WCS description": (
        {},
        415,
        "file",
        xml(
            "<WCS_GDAL><ServiceURL>{address}?</ServiceURL><CoverageName>x</CoverageName></WCS_GDAL>"
        ),
    ),
    "a WMTS description": (
        {},
        415,
        "file",
        xml("<GDAL_WMTS><GetCapabilitiesUrl>{address}</GetCapabilitiesUrl></GDAL_WMTS>"),
    ),
    "an OGC API description": (
        {},
        415,
        "file",
        xml('{{"links":[{{"rel":"data","href":"{address}"}}]}}'),
    ),
    "a STACIT catalogue": (
        {},
        415,
        "file",
        xml(
            '{{"type":"FeatureCollection","stac_version":"1.0.0","features":[{{"type":"Feature",'
            '"stac_version":"1.0.0","assets":{{"a":{{"href":"{address}/x.tif"}}}}}}]}}'
        ),
    ),
    "a STACTA document": (
        {},
        415,
        "file",
        xml('{{"stac_extensions":["tiled-assets"],"assets":{{"a":{{"href":"{address}"}}}}}}'),
    ),
    "a tile index": (
        {},
        415,
        "file",
        xml("<GDALTileIndexDataset><IndexDataset>{secret}</IndexDataset></GDALTileIndexDataset>"),
    ),
    "an XML with an external entity": (
        {},
        415,
        "file",
        xml('<?xml version="1.0"?><!DOCTYPE x [<!ENTITY e SYSTEM "file://{secret}">]><x>&e;</x>'),
    ),
    "a list of file names": ({}, 415, "file", xml("{secret}\n/etc/passwd\n")),
    "an SVG with a script": (
        {},
        415,
        "file",
        xml('<svg xmlns="x"><script href="{address}"/></svg>'),
    ),
    # Other kinds of files.
    "nothing": ({}, 400, "file", given(b"")),
    "one byte": ({}, 415, "file", given(b"I")),
    "zeros": ({}, 415, "file", given(bytes(4096))),
    "noise": ({}, 415, "file", given(bytes(range(256)) * 20)),
    "HTML": ({}, 415, "file", given(b"<!doctype html><p>")),
    "HDF5": ({}, 415, "file", given(b"\x89HDF\r\n\x1a\n" + bytes(500))),
    "NetCDF": ({}, 415, "file", given(b"CDF\x02" + bytes(500))),
    "GRIB": ({}, 415, "file", given(b"GRIB\0\0\0\x02" + bytes(500))),
    "JPEG": ({}, 415, "file", given(b"\xff\xd8\xff\xe0" + bytes(500))),
    "JPEG 2000": ({}, 415, "file", given(b"\0\0\0\x0cjP  \r\n\x87\n" + bytes(500))),
    "a gzip": ({}, 415, "file", given(b"\x1f\x8b\x08" + bytes(500))),
    "a program": ({}, 415, "file", given(b"\x7fELF" + bytes(500))),
    "OpenEXR where it is off": (CAMERA, 400, "file", given(b"\x76\x2f\x31\x01" + bytes(500))),
    # TIFF: what its header says of itself.
    "a TIFF's first bytes": ({}, 400, "file", given(b"II*\0\x08\0\0\0")),
    "a TIFF whose directory is elsewhere": ({}, 400, "file", given(b"II*\0\xff\xff\xff\x7f")),
    "a TIFF whose directory is itself": ({}, 400, "file", given(b"II*\0\0\0\0\0" * 50)),
    "a BigTIFF that points beyond everything": (
        {},
        400,
        "file",
        given(b"II+\0\x08\0\0\0" + b"\xff" * 8),
    ),
    "a TIFF of the other byte order than it says": ({}, 400, "file", given(b"MM\0*" + tiff()[4:])),
    "a big-endian TIFF called little-endian": (
        {},
        400,
        "file",
        given(b"II*\0" + tiff(order=">")[4:]),
    ),
    "a TIFF without a width": ({}, 400, "file", given(tiff({256: ("I", [])}))),
    "a TIFF of no rows": ({}, 400, "file", given(tiff({257: ("I", [0])}))),
    "a TIFF cut off in its numbers": ({}, 400, "file", given(tiff()[:-200])),
    "a TIFF whose strip is elsewhere": ({}, 400, "file", given(raw_entry(273, 4, 1, 2**31))),
    "a TIFF whose strip is longer than all": ({}, 400, "file", given(deflated(8, 8, 8, 256)[:-20])),
    "a tag with 2^32 values": ({}, 400, "file", given(raw_entry(273, 4, 2**32 - 1, 8))),
    "a compression that nobody knows": ({}, 400, "file", given(tiff({259: ("H", [9999])}))),
    "LZW of noise": ({}, 400, "file", given(tiff({259: ("H", [5])}, bytes(range(256))))),
    "deflate of noise": ({}, 400, "file", given(tiff({259: ("H", [8])}, bytes(range(256))))),
    "zstd of noise": ({}, 400, "file", given(tiff({259: ("H", [50000])}, bytes(range(256))))),
    "JPEG in a TIFF of real numbers": ({}, 400, "file", given(tiff({259: ("H", [7])}))),
    "complex numbers": (
        {},
        400,
        "dtype",
        given(tiff({258: ("H", [64]), 339: ("H", [6]), 279: ("I", [512])}, ROWS * 2)),
    ),
    "300 bytes that say 10^10 cells": ({}, 413, "size", given(deflated(100_000, 100_000, 1, 4096))),
    "a million columns": ({}, 413, "size", given(deflated(1_000_000, 1, 1, 4096))),
    "2^32 - 1 rows": ({}, 400, "file", given(deflated(1, 2**32 - 1, 1, 4096))),
    "one strip of 100 MB": ({}, 413, "block", given(deflated(5000, 5000, 5000, 100_000_000))),
    "one tile of 16 GiB": (
        {},
        413,
        "block",
        given(
            tiff(
                {
                    322: ("I", [65536]),
                    323: ("I", [65536]),
                    324: ("I", [-1]),
                    325: ("I", [256]),
                    273: ("I", []),
                    278: ("I", []),
                    279: ("I", []),
                }
            )
        ),
    ),
    "a thousand times its size": ({}, 413, "size", given(deflated(5000, 5000, 1, 4096))),
    "forty bands": (
        {},
        413,
        "bands",
        given(
            tiff(
                {
                    277: ("H", [40]),
                    258: ("H", [32] * 40),
                    339: ("H", [3] * 40),
                    284: ("H", [1]),
                    279: ("I", [256 * 40]),
                },
                ROWS * 40,
            )
        ),
    ),
    "65535 bands": ({}, 413, "bands", given(tiff({277: ("H", [65535]), 284: ("H", [1])}))),
    # TIFF: its place and its metadata.
    "no geotransform": ({}, 400, "cell_size", given(tiff({33550: ("d", []), 33922: ("d", [])}))),
    "cells of NaN metres": ({}, 400, "cell size", given(tiff({33550: ("d", [float("nan")] * 3)}))),
    "cells of infinite metres": (
        {},
        400,
        "cell size",
        given(tiff({33550: ("d", [float("inf")] * 3)})),
    ),
    "cells of no size": ({}, 400, "cell_size", given(tiff({33550: ("d", [0.0, 0.0, 0.0])}))),
    "cells of 10^300 metres": (
        {},
        400,
        "transform",
        given(tiff({33550: ("d", [1e300, 1e300, 0.0])})),
    ),
    "a place of NaN": (
        {},
        400,
        "cell size",
        given(tiff({33922: ("d", [0.0, 0.0, 0.0, float("nan"), 5e6, 0.0])})),
    ),
    "a rotated raster": (
        {},
        400,
        "transform",
        given(
            tiff(
                {
                    33550: ("d", []),
                    33922: ("d", []),
                    34264: ("d", [1.0, 1.0, 0, 0, 1.0, -1.0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1.0]),
                }
            )
        ),
    ),
    "degrees beyond the pole": (
        {},
        400,
        "latitude",
        given(tiff(geo(1, 1, 0, 3, 1024, 0, 1, 2, 1025, 0, 1, 1, 2048, 0, 1, 4326))),
    ),
    "geocentric coordinates": (
        {},
        400,
        "crs",
        given(tiff(geo(1, 1, 0, 3, 1024, 0, 1, 3, 1025, 0, 1, 1, 2048, 0, 1, 4978))),
    ),
    "all nodata": ({}, 400, "heights", given(tiff(data=np.full(64, np.nan, "<f4").tobytes()))),
    "infinite heights": (
        {},
        400,
        "heights",
        given(tiff(data=np.full(64, np.inf, "<f4").tobytes())),
    ),
    "a scale of NaN": (
        {},
        400,
        "scale",
        given(
            metadata(
                '<GDALMetadata><Item name="SCALE" sample="0" role="scale">nan</Item></GDALMetadata>'
            )
        ),
    ),
    "heights in parsecs": (
        {},
        400,
        "vertical_unit",
        given(
            metadata(
                '<GDALMetadata><Item name="UNITTYPE" sample="0" role="unittype">parsec</Item>'
                "</GDALMetadata>"
            )
        ),
    ),
    # PNG.
    "a PNG's first bytes": (CELL, 400, "file", given(b"\x89PNG\r\n\x1a\n")),
    "a PNG of a thousand times its size": (CELL, 413, "size", given(png(5000, 5000))),
    "a PNG of 10^9 cells": (CELL, 413, "size", given(png(100_000, 100_000, b""))),
    "a PNG of no width": (CELL, 400, "file", given(png(0, 9, b""))),
    "a PNG without its rows": (CELL, 400, "file", given(png(9, 9, b""))),
    "a PNG with a wrong checksum": (CELL, 400, "file", given(png(9, 9)[:40] + b"\0" * 20)),
    "a PNG of noise": (CELL, 400, "file", given(png(9, 9, bytes(range(99))))),
    # ASCII grids.
    "a grid of words": (
        {},
        400,
        "file",
        given((GRID.format(c=2, r=2, s=5) + "a b\nc d\n").encode()),
    ),
    "a grid without its rows": (
        {},
        400,
        "file",
        given((GRID.format(c=50, r=50, s=5) + "1 2\n").encode()),
    ),
    "a grid of 10^12 cells": (
        {},
        413,
        "size",
        given((GRID.format(c=10**6, r=10**6, s=5) + "1\n").encode()),
    ),
    "a grid of negative size": (
        {},
        400,
        "file",
        given((GRID.format(c=-5, r=5, s=5) + "1\n").encode()),
    ),
    "a grid of cells of NaN": (
        {},
        400,
        "cell size",
        given((GRID.format(c=2, r=2, s="nan") + "1 2\n3 4\n").encode()),
    ),
    "a grid of one endless number": (
        {},
        400,
        "file",
        given((GRID.format(c=2, r=2, s=5) + "1" * 10**6).encode()),
    ),
    "a grid with a byte of zero": (
        {},
        400,
        "file",
        given((GRID.format(c=2, r=2, s=5) + "1 2\n3 \0 4\n").encode()),
    ),
    # NumPy arrays and archives.
    "an array of objects": (
        CELL,
        400,
        "dtype",
        given(saved(np.array([[Bomb()]], object), allow_pickle=True)),
    ),
    "a pickle called an array": (CELL, 415, "file", given(b"\x80\x04\x95" + bytes(100))),
    "an array of text": (CELL, 400, "dtype", given(saved(np.array([["a"]])))),
    "an array of records": (CELL, 400, "dtype", given(saved(np.zeros((2, 2), "i4,f4")))),
    "an array of dates": (CELL, 400, "dtype", given(saved(np.zeros((2, 2), "M8[s]")))),
    "an array of complex numbers": (CELL, 400, "dtype", given(saved(np.zeros((2, 2), "c8")))),
    "an array of three sides": (CELL, 400, "shape", given(saved(np.zeros((2, 2, 2))))),
    "an array of no rows": (CELL, 400, "shape", given(saved(np.zeros((0, 2))))),
    "an array of negative size": (
        CELL,
        400,
        "shape",
        given(npy(described("'<f4'", "(-4, 4)"), bytes(64))),
    ),
    "193 bytes that say 74 GiB": (
        CELL,
        413,
        "size",
        given(npy(described("'<f8'", "(100000, 100000)"))),
    ),
    "an array cut off": (CELL, 400, "file", given(HEIGHTS[:-9])),
    "an array with more behind it": (CELL, 400, "file", given(HEIGHTS + b"more")),
    "an array whose header is a program": (
        CELL,
        400,
        "file",
        given(npy("__import__('os').abort()\n", bytes(64))),
    ),
    "an array whose header is nested": (CELL, 400, "file", given(npy("(" * 9000 + "\n"))),
    "an array whose header never ends": (
        CELL,
        400,
        "file",
        given(npy("{" * 60_000, version=(2, 0))),
    ),
    "an array of a future version": (
        CELL,
        400,
        "file",
        given(npy(described("'<f4'", "(4, 4)"), bytes(64), (9, 0))),
    ),
    "an array of all nodata": (CELL, 400, "heights", given(saved(np.full((4, 4), np.nan)))),
    "an archive a thousand times its size": (
        CELL,
        413,
        "size",
        given(archive({"a.npy": saved(np.zeros((3000, 3000)))})),
    ),
    "an archive that says less than it has": (CELL, 400, "file", given(lying_archive())),
    "an archive in an archive": (
        CELL,
        400,
        "file",
        given(archive({"a.npz": archive({"a.npy": HEIGHTS})})),
    ),
    "an archive of paths": (CELL, 400, "file", given(archive({"../../heights.npy": HEIGHTS}))),
    "an archive of absolute paths": (
        CELL,
        400,
        "file",
        given(archive({"/tmp/heights.npy": HEIGHTS})),
    ),
    "an archive of the same name twice": (CELL, 400, "file", given(twice())),
    "an archive of a thousand members": (
        CELL,
        400,
        "file",
        given(archive({f"{k}.npy": b"" for k in range(1000)})),
    ),
    "an archive of two arrays": (
        CELL,
        400,
        "file",
        given(archive({"a.npy": HEIGHTS, "b.npy": HEIGHTS})),
    ),
    "an encrypted archive": (CELL, 400, "file", given(encrypted())),
    "an archive of another compression": (
        CELL,
        400,
        "file",
        given(archive({"a.npy": HEIGHTS}, zipfile.ZIP_LZMA)),
    ),
    "an archive with a GeoTIFF": (CELL, 400, "file", given(archive({"dem.tif": tiff()}))),
    "an archive of objects": (
        CELL,
        400,
        "dtype",
        given(archive({"a.npy": saved(np.array([[Bomb()]], object), allow_pickle=True)})),
    ),
    "an archive cut off": (CELL, 415, "file", given(archive({"a.npy": HEIGHTS})[:60])),
    # Depth buffers.
    "a depth archive a thousand times its size": (
        CAMERA,
        413,
        "size",
        given(archive({"depth.npy": saved(np.zeros((3000, 3000)))})),
    ),
    "a depth TIFF of one 100 MB strip": (
        CAMERA,
        413,
        "block",
        given(deflated(5000, 5000, 5000, 4096)),
    ),
    "a depth array of objects": (
        CAMERA,
        400,
        "depth dtype",
        given(saved(np.array([[Bomb()]], object), allow_pickle=True)),
    ),
    "a depth array of another size": (CAMERA, 400, "depth", given(HEIGHTS)),
    # How it is to be read.
    "a camera of 10^18 pixels": (
        {"camera": '{"width": 1e9, "height": 1e9, "fov_y_deg": 60}'},
        400,
        "width",
        given(HEIGHTS),
    ),
    "a camera nested a thousand times": (
        {"camera": '{"a":' * 1000 + "1" + "}" * 1000},
        400,
        "camera",
        given(HEIGHTS),
    ),
    "a georeference with a file's name": (
        {"georeference": '{"crs": "+init=/etc/passwd:1"}'},
        400,
        "georeference.crs",
        given(HEIGHTS),
    ),
    "a band of 10^9": ({"band": 10**9}, 400, "band", given(tiff())),
    "a cell size of infinity": ({"cell_size": "inf"}, 400, "cell_size.0", given(HEIGHTS)),
    "more than may be sent": ({}, 413, "file", given(b"II*\0" + bytes(9 << 20))),
}

# Odd, but readable: these are taken, and show that the corpus refuses for its own reasons.
HARMLESS: dict[str, Builder] = {
    "a plain TIFF made the same way": given(tiff()),
    "a big-endian TIFF": given(tiff(data=np.arange(64, dtype=">f4").tobytes(), order=">")),
    "metadata with a billion laughs": given(metadata(LAUGHS)),
    "metadata with an external entity": lambda _, address: metadata(
        f'<!DOCTYPE x [<!ENTITY e SYSTEM "{address}/x">]>'
        "<GDALMetadata><Item name='a'>&e;</Item></GDALMetadata>"
    ),
    "a TIFF whose next directory is itself": given(
        tiff()[: 10 + 12 * len(PLAIN)] + struct.pack("<I", 8) + tiff()[14 + 12 * len(PLAIN) :]
    ),
}
