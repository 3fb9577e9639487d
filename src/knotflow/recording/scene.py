"""What the viewers draw: Foxglove protobuf messages of a rope, a gripper and a spline.

Rerun and Foxglove decode these schemas without our help. Building a protobuf message field by
field is slow, so each painter keeps one message and only moves its numbers from frame to frame.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.LinePrimitive_pb2 import LinePrimitive
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.PackedElementField_pb2 import PackedElementField
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from numpy.typing import NDArray

from knotflow.simulation import spline_path

from . import topics
from .schema import IMAGE_FORMATS, NANOSECONDS, RecordedRollout

THINNEST = 0.001  # m; thinner ropes are drawn with this radius, or nothing would be seen
HEAD_RGB, TAIL_RGB = (30, 100, 255), (255, 140, 20)  # blue head, orange tail
SPLINE_RGB = (60, 200, 90)
CONTROL_RGB = (235, 60, 160)
GRIPPER_RGB = (235, 220, 60)
LINE_PIECES = 8  # the rope line changes colour this often along its length
LINE_STEP = 2.0**-10  # m; the line is a rounded copy for the eye, so a rope at rest costs nothing
CURVE_POINTS = 33


def gradient(count: int) -> NDArray[np.uint8]:
    """Colours (count, 3) from the rope's head to its tail."""
    share = np.linspace(0.0, 1.0, count)[:, None]
    return np.rint((1 - share) * np.array(HEAD_RGB) + share * np.array(TAIL_RGB)).astype(np.uint8)


def spline_curve(control_points: NDArray[np.float64], count: int = CURVE_POINTS) -> NDArray:
    """Points (count, 3) m of the clamped quadratic B-spline with control points (3, 3) m."""
    return spline_path(control_points, np.linspace(0.0, 1.0, count))


def rope_radius(control_points: NDArray[np.float64]) -> float:
    """Radius of the rope, m, that a spline with control points (3, 3) m was made for.

    A spline ends at the height of a resting rope's centre line, so every recording has it.
    """
    return max(float(control_points[2, 2]), THINNEST)


def _stamp(timestamp: Any, log_time: int) -> None:
    timestamp.seconds, timestamp.nanos = divmod(log_time, NANOSECONDS)


def _color(rgb: Any, alpha: float = 1.0) -> Color:
    red, green, blue = (float(part) / 255 for part in rgb)
    return Color(r=red, g=green, b=blue, a=alpha)


class RopeCloud:
    """The rope's vertices as a point cloud of exact float32 x, y, z and a colour for each."""

    def __init__(self, vertices: int) -> None:
        self._records = np.zeros(
            vertices, dtype=[("xyz", "<f4", 3), ("rgb", "u1", 3), ("alpha", "u1")]
        )
        self._records["rgb"] = gradient(vertices)
        self._records["alpha"] = 255
        self._message = PointCloud(frame_id=topics.WORLD, point_stride=self._records.itemsize)
        self._message.pose.orientation.w = 1.0
        for offset, name in enumerate("xyz"):
            self._message.fields.add(name=name, offset=4 * offset, type=PackedElementField.FLOAT32)
        for offset, name in enumerate(("red", "green", "blue", "alpha"), start=12):
            self._message.fields.add(name=name, offset=offset, type=PackedElementField.UINT8)

    def frame(self, log_time: int, points: NDArray[np.float32]) -> bytes:
        """The message for points (V, 3) m."""
        self._records["xyz"] = points
        self._message.data = self._records.tobytes()
        _stamp(self._message.timestamp, log_time)
        return self._message.SerializeToString()


