"""DELETE stops the work in the middle of a large kernel, and leaves nothing behind."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks" / "service"))

from cancels import measure


@pytest.mark.slow
def test_a_dismissed_job_leaves_the_processor_within_half_a_second() -> None:
    figures = measure(repeat=10, side=3000)
    assert figures["seconds"]["max"] < 0.5, figures
    assert figures["processes_left"] == 0
    assert figures["busy_afterwards"] == []
    first, last = figures["threads_after_first_and_last"]
    assert last <= first
