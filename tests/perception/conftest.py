from pathlib import Path

import numpy as np
import pytest

from knotflow.perception import Camera, SimulatedCamera
from knotflow.simulation import RopeConfig


@pytest.fixture(scope="session")
def camera() -> Camera:
    return Camera.overhead(320, 240)


@pytest.fixture
def simulated(camera) -> SimulatedCamera:
    return SimulatedCamera(camera, RopeConfig(radius=0.008))


@pytest.fixture(scope="session")
def overhand():
    return np.loadtxt(Path(__file__).with_name("overhand.csv"), delimiter=",", skiprows=1)
