"""Which ropes are looked at, and how far an estimate is off."""

import numpy as np
import pytest

from knotflow.perception import SAMPLE, RopeEstimate
from knotflow.perception.methods import choose_ropes, metrics
from knotflow.simulation import RopeConfig, state_or_none, straight


@pytest.fixture
def ropes(tmp_path):
    """A file of straight ropes, the last of them half outside of the image, and an overhand."""
    line = straight(RopeConfig())
    overhand = np.loadtxt(SAMPLE / "overhand.csv", delimiter=",", skiprows=1)
    points = np.stack([line, line + [0.0, 0.1, 0.0], line + [0.6, 0.0, 0.0], overhand])
    np.savez(tmp_path / "ropes.npz", points=points.astype(np.float32), crossings=[0, 0, 0, 3])
    return tmp_path / "ropes.npz"


def test_ropes_are_chosen_by_crossings_among_those_in_view(ropes, capsys):
    chosen = choose_ropes(ropes, [0], 2, RopeConfig(), seed=1)
    assert sorted(chosen) == [(0, 0), (0, 1)]
    assert all(points[:, 0].max() < 0.55 for points in chosen.values())
    assert len(choose_ropes(ropes, [0], 3, RopeConfig(), seed=1)) == 2
    assert "only 2 ropes of 0 crossings" in capsys.readouterr().out
    with pytest.raises(ValueError, match="no rope of 4 crossings in the camera's view"):
        choose_ropes(ropes, [4], 1, RopeConfig(), seed=1)


def test_what_was_not_found_is_doubtful_and_right_in_nothing():
    found = metrics(None, straight(RopeConfig()))
    assert np.isnan(found["mean_error_mm"]) and found["doubtful"]
    assert not found["state_correct"] and not found["head_correct"]


def test_sliding_along_the_rope_is_no_error_off_the_curve():
    # A vertex of the true rope is on its curve, and so is the middle of a link; beside it is not.
    truth = straight(RopeConfig())
    middles = (truth[:-1] + truth[1:]) / 2
    slid = np.concatenate([middles, truth[-1:]])
    link = 1e3 * np.linalg.norm(truth[1] - truth[0])
    for points, error, off in (
        (truth, 0, 0),
        (slid, link / 2 * (1 - 1 / len(truth)), 0),
        (truth + [0, 0.003, 0.004], 5, 5),
    ):
        visible = np.ones(len(truth), bool)
        found = metrics(
            RopeEstimate(points, visible, state_or_none(points), (), 1.0, True, ()),
            truth,
        )
        assert found["mean_error_mm"] == pytest.approx(error, abs=1e-3)
        assert found["off_curve_error_mm"] == pytest.approx(off, abs=1e-3)
