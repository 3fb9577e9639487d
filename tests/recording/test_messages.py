from __future__ import annotations

import itertools

import numpy as np
import pytest
from foxglove_schemas_protobuf.Log_pb2 import Log

from knotflow.recording import messages
from knotflow.simulation import RopeConfig, control_points, straight


def test_cloud_and_gripper_are_exact(make_rollout):
    rollout = make_rollout(3)
    cloud = messages.RopeCloud(41)
    for points, place in zip(rollout.points, rollout.gripper, strict=True):
        data = cloud.frame(5, points).SerializeToString()
        np.testing.assert_array_equal(messages.cloud_points(data), points)
        message = messages.gripper_message(5, place).SerializeToString()
        back = np.float32(messages.gripper_position(message))
        np.testing.assert_array_equal(back, place)


def test_cloud_fades_from_blue_head_to_orange_tail(make_rollout):
    message = messages.RopeCloud(41).frame(5, make_rollout(3).points[0])
    table = np.frombuffer(message.data, np.uint8).reshape(41, message.point_stride)
    offsets = {field.name: field.offset for field in message.fields}
    colours = table[:, [offsets[name] for name in ("red", "green", "blue")]]
    np.testing.assert_array_equal(colours[[0, -1]], [messages.HEAD_RGB, messages.TAIL_RGB])
    assert (np.diff(colours[:, 0].astype(int)) >= 0).all()


@pytest.mark.parametrize("vertices", [2, 5, 41])
def test_line_passes_all_vertices_in_order(make_rollout, vertices):
    points = make_rollout(3, vertices=vertices).points[4]
    message = messages.RopeLine(vertices, 0.008).frame(5, points)
    pieces = [
        np.array([[point.x, point.y, point.z] for point in line.points])
        for line in message.entities[0].lines
    ]
    for piece, following in itertools.pairwise(pieces):
        np.testing.assert_array_equal(piece[-1], following[0])  # no gap between two colours
    line = np.concatenate([pieces[0], *(piece[1:] for piece in pieces[1:])])
    np.testing.assert_allclose(line, points, atol=messages.LINE_STEP / 2)


def test_logs_state_goal_and_outcome(make_rollout):
    start = messages.start_message(5, make_rollout(3)).message
    assert all(part in start for part in ("#3", "C(0,1,1)", "[(2,1,+1)]", "[(1,3,+1),(4,2,+1)]"))
    success = messages.end_message(5, make_rollout(3))
    failure = messages.end_message(5, make_rollout(4))
    assert "SUCCESS" in success.message and success.level == Log.INFO
    assert "no readable state" in failure.message and failure.level == Log.WARNING


@pytest.mark.parametrize("radius", [0.002, 0.008, 0.03])
def test_rope_radius_is_read_from_spline(radius):
    rope = RopeConfig(radius=radius)
    spline = np.array([0.3, 0.1, 0.0, 0.2, 0.1, 0.1])
    found = messages.rope_radius(control_points(straight(rope), spline, radius))
    assert found == pytest.approx(radius)
    points = straight(rope).astype(np.float32)
    message = messages.RopeLine(len(points), found).frame(5, points)
    assert {line.thickness for line in message.entities[0].lines} == {2 * radius}
