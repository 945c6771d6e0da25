"""Everything about Numba in one place: flags, threading layer, disk cache.

Numba's disk cache goes stale when a helper in another module changes, so every kernel module has a
cache folder of its own, whose name ends in a digest of that module, of the kernel modules it
imports, and of the Numba and Python versions: an edited kernel gets a new, empty folder, old code
can never run, and what does not use it is not compiled again. ``NUMBA_CACHE_DIR`` sets the root of
these folders; the default is the user's cache folder.
"""

import contextlib
import ctypes
import hashlib
import os
import platform
import re
import shutil
import sys
from collections.abc import Callable
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any

import numba
from numba.core import types
from numba.extending import intrinsic

__all__ = [
    "greater",
    "index",
    "inline",
    "kernel",
    "parallel_kernel",
    "prange",
    "strict_kernel",
    "strict_parallel_kernel",
    "threading_layer",
    "threads",
]

# NaN is nodata and -inf is "no terrain": the flags that assume neither exists are left out.
FASTMATH = {"contract", "nsz", "arcp"}
KEPT_CACHES = 4


def _cache_root() -> Path:
    chosen = os.environ.get("NUMBA_CACHE_DIR")
    if chosen:
        return Path(chosen)
    if sys.platform == "win32":
        base = os.environ.get("LOCALAPPDATA") or str(Path.home() / "AppData" / "Local")
    else:
        base = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    return Path(base) / "adret" / "numba"


KERNELS = Path(__file__).parent
IMPORT = re.compile(r"^from adret\._kernels\.([\w.]+) import", re.MULTILINE)


@cache
def _imported(module: str) -> tuple[bytes, frozenset[str]]:
    """Source of a kernel module, and the kernel modules which that source imports."""
    source = (KERNELS / (module.replace(".", "/") + ".py")).read_bytes()
    return source, frozenset(IMPORT.findall(source.decode()))


@cache
def source_digest(module: str) -> str:
    """Digest of all that a kernel module's machine code comes from (16 hex digits).

    `module` is named from this package on, as in ``"hull_sweep"``: its source, the sources of the
    kernel modules that it imports, directly or not, and the versions that compile them.
    """
    digest = hashlib.sha256(f"{numba.__version__} {platform.python_version()}".encode())
    found: set[str] = set()
    waiting = {module}
    while waiting:
        found |= waiting
        waiting = {name for each in waiting for name in _imported(each)[1]} - found
    for name in sorted(found):
        digest.update(name.encode() + b"\0" + _imported(name)[0])
    return digest.hexdigest()[:16]


@cache
def _cache_folder(module: str) -> str:
    """Folder for a module's compiled kernels; empty where none can be written."""
    folder = _cache_root() / f"{module}-{source_digest(module)}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        os.utime(folder)
        others = sorted(
            folder.parent.glob(f"{module}-{'[0-9a-f]' * 16}"),
            key=lambda p: p.stat().st_mtime,
            reverse=True,
        )
        for old in others[KEPT_CACHES:]:
            shutil.rmtree(old, ignore_errors=True)
    except OSError:
        return ""  # Numba falls back to its own, or compiles each time
    return str(folder)


def _compile(function: Callable[..., Any], **flags: Any) -> Any:
    """Compile with a disk cache in the folder of the function's module."""
    package, _, module = function.__module__.partition("_kernels.")
    found = numba.config.CACHE_DIR
    if package == "adret.":
        numba.config.CACHE_DIR = _cache_folder(module) or found
    try:  # Numba reads the folder here, not when it compiles
        return numba.njit(cache=True, nogil=True, error_model="numpy", **flags)(function)
    finally:
        numba.config.CACHE_DIR = found


def _load_tbb() -> None:
    """Load the TBB library of the wheel, which the loader does not find in a virtual environment.

    Without it Numba falls back on OpenMP, whose threads spin while they wait: on a busy machine a
    sweep then takes many times as long.
    """
    with contextlib.suppress(metadata.PackageNotFoundError, OSError):
        for file in metadata.files("tbb") or ():
            if file.name in ("libtbb.so.12", "libtbb.12.dylib", "tbb12.dll"):
                ctypes.CDLL(str(file.locate()), mode=ctypes.RTLD_GLOBAL)


_load_tbb()
# The workqueue layer aborts the process when two threads enter a parallel kernel.
numba.config.THREADING_LAYER_PRIORITY = ["tbb", "omp", "workqueue"]

prange = numba.prange
index = numba.uintp  # an unsigned index cannot wrap round, so loops over it vectorise


def kernel(function: Callable[..., None]) -> Any:
    """Compile a serial kernel: cached on disk, releases the GIL."""
    return _compile(function, fastmath=FASTMATH)


def parallel_kernel(function: Callable[..., None]) -> Any:
    """Compile a kernel whose ``prange`` loops run on all threads."""
    return _compile(function, fastmath=FASTMATH, parallel=True)


def strict_kernel(function: Callable[..., None]) -> Any:
    """Compile a serial kernel whose arithmetic is rounded as written: no fused operations.

    For verdicts that must come out the same when two operands change places.
    """
    return _compile(function)


def strict_parallel_kernel(function: Callable[..., None]) -> Any:
    """Compile a kernel as `strict_kernel` does, with ``prange`` loops on all threads."""
    return _compile(function, parallel=True)


def inline(function: Callable[..., Any]) -> Any:
    """Compile a small helper into its callers."""
    return numba.njit(inline="always", fastmath=FASTMATH, error_model="numpy")(function)


@intrinsic
def greater(typingctx, a, b):  # type: ignore[no-untyped-def]
    """Return a if a > b, else b; so b where a is NaN.

    One machine instruction. A Python conditional would do, but LLVM turns ``c[x] = q if q > c[x]
    else c[x]`` into a masked store, which costs seven times as much on AMD Zen.
    """
    if a != b or not isinstance(a, types.Float):
        return None

    def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
        first, second = args
        return builder.select(builder.fcmp_ordered(">", first, second), first, second)

    return a(a, b), codegen


def threading_layer() -> str:
    """Name of the layer that runs parallel kernels; known once one has run."""
    return str(numba.threading_layer())


def threads(count: int | None = None) -> int:
    """Return the number of threads that kernels use, after setting it when `count` is given."""
    if count is not None:
        numba.set_num_threads(count)
    return int(numba.get_num_threads())
