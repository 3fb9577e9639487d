"""Where gradient steps cannot go, a shape is rewired."""

import numpy as np
import pytest

from knotflow.perception.estimation import search as searching
from knotflow.perception.estimation.fitting import FitConfig
from knotflow.perception.estimation.search import (
    SearchConfig,
    SearchResult,
    extend_to_missed,
    propose_rewirings,
    search,
)
from knotflow.perception.estimation.skeleton import passages
from knotflow.simulation import resample, state_or_none
from knotflow.topology import TopologicalState
from knotflow.topology.polyline import DegenerateCurveError, planar_crossings

from .shapes import ROPE, loop, s_curve, target


def hairpin(gap: float) -> np.ndarray:
    """A rope (V, 3) that lies folded, with a gap between its halves, metres."""
    t = np.linspace(0, 1, 400)
    fold = np.column_stack([np.abs(t - 0.5), gap * np.tanh(12 * (t - 0.5)) / 2, 0 * t])
    return resample(fold + [0, 0, ROPE.radius], ROPE)


def test_no_rewirings_without_contacts():
    assert propose_rewirings(s_curve(), ROPE, 8) == []


def test_touching_strands_are_twisted_in_four_ways():
    states = [state_or_none(one) for one in propose_rewirings(hairpin(0.018), ROPE, 4)]
    assert len({str(state) for state in states if state and state.num_crossings == 2}) == 4


def test_crossing_is_exchanged_and_loop_reversed():
    shape = loop(1)
    turned, exchanged = propose_rewirings(shape, ROPE, 1)
    assert TopologicalState.from_curve(exchanged) == TopologicalState.from_curve(loop(-1))
    middle = len(shape) // 2
    assert np.linalg.norm(turned[middle] - shape[middle]) < 0.02  # the loop's tip stays
    links = np.linalg.norm(np.diff(turned, axis=0), axis=1)
    assert np.allclose(links, ROPE.link_length, rtol=1e-6)


def test_extend_to_missed():
    points = s_curve()
    short = points.copy()
    short[-5:] = points[-6] + np.linspace(0, 1, 5)[:, None] * [0, 0.1, 0]
    led = extend_to_missed(short, target(points))
    assert min(np.linalg.norm(one[-1, :2] - points[-1, :2]) for one in led) < 0.02


@pytest.mark.slow
def test_search_corrects_crossing():
    found = search([loop(-1)], target(loop(1))).shapes[0]
    assert TopologicalState.from_curve(found) == TopologicalState.from_curve(loop(1))


def test_search_continues_from_result(monkeypatch):
    asked = []
    monkeypatch.setattr(searching, "propose_rewirings", lambda shape, *_: asked.append(shape) or [])
    monkeypatch.setattr(searching, "extend_to_missed", lambda *_: [])
    monkeypatch.setattr(searching, "is_plausible", lambda *_: False)
    done, other = s_curve(), loop(1)
    seen, brief = target(done), FitConfig(steps=1, step_size=1e-9)
    config = SearchConfig(coarse=brief, rounds=2)
    before, rounds = SearchResult([done, other], [done]), []
    found = search([], seen, config, brief, before, lambda: rounds.append(1))
    assert len(rounds) == 1
    np.testing.assert_array_equal(asked, [other])
    assert len(found.done) == 2 and len(found.shapes) == 2
    found = search([done], seen, config, brief, SearchResult([other], [other]))
    assert len(asked) == 2 and len(found.shapes) == 2
    np.testing.assert_allclose(found.shapes[0], done, atol=1e-4)


def test_guess_with_touching_end_is_rewired():
    touching = np.linspace([-0.39, 0, ROPE.radius], [0.41, 0, ROPE.radius], 31)
    back = np.linspace([0.41, 0.1, ROPE.radius], [0.0, 0.1, ROPE.radius], 9)
    down = np.linspace([0.0, 0.09, ROPE.radius], [0.0, 0.0, ROPE.radius], 5)
    shape = np.concatenate([touching, back, down])
    with pytest.raises(DegenerateCurveError):
        planar_crossings(shape[:, :2])
    assert passages(shape).shape == (0, 2)
    assert propose_rewirings(shape, ROPE, 8)
    through = shape.copy()
    through[-1, 1] = -0.01
    (crossing,) = passages(through)
    assert crossing == pytest.approx([14.6, 43.7], abs=0.2)
    along = np.concatenate([touching, touching[::-1] + [0, 0.002, 0]])
    along[-1, 1] = 0.0  # it ends along the strand that it began with
    assert len(passages(along)) <= 1
