"""Every method estimates the same ropes; ropes are chosen by their crossings."""

import numpy as np
import pandas as pd
import pytest

from knotflow.perception import SAMPLE, EstimateConfig, FitConfig
from knotflow.simulation import RopeConfig, straight
from knotflow.workflow import StageContext
from knotflow.workflow.stages.perception import (
    METHODS,
    TABLE,
    PerceptionConfig,
    choose_ropes,
    estimate_ropes,
)


@pytest.fixture
def ropes(tmp_path):
    """Straight ropes, the last of them half outside of the image, and an overhand."""
    line = straight(RopeConfig()) + [0.0, 0.03, 0.0]  # between two rows of pixels it is too thin
    overhand = np.loadtxt(SAMPLE / "overhand.csv", delimiter=",", skiprows=1)
    points = np.stack([line, line + [0.0, 0.1, 0.0], line + [0.6, 0.0, 0.0], overhand])
    np.savez(tmp_path / "ropes.npz", points=points.astype(np.float32), crossings=[0, 0, 0, 3])
    return tmp_path


def config(**changes):
    quick = EstimateConfig(fit=FitConfig(steps=5), candidates=1)
    given = {"estimate": quick, "levels": [0.0], "crossings": [0, 3], "ropes": 1, "seed": 1}
    return PerceptionConfig(**(given | changes))


def test_ropes_are_chosen_by_crossings_among_those_in_view(ropes):
    chosen = choose_ropes(config(crossings=[0], ropes=2), ropes / "ropes.npz")
    assert sorted(chosen) == [(0, 0), (0, 1)]
    assert all(points[:, 0].max() < 0.55 for points in chosen.values())
    with pytest.raises(ValueError, match="2 ropes of 0 crossings in the camera's view, but 3"):
        choose_ropes(config(crossings=[0], ropes=3), ropes / "ropes.npz")


def test_a_method_that_there_is_not_is_refused(ropes, tmp_path):
    with pytest.raises(ValueError, match="unknown methods.*guessing.*rendering"):
        estimate_ropes(config(methods=["guessing"]), {"ropes": ropes}, StageContext(tmp_path))


@pytest.mark.slow
def test_estimates_have_a_row_a_method_and_rope(ropes, tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    estimate_ropes(config(), {"ropes": ropes}, StageContext(out))
    table = pd.read_csv(out / TABLE)
    assert len(table) == 2 * len(METHODS)
    assert set(table["method"]) == set(METHODS)
    alone = table[table["method"] == "rendering"].set_index("crossings")
    assert alone.loc[0, "off_curve_error_mm"] < 5 and alone.loc[0, "state_correct"]
    assert (table["off_curve_error_mm"] <= table["mean_error_mm"] + 1e-6).all()
