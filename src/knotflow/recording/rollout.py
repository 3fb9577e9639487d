"""One recorded rollout: a spline executed on a rope, its trajectory and its outcome."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from knotflow.arrays import floats
from knotflow.simulation import Attempts, RopeConfig, control_points

Outcome = Literal["success", "failure", "diverged"]

NANOSECONDS = 1_000_000_000
IMAGE_FORMATS = {b"\x89PNG": "png", b"\xff\xd8": "jpeg"}
"""First bytes of an image's file -> its format."""

_TYPES = {"times": np.float64, "points": np.float32, "gripper": np.float32}
_TYPES |= {"control_points": np.float64, "spline": np.float64}


@dataclass(frozen=True, eq=False)
class RolloutImages:
    """A camera's images of a rollout, and the rope estimated from them.

    Raises:
        ValueError: not one image for each estimate.
    """

    images: tuple[bytes, ...]  # of every frame, each the bytes of a PNG or JPEG file
    points: NDArray[np.float32]  # (T, V, 3) m, the estimated rope, head first
    reference: NDArray[np.float32] | None = None  # (T, V, 3) m, as planned, where there is a plan

    def __post_init__(self) -> None:
        if self.points.ndim != 3 or len(self.images) != len(self.points):
            raise ValueError(
                f"a rollout has as many images as estimates (T, V, 3), got {len(self.images)} and "
                f"{self.points.shape}"
            )


@dataclass(frozen=True, eq=False)
class RecordedRollout:
    """A recorded rollout; what is read equals what was written bit for bit.

    Lengths are metres in the world frame, z up; states and action are compact texts.

    Raises:
        ValueError: a shape is wrong, or times do not increase.
    """

    times: NDArray[np.float64]  # (T,) s, strictly increasing, rounded to whole nanoseconds
    points: NDArray[np.float32]  # (T, V, 3) rope vertices, head first
    gripper: NDArray[np.float32]  # (T, 3)
    control_points: NDArray[np.float64]  # (3, 3) of the spline the gripper follows
    spline: NDArray[np.float64]  # (6,) the action's parameters (Sec. V)
    action: str
    start_state: str
    goal_state: str  # the action should lead to
    end_state: str  # reached; "" when it could not be read from the rope
    outcome: Outcome
    signature: str  # key of the stage that made it
    source: str  # who proposed the spline, e.g. "scripted", "random", "icp", "plan"
    number: int  # unique inside a stage
    extra: Mapping[str, str] = field(default_factory=dict)  # further facts, as text
    camera: RolloutImages | None = None  # an image for each of `times`

    def __post_init__(self) -> None:
        this = f"rollout {self.number}"
        for name, kind in _TYPES.items():
            with np.errstate(over="ignore"):  # a diverged rope may lie beyond float32: infinity
                given = floats(getattr(self, name), f"{this}: {name}").astype(kind, copy=False)
            object.__setattr__(self, name, given)
        frames, vertices = self.times.size, self.points.shape[1:2]
        shapes: dict[str, tuple[int, ...]] = {"times": (frames,), "points": (frames, *vertices, 3)}
        shapes |= {"gripper": (frames, 3), "control_points": (3, 3), "spline": (6,)}
        for name, shape in shapes.items():
            given = getattr(self, name)
            if given.shape != shape or not given.size:
                raise ValueError(f"{this}: {name} has shape {given.shape}, needs {shape}")
        seen = frames if self.camera is None else len(self.camera.images)
        if seen != frames:
            raise ValueError(f"{this}: a camera saw {seen} of {frames} frames")
        if np.any(np.diff(self.times_ns) <= 0):
            raise ValueError(f"{this}: times must increase by at least 1 ns a frame")
        object.__setattr__(self, "times", self.times_ns / NANOSECONDS)

    @property
    def times_ns(self) -> NDArray[np.int64]:
        """``times`` as whole nanoseconds, (T,)."""
        return np.rint(self.times * NANOSECONDS).astype(np.int64)


def recorded(
    attempts: Attempts,
    rope: RopeConfig,
    source: str,
    signature: str,
    first_number: int = 0,
    extra: Mapping[str, str] | None = None,
) -> Iterator[RecordedRollout]:
    """Attempts at an action as recorded rollouts, numbered from `first_number` on."""
    controls = control_points(attempts.points, attempts.splines, rope.radius)
    rollouts, success, goal = attempts.rollouts, attempts.success, str(attempts.goal)
    for i, end in enumerate(attempts.ends):
        outcome: Outcome = "success" if success[i] else "failure"
        motion = rollouts.motion(i)
        yield RecordedRollout(
            times=motion.times,
            points=motion.trajectory,
            gripper=motion.gripper,
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
