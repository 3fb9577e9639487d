"""Reading recorded rollouts back, with the mcap library and every checksum compared.

``write_recording`` makes a file appear only when it is complete, so a cut or changed one is an
error here, and its repair is left to the mcap command (`mcap recover`).
"""

from __future__ import annotations

import os
import struct
import warnings
from bisect import bisect_right
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import zstandard
from google.protobuf.message import DecodeError
from mcap.exceptions import McapError
from mcap.reader import NonSeekingReader
from mcap.writer import MCAP0_MAGIC as MAGIC

from . import topics
from .facts import Facts, RolloutMessage
from .scene import cloud_points, gripper_position, image_file
from .schema import RecordedRollout, RolloutImages

# What mcap and the codecs under it raise on bytes that are not as they were written.
_UNREADABLE = (
    McapError,
    DecodeError,
    struct.error,
    zstandard.ZstdError,
    ValueError,
    LookupError,
    OverflowError,
    MemoryError,
)


class NotARecordingError(ValueError):
    """The file is no MCAP at all, or an MCAP in which no rollout was ever recorded."""


class DamagedRecordingError(ValueError):
    """A recording was cut or changed after it was written; says how to save what is left."""

    def __init__(self, path: Path, reason: object) -> None:
        super().__init__(
            f"{path} is damaged: {reason}. What can be saved of it is saved by "
            f"`mcap recover {path.name} -o recovered.mcap` (https://mcap.dev/guides/cli)"
        )


def read_recording(path: str | os.PathLike[str]) -> Iterator[RecordedRollout]:
    """The rollouts of a recording, in file order, one in memory at a time.

    Trajectories come back as the exact float32 numbers that were written, splines and control
    points as the exact float64, times to 1 ns. A recovered file may announce rollouts whose
    frames are lost: these are left out, with a warning that counts them.

    Raises:
        FileNotFoundError: there is no such file (raised at once, not at the first rollout).
        NotARecordingError: it is no MCAP (at once), or holds no whole rollout.
        DamagedRecordingError: it is cut (at once), or a checksum is wrong (where this is met).
    """
    return (rollout for _, rollout in read_with_facts(path))


def read_with_facts(path: str | os.PathLike[str]) -> Iterator[tuple[Facts, RecordedRollout]]:
    """The same as ``read_recording``, each rollout with the facts that say where it lies."""
    return _rollouts(existing_recording(path))


def read_metadata(path: str | os.PathLike[str]) -> dict[str, str]:
    """The metadata given to ``write_recording``.

    Raises:
        FileNotFoundError, NotARecordingError, DamagedRecordingError: as for ``read_recording``.
    """
    file = existing_recording(path)
    with file.open("rb") as stream, damage_named(file):
        for record in NonSeekingReader(stream).iter_metadata():  # they precede the first message
            if record.name == topics.METADATA:
                return dict(record.metadata)
    return {}


def existing_recording(path: str | os.PathLike[str]) -> Path:
    """The path of a file that is there and begins and ends as an MCAP.

    Raises:
        FileNotFoundError, NotARecordingError, DamagedRecordingError: it does not.
    """
    file = Path(path)
    if not file.is_file():
        near = sorted(other.name for other in file.parent.glob("*.mcap"))
        there = f"; recordings beside it: {', '.join(near)}" if near else ""
        kind = "a folder, not a file" if file.is_dir() else "not there"
        raise FileNotFoundError(f"recording {file} is {kind}{there}")
    with file.open("rb") as stream:
        begin = stream.read(len(MAGIC))
        if not MAGIC.startswith(begin):  # a cut one may begin with less
            raise NotARecordingError(
                f"{file} is not an MCAP file: it begins with {begin!r} instead of {MAGIC!r}"
            )
        size = stream.seek(0, os.SEEK_END)
        stream.seek(max(len(begin), size - len(MAGIC)))
        if stream.read() != MAGIC:
            raise DamagedRecordingError(file, f"it is cut after {size} bytes")
    return file


