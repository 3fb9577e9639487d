"""Every state can be drawn, and the drawing tells the state."""

from __future__ import annotations

import random

import numpy as np
import pytest

import knotflow.topology.draw as draw_module
from knotflow.topology import TopologicalState, knot
from knotflow.topology.curve import project
from knotflow.topology.draw import draw


@pytest.mark.slow
def test_states_survive_drawing(states_by_crossings):
    sample = random.Random(0).sample(sorted(states_by_crossings[3]), 60)
    for state in [
        *states_by_crossings[0],
        *states_by_crossings[1],
        *states_by_crossings[2],
        *sample,
    ]:
        assert TopologicalState.from_curve(draw(state)) == state


@pytest.mark.parametrize("crossings", [5, 7, 10])
def test_random_larger_states_survive_drawing(random_state, crossings):
    for seed in range(2):
        state = random_state(crossings, seed)
        assert TopologicalState.from_curve(draw(state)) == state


def test_length_heights_and_place():
    points = draw(min(knot("overhand")), length=2.0, gap=0.03)
    assert points.shape == (4 * 8 * 7 + 1, 3)
    assert np.linalg.norm(np.diff(points[:, :2], axis=0), axis=1).sum() == pytest.approx(2.0)
    np.testing.assert_allclose(points[:, :2].min(axis=0) + points[:, :2].max(axis=0), 0, atol=1e-9)
    assert points[0, 2] == points[-1, 2] == 0.0
    crossings = project(points)
    assert crossings.heights.max() == pytest.approx(0.03, rel=0.02)
    assert crossings.heights.min() == pytest.approx(0.0, abs=0.001)


def test_drawings_are_rounded_and_roomy():
    for name in ("overhand", "figure_eight", "pentagram"):
        points = draw(min(knot(name)))
        steps = np.diff(points[:, :2], axis=0)
        heading = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
        assert np.abs(np.diff(heading)).max() < np.radians(15)
        assert np.diff(project(points).segment_intervals).min() > 0.04


def test_the_same_state_gives_the_same_drawing():
    state = min(knot("pentagram"))
    np.testing.assert_array_equal(draw(state), draw(TopologicalState.parse(str(state))))


def test_wrong_sizes_are_refused():
    for wrong in ({"length": 0.0}, {"gap": -1.0}, {"samples": 0}):
        with pytest.raises(ValueError, match="must be above 0"):
            draw(TopologicalState.trivial(), **wrong)


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda nodes: nodes * [-1, 1], "reads back as 1o2-"),  # mirrored
        (lambda nodes: nodes[:, :1] * [1, 1], "crossings"),  # all on one line
    ],
)
def test_a_drawing_that_shows_another_state_is_an_error(monkeypatch, spoil, message):
    relaxed = draw_module.relax
    monkeypatch.setattr(draw_module, "relax", lambda *mesh: spoil(relaxed(*mesh)))
    with pytest.raises(RuntimeError, match=message):
        draw(TopologicalState.parse("1o2+"))
