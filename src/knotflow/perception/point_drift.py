"""The classical yardstick of tracking: coherent point drift with the rope's length preserved.

The vertices are the centres of a Gaussian mixture that the rope's points in the image are drawn
from; expectation and maximisation move them to the points, neighbours along the rope together
(Myronenko and Song, Point Set Registration: Coherent Point Drift, PAMI 2010). As TrackDLO does
(Xiang, Dinkel, Zhao, Gao, Coltin, Smith and Bretl, RA-L 2023), neighbourhood is along the rope and
not in space, vertices far from all points count as hidden and go along with their neighbours, and
the rope's length is kept. It knows no gripper, as they do not, and takes over and under from depth.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from knotflow.perception.camera import Camera
from knotflow.perception.estimation import RopeEstimate
from knotflow.perception.evidence import explained, observe, seen
from knotflow.perception.fitting import project_lengths
from knotflow.perception.image import RgbdImage
from knotflow.perception.losses import Target
from knotflow.perception.motion import go_on
from knotflow.simulation import RopeConfig, state_or_none

Floats = NDArray[np.float64]


@dataclass
class PointDriftConfig:
    """Coherent point drift.

    Stiffness, coherence and first deviation were tuned on eight rollouts, one of each action, of
    ropes of level 1 and a seed of their own, for the error in motion without prediction and at the
    end: 33 mm, where a stiffness of 1/m^2 with a coherence of 0.1 m had 88 mm. Three times less or
    ten times more stiffness, a coherence of 0.2 or 0.4 m, more points or iterations and another
    visibility change it by a few millimetres or for the worse.
    """

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
    """Whether the rope is first moved on as the tracker does it, with the gripper that holds it."""


class PointDriftTracker:
    """Follows one rope, with the methods of `Tracker`."""

    def __init__(
        self,
        camera: Camera,
        rope: RopeConfig,
        initial: NDArray,
        config: PointDriftConfig | None = None,
    ) -> None:
        """Take up a rope (V, 3), metres, head first."""
        self.camera, self.rope, self.config = camera, rope, config or PointDriftConfig()
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
            start = go_on(start, self._velocities, seconds, gripper, grasped)
        target = observe(image, self.camera, self.rope)
        cloud = rope_points(image, target, self.camera, self.rope, self.config.points)
        shape = drift(start, cloud, self.rope, self.config)
        if seconds > 0:
            self._velocities = (shape - self.points) / seconds
        self.points = shape
        share = explained(shape, target, self.camera, self.rope)
        shown = seen(shape, target.rope.numpy(), image, self.camera, self.rope)
        unknown = np.full(len(shape), np.nan)
        return RopeEstimate(shape.copy(), shown, state_or_none(shape), (), share, unknown, True, ())


def rope_points(
    image: RgbdImage, target: Target, camera: Camera, rope: RopeConfig, count: int
) -> Floats:
    """At most `count` points (N, 3) of the rope's axis, metres: below its surface in the image by
    what the upper half of a round rope is higher than its axis on average."""
    row, column = np.nonzero(target.rope.numpy() & np.isfinite(image.depth))
    chosen = np.linspace(0, len(row) - 1, min(count, len(row))).astype(int)
    row, column = row[chosen], column[chosen]
    depth = image.depth[row, column].astype(np.float64) + 0.25 * np.pi * rope.radius
    return camera.unproject(np.stack([column, row], axis=1), depth)


def drift(start: Floats, cloud: Floats, rope: RopeConfig, config: PointDriftConfig) -> Floats:
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
