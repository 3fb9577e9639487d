"""Drawings of states: they read back as the state, and their mesh has no folds."""

from __future__ import annotations

import random
from itertools import chain

import numpy as np
import pytest

import knotflow.topology.draw as draw_module
from knotflow.topology import TopologicalState, knot, project
from knotflow.topology.draw import draw, relax
from knotflow.topology.embedding import build_mesh, tutte


@pytest.mark.slow
def test_drawing_preserves_state(states_by_crossings):
    sample = random.Random(0).sample(sorted(states_by_crossings[3]), 60)
    for state in [*chain(*states_by_crossings[:3]), *sample]:
        assert TopologicalState.from_curve(draw(state)) == state


@pytest.mark.parametrize("crossings", [5, 7, 10])
def test_drawing_preserves_larger_states(random_state, crossings):
    for seed in range(2):
        state = random_state(crossings, seed)
        assert TopologicalState.from_curve(draw(state)) == state


def test_drawing_length_heights_and_centre():
    points = draw(min(knot("overhand")), gap=0.03)
    assert points.shape == (4 * 8 * 7 + 1, 3)
    assert np.linalg.norm(np.diff(points[:, :2], axis=0), axis=1).sum() == pytest.approx(1.0)
    np.testing.assert_allclose(points[:, :2].min(axis=0) + points[:, :2].max(axis=0), 0, atol=1e-9)
    assert points[0, 2] == points[-1, 2] == 0.0
    crossings = project(points)
    assert crossings.heights.max() == pytest.approx(0.03, rel=0.02)
    assert crossings.heights.min() == pytest.approx(0.0, abs=0.001)


def test_drawings_are_smooth_and_spacious():
    for name in ("overhand", "figure_eight", "pentagram"):
        points = draw(min(knot(name)))
        steps = np.diff(points[:, :2], axis=0)
        heading = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
        assert np.abs(np.diff(heading)).max() < np.radians(15)
        assert np.diff(project(points).segment_intervals).min() > 0.04


def test_drawing_is_deterministic():
    state = min(knot("pentagram"))
    np.testing.assert_array_equal(draw(state), draw(TopologicalState.parse(str(state))))


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda nodes: nodes * [-1, 1], "reads back as 1o2-"),  # mirrored
        (lambda nodes: nodes[:, :1] * [1, 1], "crossings"),  # all on one line
    ],
)
def test_drawing_with_wrong_state_raises(monkeypatch, spoil, message):
    relaxed = draw_module.relax
    monkeypatch.setattr(draw_module, "relax", lambda *mesh: spoil(relaxed(*mesh)))
    with pytest.raises(RuntimeError, match=message):
        draw(TopologicalState.parse("1o2+"))


def doubled_areas(mesh, places):
    first, second, third = (places[mesh.triangles[:, corner]] for corner in range(3))
    one, two = second - first, third - first
    return one[:, 0] * two[:, 1] - one[:, 1] * two[:, 0]


@pytest.mark.parametrize("crossings", [0, 1, 3, 6, 10])
def test_relaxation_folds_no_triangle(random_state, crossings):
    mesh = build_mesh(random_state(crossings, 7))
    places = tutte(mesh)
    assert doubled_areas(mesh, places).min() > 0
    relaxed = relax(mesh, places)
    assert doubled_areas(mesh, relaxed).min() > 0
    np.testing.assert_array_equal(relaxed[mesh.rim], places[mesh.rim])
    lengths = [np.linalg.norm(np.diff(p[mesh.path], axis=0), axis=1) for p in (places, relaxed)]
    assert lengths[1].max() / lengths[1].min() <= lengths[0].max() / lengths[0].min()
    assert 0.2 < np.median(lengths[1]) < 3.0
