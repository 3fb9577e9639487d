"""Every method estimates the same ropes; ropes are chosen by their crossings."""

import numpy as np
import pandas as pd
import pytest

from knotflow.perception import SAMPLE, EstimateConfig, FitConfig, Network, NetworkError
from knotflow.perception.coarse_to_fine import CoarseToFine
from knotflow.perception.methods import METHODS, SELF_SUPERVISED, SUPERVISED
from knotflow.perception.searching import SearchConfig
from knotflow.perception.training_config import CoarseToFineConfig
from knotflow.simulation import RopeConfig, straight
from knotflow.workflow import StageContext
from knotflow.workflow.stages.perception import (
    TABLE,
    PerceptionConfig,
    estimate_ropes,
)
from knotflow.workflow.stages.perception_networks import weights_file


@pytest.fixture
def ropes(tmp_path):
    """Straight ropes, the last of them half outside of the image, and an overhand."""
    line = straight(RopeConfig())  # between two rows of pixels
    overhand = np.loadtxt(SAMPLE / "overhand.csv", delimiter=",", skiprows=1)
    points = np.stack([line, line + [0.0, 0.1, 0.0], line + [0.6, 0.0, 0.0], overhand])
    np.savez(tmp_path / "ropes.npz", points=points.astype(np.float32), crossings=[0, 0, 0, 3])
    return tmp_path


@pytest.fixture
def networks(tmp_path):
    """Untrained networks."""
    folder = tmp_path / "networks"
    folder.mkdir()
    network = Network(CoarseToFine(CoarseToFineConfig(32, (8, 16, 16), (5, 9, 41), 16, 1)))
    for name in (SUPERVISED, SELF_SUPERVISED):
        network.save(folder / weights_file(name))
    return folder


def config(**changes):
    quick = EstimateConfig(FitConfig(steps=5), search=SearchConfig(first=1, rounds=0), wider=None)
    given = {"estimate": quick, "levels": [0.0], "crossings": [0, 3], "ropes": 1, "seed": 1}
    return PerceptionConfig(**(given | changes))


def test_a_method_that_there_is_not_is_refused(ropes, tmp_path):
    with pytest.raises(ValueError, match="unknown methods.*guessing.*rendering"):
        estimate_ropes(
            config(methods=["guessing"]),
            {"ropes": ropes, "networks": tmp_path},
            StageContext(tmp_path),
        )


@pytest.mark.slow
def test_methods_that_need_a_network_are_left_out_while_there_is_none(ropes, tmp_path, capsys):
    out = tmp_path / "out"
    out.mkdir()
    given = {"ropes": ropes, "networks": tmp_path}
    some = config(methods=["rendering_poor_start", "network"], crossings=[0], levels=[0.0, 1.0])
    estimate_ropes(some, given, StageContext(out))
    table = pd.read_csv(out / TABLE)
    assert set(table["method"]) == {"rendering_poor_start"} and set(table["noise"]) == {1.0}
    assert "not run, as there is no network: network" in capsys.readouterr().out
    with pytest.raises(NetworkError, match="perception_training trains one"):
        estimate_ropes(config(methods=["network"]), given, StageContext(out))


@pytest.mark.slow
def test_estimates_have_a_row_a_method_and_rope(ropes, networks, tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    given = {"ropes": ropes, "networks": networks}
    estimate_ropes(config(crossings=[0], ropes=2, levels=[1.0]), given, StageContext(out))
    table = pd.read_csv(out / TABLE)
    assert (out / "estimates.png").exists() and (out / "estimates.svg").exists()
    assert len(table) == 2 * len(METHODS)
    assert set(table["method"]) == set(METHODS)
    of = dict(iter(table.groupby("method")))
    assert (of["rendering"]["off_curve_error_mm"] < 5).all()
    assert of["rendering"]["state_correct"].all()
    # What was not trained is wrong, and says so, until rendering mends it.
    assert (of["network"]["mean_error_mm"] > 20).all() and of["network"]["doubtful"].all()
    assert (of["network_tracing_rendering"]["off_curve_error_mm"] < 5).all()
    assert table["rope_iou"].between(0.7, 1).all()
    assert (table["off_curve_error_mm"] <= table["mean_error_mm"] + 1e-6).all()
