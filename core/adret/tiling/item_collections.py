"""STAC items as a list of rasters: the local files that a JSON document names."""

import json
import os
from pathlib import Path
from typing import Any

from adret.errors import RasterError

__all__ = ["is_collection", "rasters_of"]

MAX_BYTES = 64 << 20
GEOTIFF = "image/tiff"
KEYS = ("data", "dem", "elevation", "heights")


def is_collection(name: str) -> bool:
    """Whether a name is one of a document with STAC items.

    Examples
    --------
    >>> is_collection("items.json"), is_collection("dem.tif")
    (True, False)
    """
    return name.lower().endswith((".json", ".geojson"))


def rasters_of(path: str) -> list[str]:
    """Files of the items of an ItemCollection, or of one item, in their order.

    Of every item the asset with the role "data" counts, else the one named data, dem, elevation or
    heights, else its only GeoTIFF. Nothing is fetched: an href is an absolute path, or one relative
    to the document that does not lead out of its folder.

    Parameters
    ----------
    path : str
        A JSON document of at most 64 MiB.

    Raises
    ------
    RasterError
        If the document cannot be used, or an item names no raster, several, or one elsewhere.
    """
    document = _document(path)
    kind = document.get("type")
    items = document.get("features") if kind == "FeatureCollection" else [document]
    if kind not in ("FeatureCollection", "Feature") or not isinstance(items, list) or not items:
        raise RasterError("items", "a STAC ItemCollection or Item with assets", path)
    found: list[str] = []
    for number, item in enumerate(items):
        name = str(item.get("id", number)) if isinstance(item, dict) else str(number)
        assets = item.get("assets") if isinstance(item, dict) else None
        if not isinstance(assets, dict):
            raise RasterError("items", "STAC items with assets", f"item {name} of {path}")
        href = _href(assets, name)
        place = _local(href, Path(path).absolute().parent, name)
        if place not in found:
            found.append(place)
    return found


def _document(path: str) -> dict[str, Any]:
    try:
        if os.stat(path).st_size > MAX_BYTES:
            raise RasterError("items", f"a document of at most {MAX_BYTES >> 20} MiB", path)
        with open(path, encoding="utf-8") as file:
            document = json.load(file)
    except OSError as error:
        raise RasterError("items", f"a file that can be read ({error.strerror})", path) from None
    except (ValueError, RecursionError):
        raise RasterError("items", "a JSON document", path) from None
    if not isinstance(document, dict):
        raise RasterError("items", "a STAC ItemCollection or Item", path)
    return document


def _href(assets: dict[str, Any], item: str) -> str:
    """Of the one asset that holds the heights."""
    known = {key: asset for key, asset in assets.items() if isinstance(asset, dict)}
    data = [each for each in known.values() if "data" in (each.get("roles") or ())]
    named = [known[key] for key in KEYS if key in known]
    tiffs = [each for each in known.values() if str(each.get("type", "")).startswith(GEOTIFF)]
    chosen = next((each for each in (data, named[:1], tiffs) if each), [])
    if len(chosen) != 1 or not isinstance(chosen[0].get("href"), str):
        limit = "one asset with the role data, or one GeoTIFF, in every item"
        raise RasterError("items", limit, f"item {item}: {', '.join(known) or 'none'}")
    return str(chosen[0]["href"])


def _local(href: str, folder: Path, item: str) -> str:
    """Path of a file on this machine."""
    if "://" in href or "\0" in href or href.startswith("/vsi"):
        raise RasterError("href", "a path on this machine (nothing is fetched)", href)
    if os.path.isabs(href):
        return os.path.normpath(href)
    place = os.path.normpath(folder / href)
    if not Path(place).is_relative_to(folder):
        raise RasterError("href", "inside the document's folder, or absolute", f"{item}: {href}")
    return place
