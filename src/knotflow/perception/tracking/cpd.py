"""The classical baseline of tracking: coherent point drift (Myronenko and Song, PAMI 2010) with, as
in TrackDLO (Xiang et al., RA-L 2023), neighbours along the rope, hidden vertices and its length."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from knotflow.perception.camera.image import RgbdImage
from knotflow.perception.camera.pinhole import Camera
from knotflow.perception.estimation.chain import project_lengths
from knotflow.perception.estimation.estimate import RopeEstimate
from knotflow.perception.estimation.evidence import coverage_fraction, observe, visible_vertices
from knotflow.perception.tracking.tracker import constant_velocity, rope_points
from knotflow.simulation import RopeConfig, state_or_none

Floats = NDArray[np.float64]


@dataclass
class CpdConfig:
    """Coherent point drift."""

    points: int = 400
    """Points of the rope's image that are registered."""
    iterations: int = 30
    """Of expectation and maximisation."""
    coherence: float = 0.3
    """Length along the rope over which vertices move together, metres."""
    stiffness: float = 3000.0
    """Weight of moving together, 1/m^2: lambda of Myronenko and Song, whose points have unit
    variance, over the variance of the rope's points."""
    deviation: float = 0.06
    """Standard deviation of the points around the vertices at first, metres."""
    outliers: float = 0.05
    """Share of points that belong to no vertex."""
    visible: float = 0.03
    """A vertex farther than about this from all points is hidden, metres."""
    predict: bool = False
    """Whether the rope first moves on as in `Tracker`, with the gripper that holds it."""


class CpdTracker:
    """Follows one rope, with the methods of `Tracker`."""

    def __init__(
        self, camera: Camera, rope: RopeConfig, initial: NDArray, config: CpdConfig | None = None
    ) -> None:
        """Take up a rope (V, 3), metres, head first."""
        self.camera, self.rope, self.config = camera, rope, config or CpdConfig()
        self.points = np.array(initial, np.float64)
        self._velocities = np.zeros_like(self.points)
        self._time: float | None = None

    def update(
        self, image: RgbdImage, gripper: NDArray | None = None, grasped: int | None = None
    ) -> RopeEstimate:
        """The rope in the next image; see `Tracker.update`. Crossings have no certainty."""
        seconds = 0.0 if self._time is None else image.time - self._time
        self._time = image.time
        start = self.points
        if self.config.predict:
            start = constant_velocity(start, self._velocities, seconds, gripper, grasped)
        target = observe(image, self.camera, self.rope)
        cloud = rope_points(image, target, self.camera, self.rope, self.config.points)
        shape = drift(start, cloud, self.rope, self.config)
        if seconds > 0:
            self._velocities = (shape - self.points) / seconds
        self.points = shape
        fraction = coverage_fraction(shape, target, self.camera, self.rope)
        visible = visible_vertices(shape, target.rope.numpy(), image, self.camera, self.rope)
        return RopeEstimate(shape.copy(), visible, state_or_none(shape), (), fraction, True, ())


def drift(start: Floats, cloud: Floats, rope: RopeConfig, config: CpdConfig) -> Floats:
    """The rope near `start` (V, 3) that points (N, 3) belong to, metres.

    Moves are G W with the kernel G; W solves (P1 G + lambda sigma^2) W = P X - P1 Y0 (Myronenko and
    Song, Eq. 22), where P (V, N) are the points' shares in each vertex. Without points it stays.
    """
    if len(cloud) == 0:
        return start
    count = len(start)
    along = np.arange(count) * rope.link_length
    kernel = np.exp(-((along[:, None] - along) ** 2) / (2 * config.coherence**2))  # (V, V)
    near = np.sqrt(_squares(start, cloud).min(axis=1))
    likely = np.exp(-((near / config.visible) ** 2))
    likely /= likely.sum()
    shape, variance = start, config.deviation**2
    box = float(np.prod(np.ptp(cloud, axis=0) + config.deviation))
    for _ in range(config.iterations):
        square = _squares(shape, cloud)
        density = np.exp(-square / (2 * variance)) / (2 * np.pi * variance) ** 1.5
        joint = (1 - config.outliers) * likely[:, None] * density
        share = joint / (joint.sum(axis=0) + config.outliers / box)  # (V, N)
        mass = share.sum(axis=1)
        pull = share @ cloud - mass[:, None] * start
        stiff = config.stiffness * variance * np.eye(count)
        shape = start + kernel @ np.linalg.solve(mass[:, None] * kernel + stiff, pull)
        left = (share * _squares(shape, cloud)).sum() / (3 * max(mass.sum(), 1e-9))
        variance = max(float(left), (0.25 * rope.radius) ** 2)
    shape = project_lengths(shape, rope.link_length)
    shape[:, 2] = np.maximum(shape[:, 2], rope.radius)
    return shape


def _squares(points: Floats, cloud: Floats) -> Floats:
    """Squared distances (V, N)."""
    return ((points[:, None] - cloud) ** 2).sum(axis=2)
