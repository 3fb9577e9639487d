"""The machine-readable facts of a rollout, one protobuf message ``knotflow.Rollout`` each.

The facts say everything about a rollout but its trajectory. The message type is put together
here, so no protoc is needed; its descriptor travels in the MCAP, so any tool can decode it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

from .schema import NANOSECONDS, RecordedRollout

_Field = descriptor_pb2.FieldDescriptorProto
_TEXTS = ("action", "start_state", "goal_state", "end_state", "outcome", "signature", "source")
_FIELDS: tuple[tuple[str, int, bool], ...] = (  # name, type, repeated; the order is the file format
    ("number", _Field.TYPE_INT64, False),
    *((name, _Field.TYPE_STRING, False) for name in _TEXTS),
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
    for number, name in enumerate(("key", "value"), start=1):
        entry.field.add(
            name=name, number=number, type=_Field.TYPE_STRING, label=_Field.LABEL_OPTIONAL
        )
    message.field.add(
        name="extra",
        number=len(_FIELDS) + 1,
        type=_Field.TYPE_MESSAGE,
        label=_Field.LABEL_REPEATED,
        type_name=".knotflow.Rollout.ExtraEntry",
    )
    pool = descriptor_pool.DescriptorPool()
    return message_factory.GetMessageClass(pool.Add(file).message_types_by_name["Rollout"])


RolloutMessage = _rollout_class()


@dataclass(frozen=True)
class Facts:
    """A decoded ``knotflow.Rollout``: where the rollout lies in its file, and what it was."""

    message: Any

    @property
    def number(self) -> int:
        """The rollout's number inside its stage."""
        return int(self.message.number)

    @property
    def start_ns(self) -> int:
        """Log time of the first frame."""
        return int(self.message.start_ns)

    @property
    def end_ns(self) -> int:
        """Log time of the last frame."""
        return int(self.message.start_ns + self.message.duration_ns)

    @property
    def frames(self) -> int:
        """Number of frames T."""
        return int(self.message.frames)

    def row(self) -> dict[str, Any]:
        """The facts as one row of the index (see ``index.SCHEMA``), without its file."""
        texts = {name: getattr(self.message, name) for name in _TEXTS}
        return {
            "number": self.number,
            "start_time_s": self.start_ns / NANOSECONDS,
            "duration_s": self.message.duration_ns / NANOSECONDS,
            **dict(zip(SPLINE_COLUMNS, self.message.spline, strict=True)),
            **texts,
            "extra": dict(self.message.extra),
        }

    def rollout(
        self, log_times: list[int], points: np.ndarray, gripper: np.ndarray
    ) -> RecordedRollout:
        """The whole rollout: log_times (T,) ns, points (T, V, 3) m, gripper (T, 3) m."""
        own = np.asarray(log_times, np.int64) - self.start_ns + self.message.first_time_ns
        return RecordedRollout(
            times=own / NANOSECONDS,
            points=points,
            gripper=gripper,
            control_points=np.array(self.message.control_points).reshape(3, 3),
            spline=np.array(self.message.spline),
            number=self.number,
            extra=dict(self.message.extra),
            **{name: getattr(self.message, name) for name in _TEXTS},
        )


SPLINE_COLUMNS = (
    "spline_grasp",
    "spline_mid_x",
    "spline_mid_y",
    "spline_mid_z",
    "spline_end_x",
    "spline_end_y",
)


def facts_message(rollout: RecordedRollout, start_ns: int) -> Any:
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
        **{name: getattr(rollout, name) for name in _TEXTS},
    )
