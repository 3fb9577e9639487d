"""Writing a recording: one MCAP that appears under its name only when it is complete.

Rollouts lie one after the other on one timeline. The ``knotflow.Rollout`` messages of a batch
stand in a chunk of their own *before* the trajectories, so that tables are read without these.
"""

from __future__ import annotations

import os
import time
from collections.abc import Iterable, Mapping
from functools import cache
from itertools import chain, islice
from pathlib import Path
from typing import IO

import numpy as np
from google.protobuf.message import Message
from mcap.writer import Writer
from mcap_protobuf.schema import register_schema
from numpy.typing import NDArray

from . import messages
from .rollout import NANOSECONDS, RecordedRollout, RolloutImages

KEPT_EVERY_NS = NANOSECONDS  # of a run's motions, at most so much is lost with the process
GAP_NS = NANOSECONDS // 2  # between two rollouts on the timeline
BATCH = 32  # rollouts that share a chunk of facts; also what the writer holds in memory


def write_recording(
    path: str | os.PathLike[str],
    rollouts: Iterable[RecordedRollout],
    metadata: Mapping[str, str],
    *,
    rope_line: bool = True,
) -> None:
    """Write rollouts to one MCAP file, all or nothing: under another name, renamed when complete.

    The rollouts, at least one and with different numbers, are taken ``BATCH`` at a time; `metadata`
    are facts about the whole file. With `rope_line`, in files of up to ``BATCH`` rollouts, the
    rope is also drawn as a thick line, a quarter of the file.

    Raises:
        ValueError: no rollout, or two of the same number.
        OSError: the file could not be written, e.g. the disk is full; nothing is left behind.
    """
    target, remaining = Path(path), iter(rollouts)
    target.parent.mkdir(parents=True, exist_ok=True)
    partial = target.with_name(f".{target.name}.partial")
    batches = iter(lambda: list(islice(remaining, BATCH)), [])
    try:
        with partial.open("wb") as stream:
            first, second = next(batches, []), next(batches, [])
            if not first:
                raise ValueError("a recording needs at least one rollout, got none")
            mcap = _Timeline(stream, metadata, rope_line and not second)
            for batch in filter(None, chain((first, second), batches)):
                mcap.add(batch)
            mcap.writer.finish()
        partial.replace(target)
    except BaseException:
        partial.unlink(missing_ok=True)
        raise


class _Messages:
    """An MCAP in the making."""

    def __init__(self, stream: IO[bytes], metadata: Mapping[str, str]) -> None:
        self.writer = Writer(stream)  # chunks of 1 MiB, zstd
        self.writer.start(profile="knotflow")
        self.writer.add_metadata(messages.METADATA, dict(metadata))
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}
        self._cloud = cache(messages.RopeCloud)
        self._log(messages.FRAMES, 0, messages.root_frame(0))

    def _log(self, topic: str, log_time: int, message: Message) -> None:
        if topic not in self._channels:
            kind = type(message)
            name = kind.DESCRIPTOR.full_name
            if name not in self._schemas:
                self._schemas[name] = register_schema(self.writer, kind)
            channel = self.writer.register_channel(topic, "protobuf", self._schemas[name])
            self._channels[topic] = channel
        data = message.SerializeToString()
        self.writer.add_message(self._channels[topic], log_time, data, publish_time=log_time)


