"""What can be wrong with a file that should hold recorded rollouts."""

from __future__ import annotations

from pathlib import Path


class NotARecordingError(ValueError):
    """The file is no MCAP at all, or an MCAP in which no rollout was ever recorded."""


class TruncatedRecordingWarning(UserWarning):
    """A recording was cut or damaged: whole rollouts were read, the rest is lost.

    Attributes:
        path: the damaged file.
        byte: offset of the first record that could not be read whole.
        rollouts_read: rollouts recovered whole.
        rollouts_lost: rollouts the file announces but does not hold whole.
        messages_lost: trajectory messages known to be missing or dropped with those rollouts.
    """

    def __init__(
        self,
        path: Path,
        byte: int,
        reason: str,
        *,
        rollouts_read: int,
        rollouts_lost: int,
        messages_lost: int,
    ) -> None:
        self.path = path
        self.byte = byte
        self.reason = reason
        self.rollouts_read = rollouts_read
        self.rollouts_lost = rollouts_lost
        self.messages_lost = messages_lost
        super().__init__(
            f"{path} is damaged at byte {byte}: {reason}. {rollouts_read} rollouts were read "
            f"whole; known to be lost are {rollouts_lost} rollouts with {messages_lost} messages, "
            "and what else the unreadable bytes held"
        )
