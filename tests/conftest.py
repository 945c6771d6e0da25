"""What every test can ask for: the data folder, example files, reproducible random cases."""

import os
import signal
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, settings

collect_ignore = ["conftest.py"]  # no examples in it; collected again, it clashes with those below

REPOSITORY = Path(__file__).resolve().parents[1]

settings.register_profile(
    "repeatable",
    deadline=None,  # the first example pays for compilation
    derandomize=True,
    max_examples=60,
    suppress_health_check=[HealthCheck.too_slow],
)
# HYPOTHESIS_PROFILE=search looks for new counter-examples for some minutes.
settings.register_profile(
    "search", settings.get_profile("repeatable"), derandomize=False, max_examples=2000
)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "repeatable"))

# A shell that starts the tests in the background has children ignore Ctrl-C, which some tests send.
signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(autouse=True, scope="session")
def nothing_said_of_compilation() -> Iterator[None]:
    """Commands that tests run in this process say the same whether kernels are new or not."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("adret.cli.running.say_compiling", lambda: None)
        yield


@pytest.fixture(scope="session")
def data_dir() -> Path:
    """Folder of real rasters and published truth: $ADRET_DATA, then ../shared/data."""
    named = os.environ.get("ADRET_DATA")
    for folder in [Path(named)] if named else [REPOSITORY.parent / "shared" / "data"]:
        if (folder / "MANIFEST.md").is_file():
            return folder
    pytest.skip("the data folder is not here: set ADRET_DATA to it")


@pytest.fixture(scope="session")
def example_dem() -> Path:
    """The mountain DEM that ships with the repository."""
    path = REPOSITORY / "examples" / "data" / "alpine_aletsch_dhm200_lv95_200m.tif"
    if not path.is_file():
        pytest.skip(f"{path.relative_to(REPOSITORY)} is not in this checkout")
    return path


@pytest.fixture
def rng() -> np.random.Generator:
    """A generator with a fixed seed, new for each test."""
    return np.random.default_rng(20_240_607)
