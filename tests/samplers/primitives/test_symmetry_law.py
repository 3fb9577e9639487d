"""Proposals for a mirrored (reversed) rope and action are the mirrored (same) proposals."""

from __future__ import annotations

import numpy as np
import pytest

from knotflow.samplers.primitives import PrimitiveLibrary, canonicalise, encode, primitive_of
from knotflow.samplers.primitives.canonical import canonical_symmetry, is_canonical
from knotflow.topology import IllegalActionError, TopologicalState, parse_action
from knotflow.topology.symmetry import Symmetry

ACTIONS = [
    ("straight", "R1(0,1,1)"),
    ("straight", "R1(0,-1,1)"),
    ("straight", "R1(0,1,-1)"),
    ("straight", "R2(0,0,1,1)"),
    ("straight", "R2(0,0,1,-1)"),
    ("loop", "R2(0,2,-1,1)"),
    ("loop", "C(0,1,1)"),
    ("loop", "C(0,2,1)"),
    ("loop", "C(2,1,1)"),
    ("loop", "C(1,2,1)"),
    ("loop", "C(1,0,-1)"),
]


def moved(points, splines, symmetry):
    """A rope and its splines after a symmetry: the definition, independent of the encoding."""
    points, splines = points.copy(), splines.copy()
    if symmetry.mirror:
        points[:, 1] *= -1
        splines[:, [2, 5]] *= -1
    if symmetry.reverse:
        points = points[::-1]
        splines[:, 0] = 1 - splines[:, 0]
    return points, splines


@pytest.mark.slow
@pytest.mark.parametrize("symmetry", list(Symmetry.all()), ids=str)
@pytest.mark.parametrize(("shape", "text"), ACTIONS)
def test_proposals_follow_the_symmetry(library, ropes, shape, text, symmetry):
    points, action = ropes[shape], parse_action(text)
    segments = 1 if shape == "straight" else 3
    other_action = symmetry.of_action(action, segments)
    here = library.sample(points, action, 4, np.random.default_rng(3))
    expected_points, expected = moved(points, here, symmetry)
    there = library.sample(expected_points, other_action, 4, np.random.default_rng(3))
    np.testing.assert_allclose(there, expected, atol=1e-12, rtol=0)
    if not symmetry.reverse:
        assert (there == expected).all()  # only 1 - grasp can round


@pytest.mark.parametrize("crossings", [0, 1, 2])
def test_every_action_has_one_learned_counterpart(crossings):
    state = {
        0: TopologicalState.trivial(),
        1: TopologicalState.trivial().apply(parse_action("R1(0,1,1)")),
        2: TopologicalState.trivial()
        .apply(parse_action("R1(0,1,1)"))
        .apply(parse_action("C(0,1,1)")),
    }[crossings]
    for action, _ in state.actions():
        group = [symmetry.of_action(action, state.num_segments) for symmetry in Symmetry.all()]
        assert sum(is_canonical(one, state.num_segments) for one in group) == 1
        assert len({primitive_of(one, state.num_segments) for one in group}) == 1
        symmetry = canonical_symmetry(action, state.num_segments)
        assert is_canonical(symmetry.of_action(action, state.num_segments), state.num_segments)


def test_a_rigid_motion_on_the_table_moves_the_proposals_along(library, ropes):
    points, action = ropes["loop"] * [0.5, 0.5, 1], parse_action("C(0,1,1)")
    angle, shift = 0.7, np.array([0.05, -0.08])
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    here = encode(points[None], [action])
    there_points = points.copy()
    there_points[:, :2] = points[:, :2] @ turn.T + shift
    there = encode(there_points[None], [action])
    # The networks see the same...
    np.testing.assert_allclose(there.states["streams"], here.states["streams"], atol=1e-4)
    # ...and what they propose lies where the rope went.
    network = np.random.default_rng(0).normal(0, 0.3, (1, 5, 6))
    moved_mid = here.frames.to_world(network)[0, :, 1:3] @ turn.T + shift
    np.testing.assert_allclose(there.frames.to_world(network)[0, :, 1:3], moved_mid, atol=1e-9)


def test_a_segment_that_is_not_there_is_refused(ropes):
    with pytest.raises(IllegalActionError, match="segments 0 to 2"):
        canonicalise(ropes["loop"], parse_action("C(3,1,1)"))


def test_a_library_says_which_primitives_it_has(library, ropes):
    only = PrimitiveLibrary({1: library.primitives[1]}, {1: library.trained_on[1]}, library.rope)
    with pytest.raises(ValueError, match="primitive 3.*has primitives 1"):
        only.sample(ropes["loop"], parse_action("C(0,1,1)"), 1, np.random.default_rng(0))
