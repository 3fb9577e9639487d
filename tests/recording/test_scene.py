from __future__ import annotations

import numpy as np
import pytest
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate

from knotflow.recording import scene
from knotflow.simulation import RopeConfig, control_points, straight


def test_spline_curve_is_a_clamped_quadratic_b_spline():
    controls = np.array([[0.0, 0.0, 0.0], [0.2, 0.4, 0.3], [0.6, 0.0, 0.0]])
    curve = scene.spline_curve(controls, 11)
    np.testing.assert_allclose(curve[[0, -1]], controls[[0, -1]])  # clamped at its ends
    np.testing.assert_allclose(curve[5], (controls[0] + 2 * controls[1] + controls[2]) / 4)
    np.testing.assert_allclose(np.diff(curve, 3, axis=0), 0, atol=1e-12)  # of degree two


def test_cloud_and_gripper_keep_every_bit(make_rollout):
    rollout = make_rollout(3)
    cloud, gripper = scene.RopeCloud(41), scene.GripperPose()
    for points, place in zip(rollout.points, rollout.gripper, strict=True):
        np.testing.assert_array_equal(scene.cloud_points(cloud.frame(5, points)), points)
        back = np.float32(scene.gripper_position(gripper.frame(5, place)))
        np.testing.assert_array_equal(back, place)


def test_the_cloud_fades_from_a_blue_head_to_an_orange_tail(make_rollout):
    message = PointCloud.FromString(scene.RopeCloud(41).frame(5, make_rollout(3).points[0]))
    table = np.frombuffer(message.data, np.uint8).reshape(41, message.point_stride)
    offsets = {field.name: field.offset for field in message.fields}
    colours = table[:, [offsets[name] for name in ("red", "green", "blue")]]
    np.testing.assert_array_equal(colours[[0, -1]], [scene.HEAD_RGB, scene.TAIL_RGB])
    assert (np.diff(colours[:, 0].astype(int)) >= 0).all()


@pytest.mark.parametrize("vertices", [2, 5, 41])
def test_the_line_passes_all_vertices_once_in_order(make_rollout, vertices):
    points = make_rollout(3, vertices=vertices).points[4]
    message = SceneUpdate.FromString(scene.RopeLine(vertices, 0.008).frame(5, points))
    pieces = [
        np.array([[point.x, point.y, point.z] for point in line.points])
        for line in message.entities[0].lines
    ]
    for piece, following in zip(pieces, pieces[1:], strict=False):
        np.testing.assert_array_equal(piece[-1], following[0])  # no gap between two colours
    line = np.concatenate([pieces[0], *(piece[1:] for piece in pieces[1:])])
    np.testing.assert_allclose(line, points, atol=scene.LINE_STEP / 2)


def test_logs_say_what_was_meant_and_reached(make_rollout):
    start = Log.FromString(scene.start_message(5, make_rollout(3))).message
    assert all(part in start for part in ("#3", "C(0,1,1)", "[(2,1,+1)]", "[(1,3,+1),(4,2,+1)]"))
    success = Log.FromString(scene.end_message(5, make_rollout(3)))
    failure = Log.FromString(scene.end_message(5, make_rollout(4)))
    assert "SUCCESS" in success.message and success.level == Log.INFO
    assert "no readable state" in failure.message and failure.level == Log.WARNING


@pytest.mark.parametrize("radius", [0.002, 0.008, 0.03])
def test_the_rope_is_as_thick_as_the_one_that_its_spline_was_made_for(radius):
    rope = RopeConfig(radius=radius)
    spline = np.array([0.3, 0.1, 0.0, 0.2, 0.1, 0.1])
    found = scene.rope_radius(control_points(straight(rope), spline, radius))
    assert found == pytest.approx(radius)
    points = straight(rope).astype(np.float32)
    message = SceneUpdate.FromString(scene.RopeLine(len(points), found).frame(5, points))
    assert {line.thickness for line in message.entities[0].lines} == {2 * radius}
