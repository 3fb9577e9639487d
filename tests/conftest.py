"""What tests of several rooms share."""

import numpy as np
import pytest

from knotflow.simulation import RopeSimulator, SimulationConfig


@pytest.fixture(scope="session")
def simulator():
    """The default simulator; building it is slower than using it."""
    return RopeSimulator(SimulationConfig(threads=2))


@pytest.fixture
def rng():
    return np.random.default_rng(7)
