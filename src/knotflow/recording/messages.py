"""The messages of a recording: one ``knotflow.Rollout`` a rollout, and Foxglove's for the viewers.

A ``knotflow.Rollout`` holds everything about a rollout but its trajectory. Building a protobuf
message is slow, so each class here keeps one and only sets its numbers from frame to frame.
"""

from __future__ import annotations

from collections.abc import Sequence
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
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from numpy.typing import NDArray

from knotflow.simulation import spline_path

from .rollout import IMAGE_FORMATS, NANOSECONDS, RecordedRollout, RolloutImages

# Topics, which are also paths in the viewers' entity trees.
ROLLOUT = "/rollout"  # knotflow.Rollout, one a rollout
ROPE = "/rope/points"  # foxglove.PointCloud, one a frame: the vertices, exact
ROPE_LINE = "/rope/line"  # foxglove.SceneUpdate, one a frame: the same to look at, rounded
GRIPPER = "/gripper"  # foxglove.PoseInFrame, one a frame, exact
SPLINE = "/spline"  # foxglove.SceneUpdate, one a rollout: control points and curve
CAMERA = "/camera"  # foxglove.CompressedImage, one a frame, where there was a camera
ESTIMATE = "/estimate"  # foxglove.PointCloud, one a frame: the vertices estimated in its images
REFERENCE = "/reference"  # foxglove.PointCloud, one a frame: the planned vertices
TOPOLOGY = "/topology"  # foxglove.Log, at the start and at the end of a rollout
FRAMES = "/tf"  # foxglove.FrameTransforms, once: the root of the frames

WORLD = "world"  # the one frame all coordinates are in
METADATA = "knotflow"  # name of the MCAP metadata record that holds the config

MIN_RADIUS = 0.001  # m; thinner ropes are drawn with this radius
HEAD_RGB, TAIL_RGB = (30, 100, 255), (255, 140, 20)  # blue head, orange tail
SPLINE_RGB = (60, 200, 90)
CONTROL_RGB = (235, 60, 160)
GRIPPER_RGB = (235, 220, 60)
LINE_PIECES = 8  # the rope line changes colour this often along its length
LINE_STEP = 2.0**-10  # m; the line is rounded, so that a rope at rest compresses to nothing
_CURVE = np.linspace(0.0, 1.0, 33)

TEXTS = ("action", "start_state", "goal_state", "end_state", "outcome", "signature", "source")
SPLINE_COLUMNS = (
    *("spline_grasp", "spline_mid_x", "spline_mid_y", "spline_height"),
    *("spline_end_x", "spline_end_y"),
)
_Field = descriptor_pb2.FieldDescriptorProto
_FIELDS: tuple[tuple[str, int, bool], ...] = (  # name, type, repeated; the order is the file format
    ("number", _Field.TYPE_INT64, False),
    *((name, _Field.TYPE_STRING, False) for name in TEXTS),
    ("spline", _Field.TYPE_DOUBLE, True),
    ("control_points", _Field.TYPE_DOUBLE, True),  # 9 numbers, row by row
    ("start_ns", _Field.TYPE_INT64, False),  # log time of the first frame in this file
    ("duration_ns", _Field.TYPE_INT64, False),
    ("first_time_ns", _Field.TYPE_INT64, False),  # the rollout's own time at the first frame
    ("frames", _Field.TYPE_INT64, False),
    ("vertices", _Field.TYPE_INT64, False),
)


def _rollout_class() -> Any:
    file = descriptor_pb2.FileDescriptorProto(
        name="knotflow/rollout.proto", package="knotflow", syntax="proto3"
    )
    message = file.message_type.add(name="Rollout")
    for number, (name, kind, repeated) in enumerate(_FIELDS, start=1):
        label = _Field.LABEL_REPEATED if repeated else _Field.LABEL_OPTIONAL
        message.field.add(name=name, number=number, type=kind, label=label)
    entry = message.nested_type.add(name="ExtraEntry")  # a protobuf map is a list of these
    entry.options.map_entry = True
    text: dict[str, Any] = {"type": _Field.TYPE_STRING, "label": _Field.LABEL_OPTIONAL}
    for number, name in enumerate(("key", "value"), start=1):
        entry.field.add(name=name, number=number, **text)
    extra = message.field.add(name="extra", number=len(_FIELDS) + 1)
    extra.type, extra.label = _Field.TYPE_MESSAGE, _Field.LABEL_REPEATED
    extra.type_name = ".knotflow.Rollout.ExtraEntry"
    pool = descriptor_pool.DescriptorPool()
    return message_factory.GetMessageClass(pool.Add(file).message_types_by_name["Rollout"])


