"""The `adret` command.

Nothing heavy is imported before a command runs. Wrong input ends with one line on standard error
that names field, limit and value, exit code 2, and no file.
"""

import gc
import logging
import os
import signal
import sys
from collections.abc import Sequence
from importlib import import_module
from types import FrameType
from typing import Any

from adret.errors import AdretError, Cancelled, InputError

__all__ = ["main"]

COMMANDS = (
    "info",
    "horizon",
    "sky",
    "openness",
    "shadow",
    "light",
    "bounce",
    "viewshed",
    "visibility",
    "ssao",
    "plan",
    "batch",
)
# Commands that compute one file and end.
PRODUCTS = frozenset(COMMANDS) - {"info", "plan", "batch"}
# Commands that other packages bring, and the extra that installs them.
SERVING = ("serve", "worker", "keys", "tile-worker")
USING = ("login", "upload", "run", "jobs", "watch", "cancel", "fetch")
EXTRAS = dict.fromkeys((*SERVING, *USING), "service")
GROUP = "adret.commands"
INTERRUPTED = 130

HELP = """How light falls on a height field: horizons, sky view, shadows and light from elevation
models.

Examples:

\b
  adret info dem.tif
  adret horizon dem.tif horizon.tif --directions 64
  adret light dem.tif lit.tif --sun 315,35 --sky uniform --preview lit.png

Directions are degrees clockwise from grid north. `adret COMMAND --help` shows all options.
"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command and return the exit code.

    0 done; 2 wrong input; 1 the machine failed (full disk, too little memory); 130 interrupted.
    Without `arguments` those of the process are taken, and a product's command ends the process.
    """
    given = list(sys.argv[1:] if arguments is None else arguments)
    alone = arguments is None and _asked(given) in PRODUCTS
    if alone:
        gc.disable()  # imports make much and leave nothing; `running` enables it again
    logging.getLogger("rasterio").addHandler(logging.NullHandler())
    previous = signal.signal(signal.SIGTERM, _terminate)
    try:
        code = _run(given)
        if alone:
            _leave(code)
        return code
    except AdretError as error:
        return _stop(error)
    except KeyboardInterrupt:
        return _say("interrupted", INTERRUPTED)
    except MemoryError:
        return _say("memory: must be enough for this raster, got too little", 1)
    except OSError as error:
        where = f" ({error.filename})" if error.filename else ""
        return _say(f"{error.strerror or error}{where}", 1)
    finally:
        if alone:
            gc.enable()
        signal.signal(signal.SIGTERM, previous)


def _run(given: list[str]) -> int:
    import typer

    app = typer.Typer(
        name="adret",
        help=HELP,
        add_completion=False,
        no_args_is_help=True,
        rich_markup_mode=None,
        pretty_exceptions_enable=False,
    )
    app.callback()(_root)
    asked = _asked(given)
    # Typer describes every command that it has before it runs one.
    for name in (asked,) if asked in COMMANDS else COMMANDS:
        import_module(f"adret.cli.{name}").register(app)
    try:
        known = _register_others(app, asked)
        code = app(given, standalone_mode=False)
    except ImportError as error:
        if asked not in EXTRAS:
            raise
        raise InputError(asked, _install(asked), f"no module {error.name}") from None
    except Exception as error:
        # Typer's errors of usage; their class moved between its versions.
        if not hasattr(error, "format_message"):
            raise
        if asked in EXTRAS and not known:
            raise InputError("command", _install(asked), asked) from None
        return _usage(error)
    if code == INTERRUPTED:
        raise KeyboardInterrupt
    return code if isinstance(code, int) else 0


def _asked(given: list[str]) -> str | None:
    return next((word for word in given if not word.startswith("-")), None)


def _leave(code: int) -> None:
    """End the process at once: what it holds need not be taken down piece by piece."""
    logging.shutdown()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)


def _root() -> None:
    """Do nothing: it carries the help text and makes every command a sub-command."""


def _register_others(app: Any, asked: str | None) -> bool:
    """Let installed packages add their commands; tell if the one asked for is known."""
    if asked in COMMANDS:
        return True
    from importlib import metadata

    entries = [e for e in metadata.entry_points(group=GROUP) if asked in (None, e.name)]
    for entry in entries:
        entry.load()(app)
    return bool(entries)


def _install(command: str) -> str:
    return f'installed with pip install "adret[{EXTRAS[command]}]"'


def _usage(error: Any) -> int:
    kind = type(error).__name__
    if kind == "NoArgsIsHelpError":
        print(error.format_message())
        return 2
    if kind == "MissingParameter" and error.param is not None:
        argument = error.param.param_type_name == "argument"
        name = (argument and error.param.metavar) or error.param.name  # an option by its name
        return _say(f"{name}: must be given, got nothing", 2)
    if kind == "NoSuchOption":
        return _say(f"option: must be one of those in --help, got {error.option_name!r}", 2)
    return _say(" ".join(str(error.format_message()).split()), 2)


def _stop(error: AdretError) -> int:
    if isinstance(error, Cancelled):
        return _say(str(error) or "interrupted", INTERRUPTED)
    if isinstance(error, InputError) and error.field.endswith("_deg"):
        error = InputError(error.field.removesuffix("_deg"), error.limit, error.value)
    return _say(" ".join(str(error).split()), 2)


def _say(message: str, code: int) -> int:
    print(f"adret: {message}", file=sys.stderr)
    return code


def _terminate(number: int, frame: FrameType | None) -> None:
    """Leave like after Ctrl-C, so that unfinished files go."""
    raise SystemExit(128 + number)
