"""Methods of estimation, their ropes and metrics."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from knotflow.experiments import perception as experiment
from knotflow.experiments.perception import METHODS, choose_ropes, metrics
from knotflow.perception import SAMPLE, RopeEstimate
from knotflow.perception.estimation.estimate import EstimateConfig, estimate, propose
from knotflow.perception.estimation.fitting import FitConfig
from knotflow.perception.estimation.search import SearchConfig
from knotflow.perception.networks.network import Network
from knotflow.simulation import RopeConfig, state_or_none, straight
from knotflow.topology import TopologicalState

from .shapes import CAMERA, ROPE, image, s_curve
from .test_network import knowing, shape_error

QUICK = EstimateConfig(
    FitConfig(steps=2), search=SearchConfig(guesses=1, rounds=0), fallback_search=None
)
NEAR = 0.015
"""Metres; a network that knows a shape knows five nodes of it."""


def test_propose_returns_network_guess():
    truth = s_curve()
    seen = image(truth, head=True)
    for guess in (truth, truth[::-1]):
        found = propose(seen, CAMERA, ROPE, knowing(guess))
        assert found.head_known and found.crossings == ()
        assert np.linalg.norm(found.points - truth, axis=1).mean() < NEAR
        assert found.state == TopologicalState.trivial()


def test_proposal_of_low_coverage_is_ambiguous():
    found = propose(image(s_curve()), CAMERA, ROPE, knowing(s_curve(), off=0.1))
    assert found.ambiguous and found.coverage_fraction < 0.5


@pytest.mark.slow
def test_best_of_traced_and_network_guesses_is_kept():
    seen = image(s_curve())
    traced = estimate(seen, CAMERA, ROPE, config=QUICK)
    for off in (0.0, 0.1):
        both = estimate(seen, CAMERA, ROPE, config=QUICK, network=knowing(s_curve(), off))
        assert both.coverage_fraction >= traced.coverage_fraction
        assert shape_error(both.points, s_curve()) < 8e-3


@pytest.mark.slow
def test_method_without_strands():
    class Asked(Exception):
        pass

    class Strands(torch.nn.Module):
        def forward(self, windows, height):
            raise Asked

    asked = image(s_curve()), CAMERA, ROPE, QUICK, Network(knowing(s_curve()).model, Strands())
    for method in ("network", "network_rendering", "full"):
        with pytest.raises(Asked):
            METHODS[method].estimate(*asked)
    METHODS["full_without_strands"].estimate(*asked)


@pytest.mark.slow
def test_network_rendering_fits_the_likeliest_guess():
    asked = (
        image(s_curve()),
        CAMERA,
        ROPE,
        replace(QUICK, fit=FitConfig(steps=25)),
        knowing(s_curve()),
    )
    errors = [
        shape_error(METHODS[method].estimate(*asked).points, s_curve())
        for method in ("network", "network_rendering")
    ]
    assert errors[1] < errors[0] < NEAR


def test_method_without_depth(monkeypatch):
    seen = []
    monkeypatch.setattr(experiment, "estimate", lambda *_, config, **__: seen.append(config))
    for method in ("full", "full_without_depth"):
        METHODS[method].estimate(image(s_curve()), CAMERA, ROPE, QUICK, knowing(s_curve()))
    assert [one.fit.depth for one in seen] == [1.0, 0.0]


@pytest.fixture
def ropes(tmp_path):
    """A file of straight ropes, the last of them half outside of the image, and an overhand."""
    line = straight(RopeConfig())
    overhand = np.loadtxt(SAMPLE / "overhand.csv", delimiter=",", skiprows=1)
    points = np.stack([line, line + [0.0, 0.1, 0.0], line + [0.6, 0.0, 0.0], overhand])
    np.savez(tmp_path / "ropes.npz", points=points.astype(np.float32), crossings=[0, 0, 0, 3])
    return tmp_path / "ropes.npz"


def test_choose_ropes(ropes, capsys):
    chosen = choose_ropes(ropes, [0], 2, RopeConfig(), seed=1)
    assert sorted(chosen) == ["0-0", "0-1"]
    assert all(points[:, 0].max() < 0.55 for points in chosen.values())
    assert len(choose_ropes(ropes, [0], 3, RopeConfig(), seed=1)) == 2
    assert "only 2 ropes of 0 crossings" in capsys.readouterr().out
    with pytest.raises(ValueError, match="no rope of 4 crossings in the camera's view"):
        choose_ropes(ropes, [4], 1, RopeConfig(), seed=1)


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
