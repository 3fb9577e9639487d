"""What can be watched: a plan's steps one after the other, or one simulated spline."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from knotflow.planning import KnotPlan
from knotflow.simulation import Attempts, control_points


@dataclass(frozen=True, eq=False)
class Playback:
    """Frames in a row, metres and seconds.

    Attributes:
        times: (T,) of the frames; a step begins where the one before has ended.
        ropes: (T, V, 3) the rope.
        grippers: (T, 3) the gripper.
        step: (T,) index of the step that a frame belongs to.
        captions: of each step.
        controls: (n, 3, 3) the control points of each step's spline.
    """

    times: NDArray[np.float64]
    ropes: NDArray[np.float32]
    grippers: NDArray[np.float32]
    step: NDArray[np.intp]
    captions: tuple[str, ...]
    controls: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.times)

    def caption(self, frame: int) -> str:
        """The step of a frame, and its time."""
        return f"{self.times[frame]:.1f} s: {self.captions[self.step[frame]]}"

    @classmethod
    def of_plan(cls, plan: KnotPlan) -> Playback | None:
        """A plan's steps, to which it must have its trajectories; None if it has no step."""
        if not plan.steps:
            return None
        ends = np.cumsum([0.0, *(step.times[-1] for step in plan.steps)])
        return cls(
            times=np.concatenate([s.times + t for s, t in zip(plan.steps, ends, strict=False)]),
            ropes=np.concatenate([step.trajectory for step in plan.steps]),
            grippers=np.concatenate([step.gripper for step in plan.steps]),
            step=np.repeat(np.arange(len(plan.steps)), [len(s.times) for s in plan.steps]),
            captions=tuple(
                f"step {number} of {len(plan.steps)}, {step.action}, to {step.end_state}"
                for number, step in enumerate(plan.steps, 1)
            ),
            controls=plan.controls,
        )

    @classmethod
    def of_attempt(cls, attempts: Attempts, row: int, radius: float) -> Playback:
        """One spline of a batch, on a rope of that radius."""
        rollouts = attempts.rollouts
        end = attempts.ends[row]
        outcome = "unreadable" if end is None else str(end)
        return cls(
            times=rollouts.times,
            ropes=rollouts.trajectory[row],
            grippers=rollouts.gripper[row],
            step=np.zeros(len(rollouts.times), np.intp),
            captions=(f"{attempts.action}, ends in {outcome}",),
            controls=control_points(attempts.points[row], attempts.splines[row], radius)[None],
        )
