"""What undoing and arranging see of a rope, and that they see it under every symmetry alike."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from knotflow.samplers.primitives import UNDO, canonicalise, encode, kinds_of, primitive_of
from knotflow.samplers.primitives.canonical import is_canonical, marks_of, streams_of
from knotflow.samplers.primitives.encoding import KINDS, STREAM_POINTS
from knotflow.simulation import SPLINE_HIGH, SPLINE_LOW
from knotflow.topology import (
    R1,
    R2,
    Cross,
    IllegalActionError,
    TopologicalState,
    Undo,
    parse_action,
    project,
)
from knotflow.topology.draw import draw
from knotflow.topology.symmetry import Symmetry

STATES = ["2o1+", "1o4+2o3-", "1o3+4o2+", "4o1+2o5+6o3+", "1o2+3o5+6o4+"]
CASES = [
    (text, str(undoing))
    for text in STATES
    for undoing, _ in TopologicalState.parse(text).undo_actions()
]
BOTH = pytest.mark.parametrize("arranging", [False, True], ids=["acting", "arranging"])


def shape(text):
    """A rope with the state, along no axis."""
    points = draw(TopologicalState.parse(text)) * [0.6, 0.6, 1]
    cos, sin = np.cos(0.4), np.sin(0.4)
    return points @ np.array([[cos, sin, 0], [-sin, cos, 0], [0, 0, 1]])


def test_the_cases_undo_every_kind():
    kinds = {
        kinds_of(parse_action(undoing), TopologicalState.parse(state).num_segments)
        for state, undoing in CASES
    }
    assert kinds == {(UNDO, 1), (UNDO, 2), (UNDO, 3), (UNDO, 4)}


@pytest.mark.parametrize("text", STATES)
def test_every_undoing_has_one_learned_counterpart(text):
    state = TopologicalState.parse(text)
    for undoing, _ in state.undo_actions():
        group = [symmetry.of_action(undoing, state.num_segments) for symmetry in Symmetry.all()]
        assert sum(is_canonical(one, state.num_segments) for one in group) == 1
        assert {primitive_of(one, state.num_segments) for one in group} == {UNDO}
        assert len({kinds_of(one, state.num_segments) for one in group}) == 1


@pytest.mark.slow
@BOTH
@pytest.mark.parametrize("symmetry", Symmetry.all(), ids=str)
@pytest.mark.parametrize(("text", "undoing"), [*CASES, ("2o1+", "C(1,2,1)")])
def test_a_mirrored_or_reversed_rope_is_seen_bit_for_bit_the_same(
    text, undoing, symmetry, arranging
):
    points, action = shape(text), parse_action(undoing)
    moved = points * [1, -1, 1] if symmetry.mirror else points
    moved = moved[::-1] if symmetry.reverse else moved
    count = TopologicalState.parse(text).num_segments
    here = encode(points[None], [action], arranging).states
    there = encode(moved[None], [symmetry.of_action(action, count)], arranging).states
    assert set(here.keys()) == set(there.keys())
    for name in here.keys():
        assert torch.equal(here[name], there[name])


@BOTH
@pytest.mark.parametrize(("text", "undoing"), CASES)
def test_a_rigid_motion_on_the_table_is_not_seen(text, undoing, arranging):
    points, action = shape(text), parse_action(undoing)
    angle, shift = 0.7, np.array([0.05, -0.08])
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    moved = points.copy()
    moved[:, :2] = points[:, :2] @ turn.T + shift
    here, there = (encode(one[None], [action], arranging) for one in (points, moved))
    np.testing.assert_allclose(there.states["streams"], here.states["streams"], atol=1e-4)
    np.testing.assert_allclose(there.frames.grasp, here.frames.grasp, atol=1e-9)
    network = np.random.default_rng(0).normal(0, 0.2, (1, 5, 6))
    ends = [one.frames.to_world(network)[0, :, 4:6] for one in (here, there)]
    np.testing.assert_allclose(ends[1], ends[0] @ turn.T + shift, atol=1e-9)


@BOTH
@pytest.mark.parametrize(("text", "undoing"), CASES)
def test_network_space_and_world_are_inverse_in_range(text, undoing, arranging):
    frames = encode(shape(text)[None], [parse_action(undoing)], arranging).frames
    splines = np.random.default_rng(0).uniform(SPLINE_LOW, SPLINE_HIGH, (1, 20, 6))
    np.testing.assert_allclose(frames.to_world(frames.to_network(splines)), splines, atol=1e-9)


@pytest.mark.parametrize(("text", "undoing"), CASES)
def test_the_frame_lies_at_the_crossings_that_are_taken_back(text, undoing):
    points, action = shape(text), parse_action(undoing)
    encoded, rope = encode(points[None], [action]), canonicalise(points, action)
    read = project(rope.points)
    positions = [position - 1 for position in rope.action.action.new_positions]
    middle = read.xy[positions].mean(axis=0)
    reach = np.ptp(read.xy[positions], axis=0).max() if len(positions) == 4 else 1e-9
    assert np.linalg.norm(encoded.frames.origin[0] - middle) < max(reach, 1e-6)
    _, strand, _ = encoded.states["streams"][0].split(STREAM_POINTS)
    nearest = strand[np.linalg.norm(strand[:, :2], axis=1).argmin()]
    assert nearest[4] > 0.7  # the strand passes the origin along the x axis


@pytest.mark.parametrize(("text", "undoing"), CASES)
def test_the_streams_tell_every_kind_of_undoing_apart(text, undoing):
    rope = canonicalise(shape(text), parse_action(undoing))
    inner = rope.action.action
    (piece, strand), (over, under) = streams_of(rope), marks_of(rope)
    assert (piece[0] == 0) == isinstance(inner, Cross)
    overlap = min(piece[1], strand[1]) > max(piece[0], strand[0])
    assert overlap == isinstance(inner, R1)
    streams = encode(rope.points[None], [rope.action]).states["streams"][0]
    first = streams[: STREAM_POINTS[0]]
    pulls_under = isinstance(inner, Cross) and inner.under == 0
    assert first[:, 7 if pulls_under else 6].all()
    assert first[1:-1, 6 if pulls_under else 7].all() == isinstance(inner, R1)
    assert pulls_under == (over is not piece and tuple(over) == tuple(strand))
    assert {tuple(over), tuple(under)} == {tuple(piece), tuple(strand)}


@pytest.mark.parametrize(("text", "undoing"), CASES)
def test_the_grasp_counts_from_the_piece_in_shares_of_the_rope(text, undoing):
    rope = canonicalise(shape(text), parse_action(undoing))
    piece, _ = streams_of(rope)
    frames = encode(rope.points[None], [rope.action]).frames
    zero, unit = (frames.to_world(np.full((1, 1, 6), one))[0, 0, 0] for one in (0.0, 0.1))
    at = piece[1] if piece[0] == 0 else piece.mean()
    assert zero == pytest.approx(at) and unit - zero == pytest.approx(0.03)
    anywhere = encode(rope.points[None], [rope.action], arranging=True).frames
    assert anywhere.to_world(np.zeros((1, 1, 6)))[0, 0, 0] == 0.5


@pytest.mark.parametrize(
    ("text", "action", "kinds"),
    [
        ("2o1+", "C(1,2,1)", {4}),
        ("2o1+", "R1(1,1,-1)", {1}),
        ("2o1+", "undo R1(0,1,1)", {1, UNDO}),
        ("4o1+2o5+6o3+", "undo C(2,0,1)", {4, UNDO}),
    ],
)
def test_arranging_sees_what_the_wanted_action_sees_and_which_kind_it_is(text, action, kinds):
    points, action = shape(text), parse_action(action)
    acting, arranging = (encode(points[None], [action], one) for one in (False, True))
    assert torch.equal(acting.states["streams"], arranging.states["streams"])
    assert "kind" not in acting.states.keys()
    assert arranging.states["kind"].shape == (1, KINDS)
    assert set(torch.nonzero(arranging.states["kind"][0])[:, 0].tolist()) == kinds
    np.testing.assert_array_equal(acting.frames.origin, arranging.frames.origin)
    np.testing.assert_array_equal(acting.frames.axis, arranging.frames.axis)


def test_an_undoing_beyond_the_rope_is_refused():
    with pytest.raises(IllegalActionError, match="of the 3 segments, 0 to 2, it would leave 1"):
        canonicalise(shape("2o1+"), Undo(R1(1, 1, 1)))
    with pytest.raises(IllegalActionError, match="it would leave 0"):
        canonicalise(shape("2o1+"), Undo(R2(0, 0, 1, 1)))
