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
import logging
import os
import platform
import re
import shutil
import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import cache, wraps
from importlib import metadata
from pathlib import Path
from typing import Any

import numba
from llvmlite import ir
from numba.core import caching, entrypoints, event, types
from numba.core.compiler_lock import global_compiler_lock
from numba.core.runtime import rtsys
from numba.extending import intrinsic

__all__ = [
    "array_parts",
    "first_rows",
    "greater",
    "helper",
    "index",
    "inline",
    "intrinsic",
    "ir",
    "kernel",
    "parallel_kernel",
    "prange",
    "shared_kernel",
    "strict_kernel",
    "strict_parallel_kernel",
    "tell_of_compilation",
    "threading_layer",
    "threads",
    "types",
    "without_extensions",
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
        _say_uncached(str(folder.parent))
        return ""
    return str(folder)


@cache
def _say_uncached(root: str) -> None:
    """Say once what the next start will cost as well."""
    text = "no folder for compiled kernels at %s (NUMBA_CACHE_DIR): every start compiles them"
    logging.getLogger("adret").warning(text, root)


class _Cache(caching.FunctionCache):
    """Numba's disk cache, less the half second for which it gets ready to compile.

    What was compiled before needs Numba's runtime, but none of the descriptions of types and
    functions that compilation goes by; Numba reads those by itself when it must compile.
    """

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Load what was compiled for a signature; None if nothing was."""
        rtsys.initialize(target_context)
        with self._guard_against_spurious_io_errors():
            return self._load_overload(sig, target_context)


def _compile(function: Callable[..., Any], **flags: Any) -> Any:
    """Compile with a disk cache in the folder of the function's module, if one can be written."""
    package, _, module = function.__module__.partition("_kernels.")
    found = numba.config.CACHE_DIR
    compiled = numba.njit(nogil=True, error_model="numpy", no_cfunc_wrapper=True, **flags)(function)
    for name in ("_compile_for_args", "typeof_pyval"):
        setattr(compiled, name, _one_at_a_time(getattr(compiled, name)))
    if package == "adret.":
        folder = _cache_folder(module)
        if not folder:  # Numba would look for a place of its own, and fail where there is none
            return compiled
        numba.config.CACHE_DIR = folder
    try:  # Numba reads the folder here, not when it compiles
        compiled._cache = _Cache(function)
        return compiled
    finally:
        numba.config.CACHE_DIR = found


def _one_at_a_time(method: Callable[..., Any]) -> Callable[..., Any]:
    """Call a method of a dispatcher under the compiler's lock.

    Numba takes that lock to compile, yet not while it loads other packages' extensions before, or
    looks up an argument's type: a thread that does so then reads the tables that another fills.
    """

    @wraps(method)
    def locked(*arguments: Any, **options: Any) -> Any:
        with global_compiler_lock:
            return method(*arguments, **options)

    return locked


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


def helper(function: Callable[..., Any]) -> Any:
    """Compile a function that kernels call and Python never does: quicker, and not kept on disk."""
    return numba.njit(
        error_model="numpy", fastmath=FASTMATH, no_cpython_wrapper=True, no_cfunc_wrapper=True
    )(function)


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


class _Shared:
    """A kernel that threads share: each call of the compiled one serves some of the rows."""

    def __init__(self, parts: Callable[..., int], function: Callable[..., None]) -> None:
        self.parts = parts
        self.compiled = kernel(function)
        self.__doc__, self.__name__ = function.__doc__, function.__name__
        self.__module__ = function.__module__

    def __call__(self, *arguments: Any) -> None:
        """Serve all parts on all threads, and return when they are done."""
        count = self.parts(*arguments)
        workers = min(threads(), count)
        if workers <= 1:
            self.compiled(0, count, *arguments)
            return
        size = -(-count // (workers * PARTS_A_THREAD))
        parts = iter(range(0, count, size))

        def work() -> None:
            for first in parts:  # one iterator for all: whoever is free takes the next part
                self.compiled(first, min(first + size, count), *arguments)

        others = [_pool().submit(work) for _ in range(workers - 1)]
        try:
            work()
        finally:
            failures = [other.exception() for other in others if not other.cancel()]
        for failure in failures:
            if failure is not None:
                raise failure


PARTS_A_THREAD = 4


@cache
def _pool() -> ThreadPoolExecutor:
    """The threads that kernels share, one fewer than this process may use."""
    most = max(int(numba.config.NUMBA_NUM_THREADS) - 1, 1)
    return ThreadPoolExecutor(most, thread_name_prefix="adret-kernel")


if hasattr(os, "register_at_fork"):  # a child has none of its parent's threads
    os.register_at_fork(after_in_child=_pool.cache_clear)


def shared_kernel(
    parts: Callable[..., int],
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Compile a serial kernel that threads share by rows, strips or other parts.

    The function takes the first of the parts that it serves, the one after the last, and then its
    arguments; what is returned is called with those arguments alone, and `parts` says of them how
    many parts there are. This compiles in half the time that `parallel_kernel` takes.
    """
    return lambda function: _Shared(parts, function)


def first_rows(array: Any, *_: Any) -> int:
    """As many parts as the first argument has rows."""
    return len(array)


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


def array_parts(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    """Pointer to the elements, strides and shape of an array, for intrinsics."""
    from numba.np.arrayobj import make_array  # slow to import, and needed to compile alone

    return make_array(kind)(context, builder, value)


def threading_layer() -> str:
    """Name of the layer that runs parallel kernels."""
    numba.get_num_threads()  # starts it
    return str(numba.threading_layer())


_chosen = threading.local()  # as Numba's own number: each thread has one


def threads(count: int | None = None) -> int:
    """Return the number of threads that kernels use, after setting it when `count` is given."""
    if count is not None:
        numba.set_num_threads(count)
        _chosen.count = count
    return int(getattr(_chosen, "count", numba.config.NUMBA_NUM_THREADS))


def without_extensions() -> None:
    """Let Numba load no other packages' extensions: for a process with Adret's kernels alone."""
    entrypoints._already_initialized = True


@contextlib.contextmanager
def tell_of_compilation(tell: Callable[[], None]) -> Iterator[None]:
    """Call `tell` once, when the first kernel is compiled and not loaded."""

    class Listener(event.Listener):  # type: ignore[misc]
        def on_start(self, event: Any) -> None:
            told.append(True)
            if len(told) == 1:
                tell()

        def on_end(self, event: Any) -> None:
            pass

    told: list[bool] = []
    listener = Listener()
    event.register("numba:compile", listener)
    try:
        yield
    finally:
        event.unregister("numba:compile", listener)
