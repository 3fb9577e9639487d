"""Reading recorded rollouts back, whole ones only, from whole and from damaged files."""

from __future__ import annotations

import os
import warnings
from bisect import bisect_right
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from google.protobuf.message import DecodeError

from . import topics
from .errors import NotARecordingError, TruncatedRecordingWarning
from .facts import Facts, RolloutMessage
from .scan import Damage, LoggedMessage, Scan, check_magic
from .scene import cloud_points, gripper_position
from .schema import RecordedRollout


def read_recording(path: str | os.PathLike[str]) -> Iterator[RecordedRollout]:
    """The rollouts of a recording, in file order, one in memory at a time.

    Trajectories come back as the exact float32 numbers that were written, splines and control
    points as the exact float64, times to 1 ns. In a truncated or damaged file every rollout of
    which all messages can be read is still yielded; a ``TruncatedRecordingWarning`` at the end
    says what was lost and from which byte.

    Raises:
        FileNotFoundError: there is no such file (raised at once, not at the first rollout).
        NotARecordingError: it is no MCAP (at once), or holds no rollouts though it is complete.
    """
    return (rollout for _, rollout in read_with_facts(path))


def read_with_facts(path: str | os.PathLike[str]) -> Iterator[tuple[Facts, RecordedRollout]]:
    """The same as ``read_recording``, each rollout with the facts that say where it lies."""
    return _rollouts(existing_recording(path))


def read_metadata(path: str | os.PathLike[str]) -> dict[str, str]:
    """The metadata given to ``write_recording``.

    Raises:
        FileNotFoundError, NotARecordingError: as for ``read_recording``.
    """
    scan = Scan(existing_recording(path))
    for _ in scan.messages():
        break  # metadata precede the first message
    return dict(scan.metadata.get(topics.METADATA, {}))


def existing_recording(path: str | os.PathLike[str]) -> Path:
    """The path of a file that is there and begins as an MCAP.

    Raises:
        FileNotFoundError, NotARecordingError: it does not.
    """
    file = Path(path)
    if not file.is_file():
        near = sorted(other.name for other in file.parent.glob("*.mcap"))
        there = f"; recordings beside it: {', '.join(near)}" if near else ""
        kind = "a folder, not a file" if file.is_dir() else "not there"
        raise FileNotFoundError(f"recording {file} is {kind}{there}")
    with file.open("rb") as stream:
        check_magic(file, stream)
    return file


@dataclass
class _Assembly:
    """A rollout whose frames are still coming in."""

    facts: Facts
    log_times: list[int] = field(default_factory=list)
    points: list[np.ndarray] = field(default_factory=list)
    gripper: list[tuple[float, float, float]] = field(default_factory=list)

    @property
    def messages(self) -> int:
        return len(self.points) + len(self.gripper)

    @property
    def whole(self) -> bool:
        return self.messages == 2 * self.facts.frames

    def add(self, message: LoggedMessage) -> None:
        if message.topic == topics.ROPE:
            self.points.append(cloud_points(message.data))
            self.log_times.append(message.log_time)
        else:
            self.gripper.append(gripper_position(message.data))

    def rollout(self) -> RecordedRollout:
        return self.facts.rollout(self.log_times, np.array(self.points), np.array(self.gripper))


def _rollouts(path: Path) -> Iterator[tuple[Facts, RecordedRollout]]:
    scan = Scan(path)
    waiting: list[_Assembly] = []  # by start time, which is also the order of the file
    read = orphans = 0  # frames whose facts are lost
    for message in scan.messages():
        try:
            if message.topic == topics.ROLLOUT:
                waiting.append(_Assembly(Facts(RolloutMessage.FromString(message.data))))
                continue
            if message.topic not in (topics.ROPE, topics.GRIPPER):
                continue
            owner = _owner(waiting, message.log_time)
            if owner is None:
                orphans += 1
                continue
            owner.add(message)
        except DecodeError as error:
            scan.damage.append(Damage(scan.at, f"a {message.topic} message is garbled ({error})"))
            continue
        if owner.whole:
            waiting.remove(owner)
            read += 1
            yield owner.facts, owner.rollout()
    missing = sum(2 * assembly.facts.frames for assembly in waiting)
    if (waiting or orphans) and not scan.damage:  # a record was overwritten by another valid one
        scan.damage.append(Damage(scan.at, "messages are missing somewhere before this byte"))
    if scan.damage:
        warnings.warn(
            TruncatedRecordingWarning(
                path,
                *scan.damage[0],
                rollouts_read=read,
                rollouts_lost=len(waiting),
                messages_lost=missing + orphans,
            ),
            stacklevel=2,
        )
    elif read == 0:
        there = ", ".join(sorted(scan.topics.values())) or "none"
        raise NotARecordingError(
            f"{path} is an MCAP without a single whole rollout (topics in it: {there}; a recording "
            f"has {topics.ROLLOUT}, {topics.ROPE} and {topics.GRIPPER})"
        )


def _owner(waiting: list[_Assembly], log_time: int) -> _Assembly | None:
    """The rollout in whose time a frame lies, if the file still has its facts."""
    at = bisect_right(waiting, log_time, key=lambda assembly: assembly.facts.start_ns) - 1
    if at < 0 or log_time > waiting[at].facts.end_ns:
        return None
    return waiting[at]