def cloud_points(data: bytes) -> NDArray[np.float32]:
    """The vertices (V, 3) m of a ``RopeCloud`` message."""
    message = PointCloud.FromString(data)
    table = np.frombuffer(message.data, "<f4").reshape(-1, message.point_stride // 4)
    return table[:, :3].copy()


class RopeLine:
    """The rope as a thick line in a few pieces that fade from the head's colour to the tail's."""

    def __init__(self, vertices: int, radius: float) -> None:
        """Of so many vertices and a radius in metres."""
        self._message = SceneUpdate()
        entity = self._message.entities.add(id="rope", frame_id=topics.WORLD)
        self._stamp = entity.timestamp
        cuts = np.linspace(0, vertices - 1, min(LINE_PIECES, vertices - 1) + 1).astype(int)
        self._points: list[tuple[int, Any]] = []
        for first, last, rgb in zip(cuts, cuts[1:], gradient(len(cuts) - 1), strict=False):
            line = entity.lines.add(
                type=LinePrimitive.LINE_STRIP, thickness=2 * radius, color=_color(rgb)
            )
            line.pose.orientation.w = 1.0
            self._points += [(vertex, line.points.add()) for vertex in range(first, last + 1)]

    def frame(self, log_time: int, points: NDArray[np.float32]) -> bytes:
        """The message for points (V, 3) m, rounded to ``LINE_STEP``."""
        rounded = (np.rint(points / LINE_STEP) * LINE_STEP).tolist()
        for vertex, point in self._points:
            point.x, point.y, point.z = rounded[vertex]
        _stamp(self._stamp, log_time)
        return self._message.SerializeToString()


class GripperPose:
    """The gripper as a pose; its position is the exact float32, its orientation is not used."""

    def __init__(self) -> None:
        self._message = PoseInFrame(frame_id=topics.WORLD)
        self._message.pose.orientation.w = 1.0

    def frame(self, log_time: int, position: NDArray[np.float32]) -> bytes:
        """The message for a position (3,) m."""
        place = self._message.pose.position
        place.x, place.y, place.z = position.tolist()
        _stamp(self._message.timestamp, log_time)
        return self._message.SerializeToString()


def gripper_position(data: bytes) -> tuple[float, float, float]:
    """The position (3,) m of a ``GripperPose`` message."""
    place = PoseInFrame.FromString(data).pose.position
    return place.x, place.y, place.z


def image_message(log_time: int, image: bytes) -> bytes:
    """The message for an image's file, PNG or JPEG."""
    kind = next(name for start, name in IMAGE_FORMATS.items() if image.startswith(start))
    message = CompressedImage(frame_id=topics.CAMERA[1:], data=image, format=kind)
    _stamp(message.timestamp, log_time)
    return message.SerializeToString()


def image_file(data: bytes) -> bytes:
    """The image's file in an ``image_message``."""
    return bytes(CompressedImage.FromString(data).data)


def spline_message(log_time: int, control_points: NDArray[np.float64]) -> bytes:
    """The spline's control points as spheres, its curve and its control polygon as lines."""
    message = SceneUpdate()
    entity = message.entities.add(id="spline", frame_id=topics.WORLD)
    _stamp(entity.timestamp, log_time)
    for x, y, z in control_points.tolist():
        sphere = entity.spheres.add(color=_color(CONTROL_RGB))
        sphere.pose.position.x, sphere.pose.position.y, sphere.pose.position.z = x, y, z
        sphere.pose.orientation.w = 1.0
        sphere.size.x = sphere.size.y = sphere.size.z = 0.02
    curve = np.rint(spline_curve(control_points) / LINE_STEP) * LINE_STEP
    strokes = ((curve, 0.005, _color(SPLINE_RGB)), (control_points, 0.002, _color(CONTROL_RGB)))
    for points, thickness, color in strokes:
        line = entity.lines.add(type=LinePrimitive.LINE_STRIP, thickness=thickness, color=color)
        line.pose.orientation.w = 1.0
        for x, y, z in points.tolist():
            line.points.add(x=x, y=y, z=z)
    return message.SerializeToString()


_LEVELS = {"success": Log.INFO, "failure": Log.WARNING, "diverged": Log.ERROR}


def start_message(log_time: int, rollout: RecordedRollout) -> bytes:
    """What is about to happen: action, start and goal state."""
    text = (
        f"#{rollout.number} {rollout.action} by {rollout.source}: "
        f"{rollout.start_state} -> goal {rollout.goal_state}"
    )
    return _log(log_time, Log.INFO, text)


def end_message(log_time: int, rollout: RecordedRollout) -> bytes:
    """What came of it: outcome and state reached."""
    reached = rollout.end_state or "no readable state"
    text = f"#{rollout.number} {rollout.action} {rollout.outcome.upper()}: reached {reached}"
    return _log(log_time, _LEVELS[rollout.outcome], text)


def _log(log_time: int, level: Any, text: str) -> bytes:
    message = Log(level=level, message=text, name="topology")
    _stamp(message.timestamp, log_time)
    return message.SerializeToString()


def root_frame(log_time: int) -> bytes:
    """The world as a child of Rerun's root frame; without it Rerun's 3-D view stays empty."""
    message = FrameTransforms()
    transform = message.transforms.add(parent_frame_id="tf#/", child_frame_id=topics.WORLD)
    transform.rotation.w = 1.0
    _stamp(transform.timestamp, log_time)
    return message.SerializeToString()
