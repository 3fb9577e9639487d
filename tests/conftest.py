"""What tests of several rooms share."""

import numpy as np
import pytest
from joblib.externals.loky import get_reusable_executor

from knotflow.simulation import RopeSimulator, SimulationConfig


def pytest_collection_modifyitems(items):
    """Slow files first, so that the last ones spread evenly over the workers."""
    slow = {item.path for item in items if item.get_closest_marker("slow")}
    items.sort(key=lambda item: item.path not in slow)


@pytest.fixture(scope="session")
def simulator():
    """The default simulator; building it is slower than using it."""
    return RopeSimulator(SimulationConfig(threads=2))


@pytest.fixture(scope="session", autouse=True)
def no_worker_outlives_the_tests():
    """loky's idle workers live on for minutes, and the interpreter may wait for them at its end."""
    yield
    get_reusable_executor(reuse=True).shutdown(wait=True, kill_workers=True)


@pytest.fixture
def rng():
    return np.random.default_rng(7)
