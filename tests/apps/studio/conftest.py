"""What tests of the studio share."""

import pytest

from knotflow.samplers.demonstrations import NoiseConfig
from knotflow.simulation import RopeConfig, SimulationConfig
from knotflow.workflow import StageRun


@pytest.fixture
def imitated():
    """Trains a library by imitation of a file of demonstrations."""
    from knotflow.experiments.demonstrations import demonstrations
    from knotflow.experiments.training import imitation
    from knotflow.samplers.primitives import PrimitiveConfig, PrimitiveLibrary

    def train(file, folder, copies, copies_untangled, effort):
        simulated, trained = StageRun(folder / "simulated"), StageRun(folder / "trained")
        demonstrations(
            simulated,
            demonstrations_file=file,
            simulation=SimulationConfig(),
            noise=NoiseConfig(),
            copies=copies,
            copies_untangled=copies_untangled,
            seed=2,
        )
        imitation(
            trained,
            demonstrations=simulated.out,
            rope=RopeConfig(),
            primitive=PrimitiveConfig(),
            imitation_training=effort,
            training_seed=1,
        )
        return PrimitiveLibrary.load(trained.out / "primitives.safetensors")

    return train