class RunLog(_Messages):
    """What a robot saw and did, written as it happens; a context, whose end completes the file."""

    def __init__(self, path: Path, metadata: Mapping[str, str]) -> None:
        """Raises FileExistsError where there is a file."""
        path.parent.mkdir(parents=True, exist_ok=True)
        self._stream = path.open("xb")
        self._began, self._kept = time.monotonic_ns(), 0
        super().__init__(self._stream, metadata)

    def __enter__(self) -> RunLog:
        return self

    def __exit__(self, *error: object) -> None:
        try:
            self.writer.finish()
        finally:
            self._stream.close()

    def _keep(self) -> None:
        """Write what is in memory, so that it survives the process."""
        self.writer.flush()
        self._stream.flush()
        self._kept = self._now

    @property
    def _now(self) -> int:
        return time.monotonic_ns() - self._began

    def image(self, jpeg: bytes) -> None:
        """A camera's image."""
        self._log(messages.CAMERA, now := self._now, messages.image_message(now, jpeg))
        self._keep()

    def gripper(self, position: NDArray[np.floating]) -> None:
        """Where the gripper is sent to (3,), metres."""
        sent = np.asarray(position, np.float32)
        self._log(messages.GRIPPER, now := self._now, messages.gripper_message(now, sent))
        if now > self._kept + KEPT_EVERY_NS:
            self._keep()

    def rope(self, points: NDArray[np.floating]) -> None:
        """The rope (V, 3), metres, as it is seen."""
        cloud = self._cloud(len(points))
        frame = cloud.frame(now := self._now, np.asarray(points, np.float32))
        self._log(messages.ESTIMATE, now, frame)

    def say(self, text: str) -> None:
        """An event in words."""
        self._log(messages.TOPOLOGY, now := self._now, messages.log_message(now, text))
        self._keep()


class _Timeline(_Messages):
    """Rollouts one after the other, and the log time at which the next one starts."""

    def __init__(self, stream: IO[bytes], metadata: Mapping[str, str], rope_line: bool) -> None:
        super().__init__(stream, metadata)
        self._line = cache(messages.RopeLine)
        self._rope_line = rope_line
        self._now = 0
        self._numbers: set[int] = set()

    def add(self, batch: list[RecordedRollout]) -> None:
        starts = []
        for rollout in batch:
            if rollout.number in self._numbers:
                raise ValueError(f"two rollouts have the number {rollout.number}")
            self._numbers.add(rollout.number)
            starts.append(self._now)
            facts = messages.encode_rollout(rollout, self._now)
            self._log(messages.ROLLOUT, self._now, facts)
            self._now += facts.duration_ns + GAP_NS
        self.writer.flush()  # the facts' chunk ends here
        for start, rollout in zip(starts, batch, strict=True):
            self._trajectory(start, rollout)
        self.writer.flush()

    def _trajectory(self, start: int, rollout: RecordedRollout) -> None:
        vertices = rollout.points.shape[1]
        cloud = self._cloud(vertices)
        line = self._line(vertices, messages.rope_radius(rollout.control_points))
        self._log(messages.SPLINE, start, messages.spline_message(start, rollout.control_points))
        self._log(messages.TOPOLOGY, start, messages.start_message(start, rollout))
        log_times = (rollout.times_ns - rollout.times_ns[0] + start).tolist()
        for frame, (log_time, points, gripper) in enumerate(
            zip(log_times, rollout.points, rollout.gripper, strict=True)
        ):
            if rollout.camera is not None:  # before the rope: a frame ends with the gripper
                self._camera(log_time, rollout.camera, frame)
            self._log(messages.ROPE, log_time, cloud.frame(log_time, points))
            if self._rope_line:
                self._log(messages.ROPE_LINE, log_time, line.frame(log_time, points))
            self._log(messages.GRIPPER, log_time, messages.gripper_message(log_time, gripper))
        end = log_times[-1]
        self._log(messages.TOPOLOGY, end, messages.end_message(end, rollout))

    def _camera(self, log_time: int, camera: RolloutImages, frame: int) -> None:
        cloud = self._cloud(camera.points.shape[1])
        image = messages.image_message(log_time, camera.images[frame])
        self._log(messages.CAMERA, log_time, image)
        self._log(messages.ESTIMATE, log_time, cloud.frame(log_time, camera.points[frame]))
        if camera.reference is not None:
            reference = cloud.frame(log_time, camera.reference[frame])
            self._log(messages.REFERENCE, log_time, reference)
