"""How every stage keeps what it simulates."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from knotflow.recording import RecordedRollout, recorded, write_recording
from knotflow.simulation import Attempts, RopeConfig
from knotflow.workflow.context import StageContext


class Recorder:
    """Collects attempts (it is an `Observer`) until they are saved as one recording.

    Args:
        context: of the stage that simulates.
        source: who proposed the splines.
        rope: the rope they were executed on.
        first_number: number of the first rollout; numbers are unique inside a stage.
    """

    def __init__(
        self, context: StageContext, source: str, rope: RopeConfig, first_number: int = 0
    ) -> None:
        self._context, self._source, self._rope = context, source, rope
        self._number = first_number
        self._batches: list[tuple[Attempts, Mapping[str, str]]] = []
        self.extra: Mapping[str, str] = {}
        """Kept with each attempt that is seen from now on."""

    def __call__(self, attempts: Attempts) -> None:
        """Take a batch."""
        self._batches.append((attempts, self.extra))

    def __len__(self) -> int:
        """Attempts seen since the last save."""
        return sum(len(attempts) for attempts, _ in self._batches)

    def save(self, name: str) -> None:
        """Write everything seen so far, if anything, to `name` in the stage's folder; forget it."""
        if self._batches:
            facts = {"source": self._source, "signature": self._context.signature}
            with self._context.atomic(name) as path:
                write_recording(path, self._rollouts(), facts)
        self._batches = []

    def _rollouts(self) -> Iterator[RecordedRollout]:
        for attempts, extra in self._batches:
            yield from recorded(
                attempts, self._rope, self._source, self._context.signature, self._number, extra
            )
            self._number += len(attempts)
