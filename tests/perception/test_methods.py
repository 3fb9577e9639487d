"""Methods differ in where an estimate starts and what it does then."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from knotflow.perception.estimation.estimate import EstimateConfig, estimate, propose
from knotflow.perception.estimation.fitting import FitConfig
from knotflow.perception.estimation.search import SearchConfig
from knotflow.perception.methods import METHODS, SELF_SUPERVISED, SUPERVISED
from knotflow.perception.networks.network import Network
from knotflow.topology import TopologicalState

from .shapes import CAMERA, ROPE, image, s_curve
from .test_network import knowing, shape_error

QUICK = EstimateConfig(
    FitConfig(steps=2), search=SearchConfig(guesses=1, rounds=0), fallback_search=None
)
NEAR = 0.015
"""Metres; a network that knows a shape knows five nodes of it."""


def test_a_proposal_is_the_networks_guess_with_its_state_and_head():
    truth = s_curve()
    seen = image(truth, head=True)
    for guess in (truth, truth[::-1]):
        found = propose(seen, CAMERA, ROPE, knowing(guess), QUICK)
        assert found.head_known and found.crossings == ()
        assert np.linalg.norm(found.points - truth, axis=1).mean() < NEAR
        assert found.state == TopologicalState.trivial()


def test_a_proposal_that_does_not_account_for_the_image_is_in_doubt():
    found = propose(image(s_curve()), CAMERA, ROPE, knowing(s_curve(), off=0.1), QUICK)
    assert found.ambiguous and found.coverage_fraction < 0.5


@pytest.mark.slow
def test_a_networks_guess_is_one_more_and_the_best_counts():
    seen = image(s_curve())
    traced = estimate(seen, CAMERA, ROPE, config=QUICK)
    for off in (0.0, 0.1):
        both = estimate(seen, CAMERA, ROPE, config=QUICK, network=knowing(s_curve(), off))
        assert both.coverage_fraction >= traced.coverage_fraction
        assert shape_error(both.points, s_curve()) < 8e-3


@pytest.mark.slow
def test_strands_are_followed_unless_a_method_leaves_them_out():
    class Asked(Exception):
        pass

    class Strands(torch.nn.Module):
        def forward(self, windows, height):
            raise Asked

    networks = {SELF_SUPERVISED: Network(knowing(s_curve()).model, Strands())}
    asked = image(s_curve()), CAMERA, ROPE, QUICK, networks, s_curve(), np.random.default_rng(0)
    with pytest.raises(Asked):
        METHODS["network_tracing_rendering"].estimate(*asked)
    METHODS["network_tracing_rendering_without_strands"].estimate(*asked)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "near"),
    [
        ("network_without_strands", True),
        ("network_without_strands_self_supervision", False),
        ("network_rendering_without_strands", True),
        ("network_rendering_without_strands_self_supervision", False),
    ],
)
def test_each_method_starts_from_its_network(name, near):
    networks = {SELF_SUPERVISED: knowing(s_curve()), SUPERVISED: knowing(s_curve(), off=0.05)}
    found = METHODS[name].estimate(
        image(s_curve()), CAMERA, ROPE, QUICK, networks, s_curve(), np.random.default_rng(0)
    )
    assert (shape_error(found.points, s_curve()) < NEAR) == near


@pytest.mark.slow
def test_a_method_without_depth_does_not_look_at_it():
    seen = image(s_curve())
    other = replace(seen, depth=seen.depth.copy())
    other.depth[seen.rgb[..., 0] > 100] -= 0.004
    given = (CAMERA, ROPE, QUICK, {}, s_curve())
    poor = METHODS["rendering_poor_start"]
    for depth in (True, False):
        method = replace(poor, depth=depth)
        heights = [
            method.estimate(one, *given, np.random.default_rng(0)).points[:, 2].mean()
            for one in (seen, other)
        ]
        assert np.isclose(*heights, atol=1e-5) != depth
