"""Which process goes first where several want the same cores: whoever a client waits for."""

import contextlib
import os
from pathlib import Path

__all__ = ["step_back"]

GROUP = Path("/proc/self/autogroup")


def step_back(nice: int, *, session: bool = False) -> None:
    """Let other processes go first, on the scale of ``nice``.

    Parameters
    ----------
    nice : int
        0, which changes nothing, to 19.
    session : bool
        Whether this process has a session of its own, all of which is to step back. Linux may share
        the cores among sessions first (``sched_autogroup_enabled``); within one, a process's number
        counts only against the others of its session.
    """
    if nice and session:
        with contextlib.suppress(OSError):  # another system, or one that does not group
            GROUP.write_text(str(nice))
    elif nice and hasattr(os, "nice"):
        os.nice(nice)
