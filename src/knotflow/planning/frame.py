"""Frames of a rope that was measured: the plan's, the table's and that of its file."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from knotflow.topology.polyline import Floats

if TYPE_CHECKING:
    from knotflow.simulation import Attempts

METRES = {"m": 1.0, "cm": 0.01, "mm": 0.001}
"""Units of a file's numbers, in metres."""


@dataclass(frozen=True, eq=False)
class Frame:
    """Where a plan's coordinates, metres, table at z = 0, lie in the frame of a rope's file.

    Attributes:
        rotation: (3, 3) columns are the plan's axes in the file's frame.
        height: z of the table in the file's frame, turned so that the table is level, metres.
        unit: of the file's numbers.
    """

    rotation: Floats = field(default_factory=lambda: np.eye(3))
    height: float = 0.0
    unit: str = "m"

    def __post_init__(self) -> None:
        if self.unit not in METRES:
            raise ValueError(f"unknown unit {self.unit!r}; there are {', '.join(METRES)}")

    def to_file(self, points: ArrayLike) -> Floats:
        """Points (..., 3) of the plan in the file's frame and unit."""
        raised = np.asarray(points, float) + [0.0, 0.0, self.height]
        return np.asarray(raised @ self.rotation.T / METRES[self.unit])

    def from_file(self, points: ArrayLike) -> Floats:
        """The inverse of `to_file`."""
        turned = np.asarray(points, float) * METRES[self.unit] @ self.rotation
        return np.asarray(turned - [0.0, 0.0, self.height])

    def turned(self, quaternions: Floats) -> Floats:
        """Quaternions (..., 4), w x y z, of the plan in the file's frame."""
        from scipy.spatial.transform import Rotation  # slow to import

        turn = Rotation.from_matrix(self.rotation)
        found = turn * Rotation.from_quat(quaternions, scalar_first=True)
        return np.asarray(found.as_quat(scalar_first=True))

    def to_json(self) -> dict[str, Any]:
        return {"unit": self.unit, "height_m": self.height, "rotation": self.rotation.tolist()}

    @classmethod
    def from_json(cls, data: dict[str, Any]) -> Frame:
        return cls(np.array(data["rotation"], float), float(data["height_m"]), data["unit"])


@dataclass(frozen=True)
class Placement:
    """Where a model rope of 1 m, planned for about the origin, lies on the table."""

    length: float = 1.0
    """Of the rope, metres."""
    x: float = 0.0
    y: float = 0.0
    """Of the origin of the model rope's frame, metres."""

    def points(self, points: Any) -> Any:
        """Points (..., 3) of the model on the table, metres."""
        placed = self.length * points + np.array([self.x, self.y, 0.0])
        return placed.astype(points.dtype)

    def splines(self, splines: Floats) -> Floats:
        """Splines (..., 6)."""
        scale = np.array([1.0, *[self.length] * 5])
        return np.asarray(splines * scale + [0.0, self.x, self.y, 0.0, self.x, self.y])

    def times(self, times: Any) -> Any:
        """Seconds; gravity is that of the model."""
        return times * np.sqrt(self.length)

    def attempts(self, attempts: Attempts) -> Attempts:
        """Recorded attempts."""
        rollouts = attempts.rollouts
        placed = replace(
            rollouts,
            times=self.times(rollouts.times),
            trajectory=self.points(rollouts.trajectory),
            gripper=self.points(rollouts.gripper),
            release_times=self.times(rollouts.release_times),
            end_points=self.points(rollouts.end_points),
        )
        points, splines = self.points(attempts.points), self.splines(attempts.splines)
        return replace(attempts, points=points, splines=splines, rollouts=placed)
