"""What every product's command does: check, read, compute with a progress bar, write."""

import contextlib
import gc
import os
import sys
import warnings
from collections.abc import Callable, Iterator
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, Any

from adret.cli.options import numbers
from adret.errors import InputError

if TYPE_CHECKING:
    from adret.parameters import Parameters
    from adret.screen import DepthBuffer
    from adret.terrain import Terrain

__all__ = ["open_terrain", "product_action"]

UNUSED = ("boto3", "scipy")
SETTINGS_OF_NUMBA = ".numba_config.yaml"


def product_action(name: str) -> Callable[..., None]:
    """Return the action of a product's command."""

    def action(
        source: str,
        out: str,
        parameters: "Parameters",
        *,
        preview: str | None,
        threads: str | None,
        overwrite: bool,
        **reading: Any,
    ) -> None:
        count = None if threads is None else _threads(threads)
        with quick_start():
            compute(source, out, parameters, preview, count, overwrite, reading)

    def compute(
        source: str,
        out: str,
        parameters: "Parameters",
        preview: str | None,
        count: int | None,
        overwrite: bool,
        reading: dict[str, Any],
    ) -> None:
        from adret._gdal import check_output
        from adret.parameters import specifications

        read = [s.name for s in specifications(type(parameters)) if s.form == "path"]
        paths = (source, reading.get("camera"), *(getattr(parameters, name) for name in read))
        inputs = tuple(path for path in paths if path is not None)
        check_output(out, overwrite=overwrite, inputs=inputs)
        if preview is not None:
            check_output(preview, field="preview", overwrite=overwrite, inputs=inputs)
        from adret import products

        product = products.PRODUCTS[name]
        opened = OPENERS[product.reads](source, **reading)
        from adret._kernels import jit

        jit.without_extensions()
        if count is not None:
            jit.threads(count)
        collect_garbage_again()
        with (
            warnings_in_a_line(),
            jit.tell_of_compilation(say_compiling),
            progress_bar(name) as progress,
        ):
            products.run(product, opened, parameters, out, preview, progress, overwrite=overwrite)

    return action


def open_terrain(
    source: str, band: str, cell_size: str | None, vertical_unit: str | None
) -> "Terrain":
    """Open a raster with options as they were typed."""
    number: Any = int(band) if band.lstrip("-").isdigit() else band
    if not isinstance(number, int):
        raise InputError("band", "a whole number", band)
    size = None if cell_size is None else numbers("cell_size", cell_size, 2)
    from adret.terrain import Terrain

    return Terrain.open(
        source,
        number,
        cell_size=None if size is None else (size[0], size[1]),
        vertical_unit=vertical_unit,
    )


def open_depth(source: str, camera: str, kind: str | None, guard_band: str | None) -> "DepthBuffer":
    """Open a depth buffer with options as they were typed."""
    given: dict[str, Any] = {}
    if kind is not None:
        given["kind"] = kind
    if guard_band is not None:
        if not guard_band.isdigit():
            raise InputError("guard_band", "a whole number of pixels", guard_band)
        given["guard_band"] = int(guard_band)
    from adret.screen import DepthBuffer

    return DepthBuffer.open(source, camera, **given)


OPENERS: dict[str, Callable[..., Any]] = {"terrain": open_terrain, "depth": open_depth}


def _threads(text: str) -> int:
    most = os.cpu_count() or 1
    if not text.isdigit() or not 1 <= int(text) <= most:
        raise InputError("threads", f"a whole number between 1 and {most}", text)
    return int(text)


@contextlib.contextmanager
def quick_start() -> Iterator[None]:
    """Import nothing that rasterio, pyproj and Numba only look for: half a second a start."""
    unused = UNUSED if os.path.exists(SETTINGS_OF_NUMBA) else (*UNUSED, "yaml")
    stand_ins: dict[str, ModuleType | None] = dict.fromkeys(unused)
    stand_ins["pyproj.sync"] = _download_later()
    hidden = {name: module for name, module in stand_ins.items() if name not in sys.modules}
    sys.modules.update(hidden)  # type: ignore[arg-type]
    try:
        yield
    finally:
        for name in hidden:
            sys.modules.pop(name, None)


def _download_later() -> ModuleType:
    """Stand in for pyproj's downloads, which take the Internet's modules to import, until asked."""
    module = ModuleType("pyproj.sync")

    def download(*arguments: Any, **options: Any) -> Any:
        sys.modules.pop("pyproj.sync", None)
        return import_module("pyproj.sync")._download_resource_file(*arguments, **options)

    module._download_resource_file = download  # type: ignore[attr-defined]
    return module


def collect_garbage_again() -> None:
    """Enable the collector where the command switched it off, past all that was loaded."""
    if not gc.isenabled():
        gc.freeze()
        gc.enable()


def say_compiling() -> None:
    """Say why the first run takes longer."""
    print("adret: compiling for this machine (once) ...", file=sys.stderr)


@contextlib.contextmanager
def warnings_in_a_line() -> Iterator[None]:
    """Let the library's warnings be one line on standard error, without a place in its code."""

    def show(message: Warning | str, *_: Any, **__: Any) -> None:
        print(f"adret: warning: {' '.join(str(message).split())}", file=sys.stderr)

    with warnings.catch_warnings():
        warnings.simplefilter("default", UserWarning)
        warnings.showwarning = show
        yield


@contextlib.contextmanager
def progress_bar(name: str) -> Iterator[Callable[[int, int], None] | None]:
    """Give a progress callback that draws on standard error, or None where nobody looks."""
    if not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(name, total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)
