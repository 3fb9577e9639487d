"""One recorded rollout: a spline executed on a rope, and what came of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from knotflow.arrays import floats

Outcome = Literal["success", "failure", "diverged"]
OUTCOMES: tuple[str, ...] = get_args(Outcome)

NANOSECONDS = 1_000_000_000


@dataclass(frozen=True, eq=False)
class RolloutImages:
    """What a camera saw of a rollout, and what was made of it.

    Attributes:
        images: of every frame, each the bytes of a PNG or JPEG file.
        points: (T, V, 3) m float32, the rope as it was estimated from them, head first.
        reference: (T, V, 3) m float32, the rope as it was wanted; None where nobody said.

    Raises:
        ValueError: images that are neither, or not one for each estimate and reference.
    """

    images: tuple[bytes, ...]
    points: NDArray[np.float32]
    reference: NDArray[np.float32] | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "points", np.asarray(self.points, np.float32))
        if self.points.ndim != 3 or len(self.images) != len(self.points):
            raise ValueError(
                f"a rollout has as many images as estimates (T, V, 3), got {len(self.images)} and "
                f"{self.points.shape}"
            )
        if self.reference is not None:
            object.__setattr__(self, "reference", np.asarray(self.reference, np.float32))
            if self.reference.shape != self.points.shape:
                raise ValueError(
                    f"a reference is as many ropes as estimates, got {self.reference.shape} and "
                    f"{self.points.shape}"
                )
        for frame, image in enumerate(self.images):
            if not image.startswith(tuple(IMAGE_FORMATS)):
                raise ValueError(f"image {frame} of a rollout is neither a PNG nor a JPEG file")


IMAGE_FORMATS = {b"\x89PNG": "png", b"\xff\xd8": "jpeg"}
"""First bytes of an image's file -> its format."""


@dataclass(frozen=True, eq=False)
class RecordedRollout:
    """A rollout as every stage records it (Sec. IV and V of the paper name the parts).

    Trajectories are kept in float32 (a micrometre over 10 m) and times in whole nanoseconds, as
    they are on disk, so what is read equals what was written bit for bit. Lengths are metres in
    the world frame, z up.

    Attributes:
        times: (T,) s float64, strictly increasing, rounded to whole nanoseconds.
        points: (T, V, 3) m float32, rope vertices, head first.
        gripper: (T, 3) m float32.
        control_points: (3, 3) m float64, of the clamped quadratic B-spline the gripper follows.
        spline: (6,) float64, the action's parameters (Sec. V).
        action: topological action as compact text, e.g. ``"C(2,0,1)"``.
        start_state: topological state before, as compact text.
        goal_state: state the action should lead to.
        end_state: state reached; "" when it could not be read from the rope.
        outcome: "success", "failure" or "diverged" (the simulation blew up).
        signature: config signature of the stage that made it.
        source: who proposed the spline, e.g. "scripted", "random", "icp", "plan".
        number: unique inside a stage.
        extra: anything else worth keeping, as text.
        camera: what one saw, with a frame for each of `times`; None where there was none.

    Raises:
        ValueError: a shape is wrong, times do not increase, the outcome is unknown, or a number
            is not finite (only a diverged trajectory may hold NaN or infinities).
    """

    times: NDArray[np.float64]
    points: NDArray[np.float32]
    gripper: NDArray[np.float32]
    control_points: NDArray[np.float64]
    spline: NDArray[np.float64]
    action: str
    start_state: str
    goal_state: str
    end_state: str
    outcome: Outcome
    signature: str
    source: str
    number: int
    extra: Mapping[str, str] = field(default_factory=dict)
    camera: RolloutImages | None = None

    def __post_init__(self) -> None:
        for name, dtype in _DTYPES.items():
            with np.errstate(over="ignore"):  # a diverged rope may lie beyond float32: infinity
                given = floats(getattr(self, name), f"rollout {self.number}: {name}")
                object.__setattr__(self, name, given.astype(dtype, copy=False))
        self._check_shapes()
        self._check_values()
        object.__setattr__(self, "times", self.times_ns / NANOSECONDS)

    def _check_shapes(self) -> None:
        frames = self.times.shape[0] if self.times.ndim == 1 else 0
        vertices = self.points.shape[1] if self.points.ndim == 3 else 0
        wanted: dict[str, tuple[int, ...]] = {
            "times": (frames,),
            "points": (frames, vertices, 3),
            "gripper": (frames, 3),
            "control_points": (3, 3),
            "spline": (6,),
        }
        for name, shape in wanted.items():
            got = getattr(self, name).shape
            if got != shape or 0 in got or (name == "points" and vertices < 2):
                raise ValueError(
                    f"rollout {self.number}: {name} has shape {got}, needs {_SHAPES[name]} with "
                    "T >= 1 frames (those of times) and V >= 2 vertices"
                )

        if self.camera is not None and len(self.camera.images) != frames:
            raise ValueError(
                f"rollout {self.number}: a camera saw {len(self.camera.images)} of {frames} frames"
            )

    def _check_values(self) -> None:
        if self.outcome not in OUTCOMES:
            raise ValueError(
                f"rollout {self.number}: unknown outcome {self.outcome!r}, choose one of "
                + ", ".join(OUTCOMES)
            )
        finite = ["times", "control_points", "spline"]
        if self.outcome != "diverged":
            finite += ["points", "gripper"]
        for name in finite:
            bad = np.argwhere(~np.isfinite(getattr(self, name)))
            if len(bad):
                raise ValueError(
                    f"rollout {self.number}: {name}{bad[0].tolist()} is not finite "
                    "(only points and gripper of a diverged rollout may be)"
                )
        if np.any(np.diff(self.times_ns) <= 0):
            raise ValueError(f"rollout {self.number}: times must increase by at least 1 ns a frame")

    @property
    def times_ns(self) -> NDArray[np.int64]:
        """``times`` as whole nanoseconds, (T,)."""
        return np.rint(self.times * NANOSECONDS).astype(np.int64)


_DTYPES: dict[str, Any] = {
    "times": np.float64,
    "points": np.float32,
    "gripper": np.float32,
    "control_points": np.float64,
    "spline": np.float64,
}
_SHAPES = {
    "times": "(T,)",
    "points": "(T, V, 3)",
    "gripper": "(T, 3)",
    "control_points": "(3, 3)",
    "spline": "(6,)",
}
