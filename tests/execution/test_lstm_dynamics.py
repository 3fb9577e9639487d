"""Training lowers the error, and continues from a checkpoint as if it had not been interrupted."""

import pytest

from knotflow.execution import DynamicsTrainer, DynamicsTrainingConfig, LstmConfig, Motions
from knotflow.execution.lstm_dynamics import LstmDynamics
from knotflow.perception.networks.network import SHIPPED_NETWORK

SMALL = DynamicsTrainingConfig(
    network=LstmConfig(hidden=12),
    validations=4,
    steps=10,
    batch=8,
    horizon=2,
    learning_rate=1e-2,
)


@pytest.mark.slow
def test_training_lowers_the_error(motions):
    history = list(DynamicsTrainer(motions, SMALL, seed=0))
    assert len(history) == SMALL.validations
    assert history[-1]["error_mm"] < 0.9 * history[0]["error_mm"]
    assert set(history[0]) == {"step", "error_mm", *(f"validation_{n}_mm" for n in (1, 10, 25))}


@pytest.mark.slow
def test_held_out_motions_are_not_trained_on(motions):
    other = Motions(**vars(motions) | {"points": motions.points.copy()})
    other.points[-1] += 1.0  # one of eight is held out
    one, same = (next(iter(DynamicsTrainer(some, SMALL, seed=0))) for some in (motions, other))
    assert one["error_mm"] == same["error_mm"]
    assert one["validation_1_mm"] != same["validation_1_mm"]


def test_motions_of_another_rope_are_refused(motions):
    config = DynamicsTrainingConfig(network=LstmConfig(links=32))
    with pytest.raises(ValueError, match="33 vertices"):
        DynamicsTrainer(motions, config, seed=0)


def test_a_file_of_other_weights_is_named(tmp_path):
    (tmp_path / "junk.safetensors").write_text("junk")
    for path, told in (
        (SHIPPED_NETWORK, "holds no LSTM dynamics"),
        (tmp_path / "junk.safetensors", "no safetensors file"),
        (tmp_path / "none.safetensors", "missing"),
    ):
        with pytest.raises(ValueError, match=f"{path.name}: .*{told}"):
            LstmDynamics.load(path)
