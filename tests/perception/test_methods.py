"""Methods of estimation, their ropes and metrics."""

from dataclasses import replace

import numpy as np
import pytest

from knotflow.experiments import perception as experiment
from knotflow.experiments.perception import METHODS, choose_ropes, estimate_by, metrics
from knotflow.perception import SAMPLE, RopeEstimate, StrandNetwork
from knotflow.perception.estimation import estimate as estimation
from knotflow.perception.estimation.estimate import EstimateConfig
from knotflow.perception.estimation.fitting import FitConfig
from knotflow.perception.estimation.search import SearchConfig
from knotflow.simulation import RopeConfig, state_or_none, straight

from .shapes import CAMERA, ROPE, image, loop, s_curve, shape_error
from .test_network import TINY

QUICK = EstimateConfig(
    FitConfig(steps=25),
    search=SearchConfig(guesses=1, rounds=0),
    fallback_search=None,
    colour=False,
)
ASKED = CAMERA, ROPE, QUICK, StrandNetwork(TINY)


def knowing(monkeypatch, *guesses):
    """The network proposes these shapes (V, 3), metres, whatever it sees."""
    for module in (experiment, estimation):
        monkeypatch.setattr(module, "trace_rope", lambda *_: [*guesses])


@pytest.mark.slow
def test_best_of_traced_and_network_guesses_is_kept(monkeypatch):
    seen = image(s_curve())
    traced = estimate_by("full_without_network", seen, *ASKED)
    for off in (0.0, 0.1):
        knowing(monkeypatch, s_curve() + [0.0, off, 0.0])
        both = estimate_by("full", seen, *ASKED)
        assert both.coverage_fraction >= traced.coverage_fraction
        assert shape_error(both.points, s_curve()) < 8e-3


def test_network_rendering_fits_the_likeliest_guess(monkeypatch):
    knowing(monkeypatch, s_curve() + [0.0, 0.004, 0.0], loop(1))
    found = estimate_by("network_rendering", image(s_curve(), head=True), *ASKED)
    assert found.head_known and shape_error(found.points, s_curve()) < 3e-3
    knowing(monkeypatch)
    assert estimate_by("network_rendering", image(s_curve()), *ASKED) is None


def test_ablations_leave_out_one_part(monkeypatch):
    seen = []
    monkeypatch.setattr(experiment, "estimate", lambda *args, **_: seen.append(args[-1]))
    knowing(monkeypatch, s_curve())
    asked = CAMERA, ROPE, replace(QUICK, colour=True), StrandNetwork(TINY)
    for method in METHODS:
        estimate_by(method, image(s_curve()), *asked)
    assert [one.fit.depth for one in seen] == [1.0, 1.0, 1.0, 1.0, 0.0]
    assert [one.proposals for one in seen] == [12, 12, 12, 0, 12]
    assert [one.colour for one in seen] == [True, True, False, True, True]


def test_no_rope_is_no_estimate():
    empty = image(s_curve())
    empty.rgb[:], empty.depth[:] = 60, CAMERA.position[2]
    assert estimate_by("full", empty, *ASKED) is None


@pytest.fixture
def ropes(tmp_path):
    """A file of straight ropes, the last of them half outside of the image, and an overhand."""
    line = straight(RopeConfig())
    overhand = np.loadtxt(SAMPLE / "overhand.csv", delimiter=",", skiprows=1)
    points = np.stack([line, line + [0.0, 0.1, 0.0], line + [0.6, 0.0, 0.0], overhand])
    np.savez(
        tmp_path / "ropes.npz",
        points=points.astype(np.float32),
        crossings=[0, 0, 0, 3],
        diameters=[0.008] * 4,
    )
    return tmp_path / "ropes.npz"


def test_choose_ropes(ropes, capsys):
    chosen = choose_ropes(ropes, [0], 2, RopeConfig(), CAMERA, seed=1)
    assert sorted(chosen) == ["0-0", "0-1"]
    assert all(points[:, 0].max() < 0.55 for points, _ in chosen.values())
    assert {rope.radius for _, rope in chosen.values()} == {0.004}
    assert len(choose_ropes(ropes, [0], 3, RopeConfig(), CAMERA, seed=1)) == 2
    assert "only 2 ropes of 0 crossings" in capsys.readouterr().out
    with pytest.raises(ValueError, match="no rope of 4 crossings in the camera's view"):
        choose_ropes(ropes, [4], 1, RopeConfig(), CAMERA, seed=1)


def test_metrics_without_estimate():
    found = metrics(None, straight(RopeConfig()))
    assert np.isnan(found["mean_error_mm"]) and found["doubtful"]
    assert not found["state_correct"] and not found["head_correct"]


def test_off_curve_error_ignores_sliding():
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