RolloutMessage = _rollout_class()


def encode_rollout(rollout: RecordedRollout, start_ns: int) -> Any:
    """The ``knotflow.Rollout`` of a rollout whose first frame is logged at ``start_ns``."""
    times_ns = rollout.times_ns
    return RolloutMessage(
        number=rollout.number,
        spline=rollout.spline.tolist(),
        control_points=rollout.control_points.ravel().tolist(),
        start_ns=start_ns,
        duration_ns=int(times_ns[-1] - times_ns[0]),
        first_time_ns=int(times_ns[0]),
        frames=rollout.points.shape[0],
        vertices=rollout.points.shape[1],
        extra=dict(rollout.extra),
        **{name: getattr(rollout, name) for name in TEXTS},
    )


def decode_rollout(
    facts: Any,
    log_times: Sequence[int],
    points: NDArray[np.float32],
    gripper: NDArray[np.float32],
    camera: RolloutImages | None,
) -> RecordedRollout:
    """A rollout from its ``knotflow.Rollout`` and its frames; log times in ns, lengths in m."""
    own = np.asarray(log_times, np.int64) - facts.start_ns + facts.first_time_ns
    return RecordedRollout(
        times=own / NANOSECONDS,
        points=points,
        gripper=gripper,
        control_points=np.array(facts.control_points).reshape(3, 3),
        spline=np.array(facts.spline),
        number=int(facts.number),
        extra=dict(facts.extra),
        camera=camera,
        **{name: getattr(facts, name) for name in TEXTS},
    )


def table_row(facts: Any) -> dict[str, Any]:
    """A ``knotflow.Rollout`` as one row of `load`'s table, without its file."""
    return {
        "number": int(facts.number),
        "start_time_s": facts.start_ns / NANOSECONDS,
        "duration_s": facts.duration_ns / NANOSECONDS,
        **dict(zip(SPLINE_COLUMNS, facts.spline, strict=True)),
        **{name: getattr(facts, name) for name in TEXTS},
        "extra": dict(facts.extra),
    }


def gradient(count: int) -> NDArray[np.uint8]:
    """Colours (count, 3) from the rope's head to its tail."""
    share = np.linspace(0.0, 1.0, count)[:, None]
    return np.rint((1 - share) * np.array(HEAD_RGB) + share * np.array(TAIL_RGB)).astype(np.uint8)


def rope_radius(control_points: NDArray[np.float64]) -> float:
    """Of the rope, m: a spline's control points (3, 3) m end at its height."""
    return max(float(control_points[2, 2]), MIN_RADIUS)


class RopeCloud:
    """The rope's vertices as a point cloud of exact float32 x, y, z and a colour for each."""

    def __init__(self, vertices: int) -> None:
        self._records = np.zeros(
            vertices, dtype=[("xyz", "<f4", 3), ("rgb", "u1", 3), ("alpha", "u1")]
        )
        self._records["rgb"] = gradient(vertices)
        self._records["alpha"] = 255
        self._message = PointCloud(frame_id=WORLD, point_stride=self._records.itemsize)
        self._message.pose.orientation.w = 1.0
        for offset, name in enumerate("xyz"):
            self._message.fields.add(name=name, offset=4 * offset, type=PackedElementField.FLOAT32)
        for offset, name in enumerate(("red", "green", "blue", "alpha"), start=12):
            self._message.fields.add(name=name, offset=offset, type=PackedElementField.UINT8)

    def frame(self, log_time: int, points: NDArray[np.float32]) -> PointCloud:
        """The message for points (V, 3) m; the next one changes it."""
        self._records["xyz"] = points
        self._message.data = self._records.tobytes()
        self._message.timestamp.FromNanoseconds(log_time)
        return self._message


