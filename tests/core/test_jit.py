import os
import re
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
from numba.core.compiler_lock import global_compiler_lock

from adret._kernels import jit

SOURCES = sorted(p for p in jit.KERNELS.rglob("*.py") if p.name != "__init__.py")


def test_every_import_among_kernels_has_the_form_that_the_digest_follows() -> None:
    for source in SOURCES:
        text = source.read_text()
        for line in text.splitlines():
            if re.match(r"\s*(from|import) ", line) and ("_kernels" in line or "from ." in line):
                assert jit.IMPORT.match(line), f"{source.name}: {line}"


def test_a_digest_changes_with_the_module_and_with_what_it_imports_only(
    tmp_path: Path, monkeypatch
) -> None:
    files = {
        "top.py": "from adret._kernels.middle import m\n",
        "middle.py": "from adret._kernels.leaf import x\nfrom adret._kernels.top import t\n",
        "leaf.py": "x = 1\n",
        "other.py": "y = 1\n",
    }
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    monkeypatch.setattr(jit, "KERNELS", tmp_path)

    def digests() -> dict[str, str]:
        jit._imported.cache_clear(), jit.source_digest.cache_clear()
        return {name: jit.source_digest(name) for name in ("top", "middle", "leaf", "other")}

    before = digests()
    (tmp_path / "leaf.py").write_text("x = 2\n")
    after = digests()
    monkeypatch.undo()
    jit._imported.cache_clear(), jit.source_digest.cache_clear()
    assert {name for name in before if before[name] != after[name]} == {"top", "middle", "leaf"}


def test_the_cache_folder_of_the_callers_own_numba_code_is_left_alone() -> None:
    import numba

    assert "adret" not in (numba.config.CACHE_DIR or "")


def test_without_a_folder_to_write_kernels_are_compiled_and_one_line_says_so() -> None:
    code = (
        "import numpy as np\n"
        "from adret._kernels import normals\n"
        "from adret._kernels.jit import _compile\n"
        "def twice(x):\n"
        "    return 2.0 * x\n"
        "twice.__module__ = 'adret._kernels.normals'\n"
        "print(_compile(twice)(21.0))"
    )
    places = {"XDG_CACHE_HOME": "/proc/nonexistent", "HOME": "/proc/nonexistent"}
    kept = {k: v for k, v in os.environ.items() if k != "NUMBA_CACHE_DIR"}
    done = subprocess.run(
        [sys.executable, "-c", code], env=kept | places, capture_output=True, text=True
    )
    assert (done.returncode, done.stdout) == (0, "42.0\n"), done.stderr
    lines = done.stderr.splitlines()
    assert len(lines) == 1
    assert "/proc/nonexistent/adret/numba" in lines[0]
    assert "NUMBA_CACHE_DIR" in lines[0]


def test_types_are_looked_up_and_kernels_compiled_by_one_thread_at_a_time() -> None:
    """Numba fills the tables of types while it loads extensions, outside of its own lock."""

    def twice(number, out):  # type: ignore[no-untyped-def]
        out[0] = 2 * number[0]

    kernel, out, done = jit.kernel(twice), np.zeros(1), threading.Event()

    def call() -> None:
        kernel((3.0, "unseen"), out)
        done.set()

    hook = kernel._compilation_chain_init_hook
    loaded = threading.Event()
    kernel._compilation_chain_init_hook = lambda: (loaded.set(), hook())
    with global_compiler_lock:
        other = threading.Thread(target=call)
        other.start()
        assert not done.wait(0.3)
        assert not loaded.is_set()
    other.join()
    assert loaded.is_set()
    assert out[0] == 6.0
