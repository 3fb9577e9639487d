from __future__ import annotations

import numpy as np
import pytest
import torch

from knotflow.samplers.primitives import canonicalise, encode
from knotflow.samplers.primitives.canonical import streams_of
from knotflow.samplers.primitives.encoding import (
    CHANNELS,
    PLANE_SCALE,
    STREAM_POINTS,
    control_features,
)
from knotflow.simulation import SPLINE_HIGH, SPLINE_LOW, control_points
from knotflow.topology import parse_action, segment_intervals

CASES = [("straight", "R1(0,-1,1)"), ("straight", "R2(0,0,-1,1)"), ("loop", "C(2,1,1)")]


@pytest.mark.parametrize(("shape", "text"), CASES)
def test_network_space_and_world_are_inverse_in_range(ropes, shape, text):
    frames = encode(ropes[shape][None], [parse_action(text)]).frames
    splines = np.random.default_rng(0).uniform(SPLINE_LOW, SPLINE_HIGH, (1, 20, 6))
    np.testing.assert_allclose(frames.to_world(frames.to_network(splines)), splines, atol=1e-9)


def test_proposals_are_clipped_into_range(ropes):
    frames = encode(ropes["loop"][None], [parse_action("C(1,2,1)")]).frames
    world = frames.to_world(np.random.default_rng(0).normal(0, 20, (1, 50, 6)))
    assert (world >= SPLINE_LOW).all() and (world <= SPLINE_HIGH).all()


def test_streams_are_the_named_segments_of_the_rope(ropes):
    points, action = ropes["loop"], parse_action("C(0,1,1)")
    seen = encode(points[None], [action])
    streams = seen.states["streams"][0]
    assert streams.shape == (sum(STREAM_POINTS), CHANNELS)
    over, under, whole = streams.split(STREAM_POINTS)
    segments = segment_intervals(points)
    for stream, segment in ((over, segments[0]), (under, segments[1]), (whole, [0, 1])):
        along = (stream[[0, -1], 3] + 1) / 2
        np.testing.assert_allclose(along, segment, atol=1e-6)
    # The frame moves along with the rope but keeps its lengths.
    span = np.linalg.norm(whole[0, :2] - whole[-1, :2]) * PLANE_SCALE
    assert span == pytest.approx(np.linalg.norm(points[0, :2] - points[-1, :2]), rel=1e-5)
    np.testing.assert_allclose(np.linalg.norm(streams[:, 4:6], axis=1), 1, atol=1e-5)


def test_a_segment_over_itself_is_one_stream_for_r1_and_two_halves_for_r2(ropes):
    r1 = streams_of(canonicalise(ropes["straight"], parse_action("R1(0,1,1)")))
    np.testing.assert_array_equal(r1, [[0, 1], [0, 1]])
    r2 = streams_of(canonicalise(ropes["straight"], parse_action("R2(0,0,1,1)")))
    np.testing.assert_array_equal(r2, [[0, 0.5], [0.5, 1]])


@pytest.mark.parametrize(("shape", "text"), CASES)
def test_the_critic_sees_the_grasped_point_where_the_gripper_grasps(ropes, shape, text):
    action = parse_action(text)
    rope = canonicalise(ropes[shape], action)
    seen = encode(rope.points[None], [rope.action])
    splines = np.random.default_rng(1).uniform(SPLINE_LOW, SPLINE_HIGH, (1, 9, 6))
    # A link's middle, so that the grasped link is not a matter of rounding.
    splines[0, :, 0] = (np.arange(9) * 4 + 2.5) / 40
    network = torch.from_numpy(seen.frames.to_network(splines)).float()
    features = control_features(seen.states, network)[0]
    expected = control_points(rope.points, splines[0], 0.008)[:, 0, :2]
    moved = (expected - seen.frames.origin) / PLANE_SCALE
    cos, sin = seen.frames.axis[0]
    local = np.stack([moved @ [cos, sin], moved @ [-sin, cos]], axis=1)
    # Stream points are 32 for 41 vertices: they cut corners by less than a rope's radius.
    np.testing.assert_allclose(features[:, 7:9], local, atol=0.008 / PLANE_SCALE)