def cloud_points(data: bytes) -> NDArray[np.float32]:
    """The vertices (V, 3) m of a ``RopeCloud`` message."""
    message = PointCloud.FromString(data)
    table = np.frombuffer(message.data, "<f4").reshape(-1, message.point_stride // 4)
    return table[:, :3].copy()


class RopeLine:
    """The rope as a thick line in a few pieces that fade from the head's colour to the tail's."""

    def __init__(self, vertices: int, radius: float) -> None:
        self._message = SceneUpdate()
        entity = self._message.entities.add(id="rope", frame_id=WORLD)
        self._stamp = entity.timestamp
        cuts = np.linspace(0, vertices - 1, min(LINE_PIECES, vertices - 1) + 1).astype(int)
        self._points: list[tuple[int, Any]] = []
        for first, last, rgb in zip(cuts, cuts[1:], gradient(len(cuts) - 1), strict=False):
            line = _add_line(entity, 2 * radius, rgb)
            self._points += [(vertex, line.points.add()) for vertex in range(first, last + 1)]

    def frame(self, log_time: int, points: NDArray[np.float32]) -> SceneUpdate:
        """The message for points (V, 3) m, rounded to ``LINE_STEP``; the next one changes it."""
        rounded = (np.rint(points / LINE_STEP) * LINE_STEP).tolist()
        for vertex, point in self._points:
            point.x, point.y, point.z = rounded[vertex]
        self._stamp.FromNanoseconds(log_time)
        return self._message


def gripper_message(log_time: int, position: NDArray[np.float32]) -> PoseInFrame:
    """The gripper at a position (3,) m, exact float32; its orientation is not used."""
    message = PoseInFrame(frame_id=WORLD)
    message.pose.orientation.w = 1.0
    place = message.pose.position
    place.x, place.y, place.z = position.tolist()
    message.timestamp.FromNanoseconds(log_time)
    return message


def gripper_position(data: bytes) -> tuple[float, float, float]:
    """The position (3,) m in a ``gripper_message``."""
    place = PoseInFrame.FromString(data).pose.position
    return place.x, place.y, place.z


def image_message(log_time: int, image: bytes) -> CompressedImage:
    """The message for an image's file, PNG or JPEG."""
    kind = next(name for start, name in IMAGE_FORMATS.items() if image.startswith(start))
    message = CompressedImage(frame_id=CAMERA[1:], data=image, format=kind)
    message.timestamp.FromNanoseconds(log_time)
    return message


def spline_message(log_time: int, control_points: NDArray[np.float64]) -> SceneUpdate:
    """The spline's control points as spheres, its curve and its control polygon as lines."""
    message = SceneUpdate()
    entity = message.entities.add(id="spline", frame_id=WORLD)
    entity.timestamp.FromNanoseconds(log_time)
    for x, y, z in control_points.tolist():
        sphere = entity.spheres.add(color=_color(CONTROL_RGB))
        sphere.pose.position.x, sphere.pose.position.y, sphere.pose.position.z = x, y, z
        sphere.pose.orientation.w = 1.0
        sphere.size.x = sphere.size.y = sphere.size.z = 0.02
    curve = np.rint(spline_path(control_points, _CURVE) / LINE_STEP) * LINE_STEP
    lines = ((curve, 0.005, SPLINE_RGB), (control_points, 0.002, CONTROL_RGB))
    for points, thickness, rgb in lines:
        line = _add_line(entity, thickness, rgb)
        for x, y, z in points.tolist():
            line.points.add(x=x, y=y, z=z)
    return message


def start_message(log_time: int, rollout: RecordedRollout) -> Log:
    """Action, start and goal state, as a log entry."""
    what = f"#{rollout.number} {rollout.action} by {rollout.source}"
    return log_message(log_time, f"{what}: {rollout.start_state} -> goal {rollout.goal_state}")


def end_message(log_time: int, rollout: RecordedRollout) -> Log:
    """Outcome and state reached, as a log entry."""
    reached = rollout.end_state or "no readable state"
    levels = {"success": Log.INFO, "failure": Log.WARNING, "diverged": Log.ERROR}
    text = f"#{rollout.number} {rollout.action} {rollout.outcome.upper()}: reached {reached}"
    return log_message(log_time, text, levels[rollout.outcome])


def log_message(log_time: int, text: str, level: Any = Log.INFO) -> Log:
    """An event in words."""
    message = Log(level=level, message=text, name="topology")
    message.timestamp.FromNanoseconds(log_time)
    return message


def root_frame(log_time: int) -> FrameTransforms:
    """The world as a child of Rerun's root frame; without it Rerun's 3-D view stays empty."""
    message = FrameTransforms()
    transform = message.transforms.add(parent_frame_id="tf#/", child_frame_id=WORLD)
    transform.rotation.w = 1.0
    transform.timestamp.FromNanoseconds(log_time)
    return message


def _add_line(entity: Any, thickness: float, rgb: Any) -> Any:
    strip = LinePrimitive.LINE_STRIP
    line = entity.lines.add(type=strip, thickness=thickness, color=_color(rgb))
    line.pose.orientation.w = 1.0
    return line


def _color(rgb: Any) -> Color:
    red, green, blue = (float(part) / 255 for part in rgb)
    return Color(r=red, g=green, b=blue, a=1.0)
