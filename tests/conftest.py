"""What tests of several rooms share."""

import numpy as np
import pytest
from joblib.externals.loky import get_reusable_executor

from knotflow.simulation import RopeSimulator, SimulationConfig


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