@contextmanager
def damage_named(path: Path) -> Iterator[None]:
    """Turns whatever the mcap library trips over into a ``DamagedRecordingError``."""
    try:
        yield
    except _UNREADABLE as error:
        raise DamagedRecordingError(path, str(error) or type(error).__name__) from error


@dataclass
class _Assembly:
    """A rollout whose frames are still coming in."""

    facts: Facts
    log_times: list[int] = field(default_factory=list)
    points: list[np.ndarray] = field(default_factory=list)
    gripper: list[tuple[float, float, float]] = field(default_factory=list)
    images: list[bytes] = field(default_factory=list)
    estimates: list[np.ndarray] = field(default_factory=list)
    references: list[np.ndarray] = field(default_factory=list)

    @property
    def whole(self) -> bool:
        return len(self.points) == len(self.gripper) == self.facts.frames

    def add(self, topic: str, log_time: int, data: bytes) -> None:
        if topic == topics.ROPE:
            self.points.append(cloud_points(data))
            self.log_times.append(log_time)
        elif topic == topics.GRIPPER:
            self.gripper.append(gripper_position(data))
        elif topic == topics.CAMERA:
            self.images.append(image_file(data))
        elif topic == topics.ESTIMATE:
            self.estimates.append(cloud_points(data))
        else:
            self.references.append(cloud_points(data))

    def rollout(self) -> RecordedRollout:
        whole = self.facts.rollout(self.log_times, np.array(self.points), np.array(self.gripper))
        if not self.images:
            return whole
        reference = np.array(self.references) if self.references else None
        seen = RolloutImages(tuple(self.images), np.array(self.estimates), reference)
        return replace(whole, camera=seen)


def _rollouts(path: Path) -> Iterator[tuple[Facts, RecordedRollout]]:
    waiting: list[_Assembly] = []  # by start time, which is also the order of the file
    read = 0
    for topic, log_time, data in _messages(path):
        with damage_named(path):
            if topic == topics.ROLLOUT:
                waiting.append(_Assembly(Facts(RolloutMessage.FromString(data))))
                continue
            owner = _owner(waiting, log_time)
            if owner is None:
                continue  # a recovered file may have lost the facts of these frames
            owner.add(topic, log_time, data)
            if not owner.whole:
                continue
            waiting.remove(owner)
            rollout = owner.rollout()
        read += 1
        yield owner.facts, rollout
    if read == 0:
        raise NotARecordingError(
            f"{path} is an MCAP without a single whole rollout: a recording has the topics "
            f"{topics.ROLLOUT}, {topics.ROPE} and {topics.GRIPPER}"
        )
    if waiting:
        warnings.warn(
            f"{path} announces {len(waiting)} rollouts without all of their frames, as recovered "
            f"recordings do; {read} whole ones were read",
            stacklevel=2,
        )


def _messages(path: Path) -> Iterator[tuple[str, int, bytes]]:
    """Topic, log time in ns and encoded data of each message with facts or a frame."""
    seen = (topics.CAMERA, topics.ESTIMATE, topics.REFERENCE)
    wanted = (topics.ROLLOUT, topics.ROPE, topics.GRIPPER, *seen)
    with path.open("rb") as stream, damage_named(path):
        reader = NonSeekingReader(stream, validate_crcs=True)  # reads nothing unchecked
        for _, channel, message in reader.iter_messages(wanted, log_time_order=False):
            yield channel.topic, message.log_time, message.data


def _owner(waiting: list[_Assembly], log_time: int) -> _Assembly | None:
    """The rollout in whose time a frame lies, if the file still has its facts."""
    at = bisect_right(waiting, log_time, key=lambda assembly: assembly.facts.start_ns) - 1
    if at < 0 or log_time > waiting[at].facts.end_ns:
        return None
    return waiting[at]
