"""From attempts at an action to recorded rollouts."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from knotflow.recording.schema import Outcome, RecordedRollout
from knotflow.simulation import Attempts, RopeConfig, control_points


def recorded(
    attempts: Attempts,
    rope: RopeConfig,
    source: str,
    signature: str,
    first_number: int = 0,
    extra: Mapping[str, str] | None = None,
) -> Iterator[RecordedRollout]:
    """Attempts as recorded rollouts, numbered from `first_number` on."""
    controls = control_points(attempts.points, attempts.splines, rope.radius)
    rollouts, success, goal = attempts.rollouts, attempts.success, str(attempts.goal)
    for i, end in enumerate(attempts.ends):
        outcome: Outcome = "success" if success[i] else "failure"
        yield RecordedRollout(
            times=rollouts.times,
            points=rollouts.trajectory[i],
            gripper=rollouts.gripper[i],
            control_points=controls[i],
            spline=attempts.splines[i],
            action=str(attempts.action),
            start_state=str(attempts.start),
            goal_state=goal,
            end_state="" if end is None else str(end),
            outcome="diverged" if rollouts.diverged[i] else outcome,
            signature=signature,
            source=source,
            number=first_number + i,
            extra=extra or {},
        )
