"""A rope followed from image to image (Sec. VI): predicted, registered to its points, and fitted by
a few gradient steps on a grid coarser than the image. A lost rope is estimated from the image.

The classical baseline is coherent point drift (Myronenko and Song, PAMI 2010) with, as in TrackDLO
(Xiang et al., RA-L 2023), neighbours along the rope, hidden vertices and its length.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial.distance import cdist
from torch import Tensor

from knotflow.perception.camera.image import RgbdImage
from knotflow.perception.camera.pinhole import Camera
from knotflow.perception.estimation.crossings import CrossingMemory, ambiguous_ends
from knotflow.perception.estimation.estimate import (
    EstimateConfig,
    RopeEstimate,
    estimate,
    list_ambiguities,
)
from knotflow.perception.estimation.evidence import (
    Target,
    coverage_fraction,
    measure_radius,
    observe,
    visible_vertices,
)
from knotflow.perception.estimation.fitting import FitConfig, fit, project_lengths, register
from knotflow.perception.estimation.skeleton import TraceError
from knotflow.perception.networks.network import Network
from knotflow.simulation import RopeConfig, state_or_none

Floats = NDArray[np.float64]

Predict = Callable[[Floats, Floats, float, Floats | None, int | None], Floats]
"""Predicts the rope (V, 3), metres, from its points, its velocities (V, 3), metres a second, the
seconds that pass, the gripper's place (3,) then, and the link that it holds; both are None where it
holds nothing. `constant_velocity` is one, `execution.ModelPrediction` another."""

_POINTS = 400  # of the rope's image that the prediction is registered to
# Weights of the prediction where the image shows nothing, and elsewhere, where it keeps the rope
# from sliding along itself; and of the held link's place in the gripper.
_HIDDEN, _VISIBLE, _HELD = 0.2, 0.02, 0.1
_UNIT = 0.01  # metres, by which distances from the prediction are measured
_LONGEST = 0.2  # seconds that a velocity holds: the table's friction stops a rope sooner
_STIFF = 1e-3  # mobility of the held link beside that of the others
_ITERATIONS = 30  # of expectation and maximisation in coherent point drift
_COHERENCE = 0.3  # metres along the rope over which vertices move together
# Weight of moving together, 1/m^2: lambda of Myronenko and Song, whose points have unit variance,
# over the variance of the rope's points.
_STIFFNESS = 3000.0
_DEVIATION = 0.06  # metres: standard deviation of the points around the vertices at first
_OUTLIERS = 0.05  # share of points that belong to no vertex
_SEEN = 0.03  # metres: a vertex farther than about this from all points is hidden


@dataclass
class TrackerConfig:
    """How a rope is tracked."""

    fit: FitConfig = field(
        default_factory=lambda: FitConfig(steps=4, step_size=3e-3, softness=(4e-3, 3e-3))
    )
    """The gradient steps of each image."""
    lost: float = 0.8
    """A shape of less coverage fraction is lost."""
    patience: int = 5
    """Images from one attempt to find a lost rope to the next, which takes seconds."""
    estimate: EstimateConfig = field(default_factory=EstimateConfig)
    """How a lost rope is found, and one at rest is looked at."""


class Tracker:
    """Follows one rope, an image a call: its `points` (V, 3), metres, head first, and `velocities`
    (V, 3), metres a second."""

    def __init__(
        self,
        camera: Camera,
        rope: RopeConfig,
        initial: RopeEstimate | NDArray,
        config: TrackerConfig | None = None,
        predict: Predict | None = None,
        network: Network | None = None,
    ) -> None:
        """Take up a rope from an estimate or its true points (V, 3), metres, head first.

        `predict` is `constant_velocity` by default; a `network`, by default the shipped one,
        proposes guesses where a lost rope is looked for.

        Raises:
            ValueError: points of another rope.
        """
        self.camera, self.rope, self.config = camera, rope, config or TrackerConfig()
        self._time: float | None = None
        self._predict, self._network = predict, network
        self._waited = self.config.patience
        self._trailing: Floats | None = None
        self._seen_radius: float | None = None
        points = np.array(initial.points if isinstance(initial, RopeEstimate) else initial, float)
        if points.shape != (rope.num_vertices, 3) or not np.isfinite(points).all():
            raise ValueError(
                f"a track begins with points ({rope.num_vertices}, 3) in metres, all finite; got "
                f"shape {points.shape}"
            )
        self._resolution = float(camera.project(points)[:, 2].mean()) / camera.fx  # m a pixel
        if isinstance(initial, RopeEstimate):
            self.restart(initial, None)
        else:
            self.points, self.velocities = points, np.zeros_like(points)
            self._crossings = CrossingMemory.of_shape(points)

    def update(
        self, image: RgbdImage, gripper: NDArray | None = None, grasped: int | None = None
    ) -> RopeEstimate:
        """The rope in the next image, of this camera and with its time.

        The gripper is at `gripper` (3,), metres, and holds the centre of the link of index
        `grasped`; None holds nothing.

        Raises:
            ImageError: an image of another size.
            ValueError: a link that there is not, or one that is held nowhere.
        """
        held = self._held_place(gripper, grasped)
        seconds = 0.0 if self._time is None else max(0.0, image.time - self._time)
        self._time = image.time
        # A model knows how far behind the gripper its link is.
        towards = gripper if self._predict and held is not None else held
        predict = self._predict or constant_velocity
        predicted = predict(self.points, self.velocities, seconds, towards, grasped)
        target = replace(observe(image, self.camera, self.rope), seen_radius=self._seen_radius)
        coarse = target.coarse(predicted)
        shape = predicted
        if bool(target.mask.any()):
            registered = register(predicted, rope_points(image, target), self.rope)
            known = target.known.numpy()[self.camera.nearest_pixels(registered)]
            shape = self._fit(registered, known, coarse, held, grasped)
        shape, crossings = self._crossings.update(shape, coarse, self.config.fit)
        if self._seen_radius is None:
            self._seen_radius = measure_radius(shape, target)
            target = replace(target, seen_radius=self._seen_radius)
        fraction = coverage_fraction(shape, target)
        lost = fraction < self.config.lost
        if lost:
            found = self._reacquire(image, fraction, predicted)
            if found is not None:
                return found
            self.velocities = np.zeros_like(shape)  # those of a lost rope say nothing
        else:
            self._waited = self.config.patience
            if seconds > 0:  # moves of less than half a pixel are noise, and would add up
                moves = shape - self.points
                square = (moves**2).sum(axis=1, keepdims=True)
                moves = moves * square / (square + (0.5 * self._resolution) ** 2)
                self.velocities = moves / seconds
        self.points = shape
        if grasped is not None:
            self._trailing = shape[grasped : grasped + 2].mean(axis=0) - np.asarray(gripper)
        state = state_or_none(shape)
        ambiguities = list_ambiguities(state, crossings, fraction, target)
        return RopeEstimate(
            shape.copy(),
            visible_vertices(shape, target.mask.numpy(), image, self.camera, self.rope),
            state,
            crossings,
            fraction,
            True,
            (*(["the track is lost"] if lost else []), *ambiguities),
            target.seen_radius,
            ambiguous_ends(shape, self.rope),
        )

    def look(self, image: RgbdImage) -> RopeEstimate:
        """The rope at rest, estimated from the image with the tracked shape as a likely one.

        Raises:
            ImageError: an image of another size.
            TraceError: no rope in the image.
        """
        found = self._estimate(image, self.config.estimate, self.points, [self.points])
        self.restart(found, image.time)
        return found

    def restart(self, found: RopeEstimate, time: float | None) -> None:
        """Continue from an estimate of the rope at rest, from an image of that time, seconds."""
        self._time = time
        self.points, self.velocities = found.points.copy(), np.zeros_like(found.points)
        self._crossings = CrossingMemory.of(found.crossings)
        self._seen_radius = found.seen_radius

    def _estimate(
        self, image: RgbdImage, config: EstimateConfig, earlier: Floats, likely: list[Floats]
    ) -> RopeEstimate:
        return estimate(image, self.camera, self.rope, None, config, earlier, self._network, likely)

    def _fit(
        self,
        predicted: Floats,
        known: NDArray[np.bool_],
        coarse: Target,
        held: Floats | None,
        grasped: int | None,
    ) -> Floats:
        """The shape near the prediction that accounts for the coarse image, which says something
        of the vertices that are `known` (V,)."""
        trust = np.where(known, _VISIBLE, _HIDDEN)
        weight, expected = torch.as_tensor(trust), torch.as_tensor(predicted)

        def off_prediction(points: Tensor) -> Tensor:
            loss = (weight * ((points - expected) / _UNIT).square().sum(1)).mean()
            if held is not None and grasped is not None:
                centre = 0.5 * (points[grasped] + points[grasped + 1])
                apart = (centre - torch.as_tensor(held)) / _UNIT
                loss = loss + _HELD / len(points) * apart.square().sum()
            return loss

        return fit(predicted, coarse, self.config.fit, off_prediction)

    def _reacquire(
        self, image: RgbdImage, fraction: float, predicted: Floats
    ) -> RopeEstimate | None:
        """A lost rope, estimated from the image alone; None where that does no better."""
        self._waited += 1
        if self._waited < self.config.patience:
            return None
        self._waited = 0
        brief = replace(self.config.estimate, fallback_search=None)
        try:
            found = self._estimate(image, brief, predicted, [])
        except TraceError:
            return None
        if found.coverage_fraction <= fraction:
            return None
        self.restart(found, image.time)
        reason = "the track was lost, and the rope estimated anew"
        return replace(found, ambiguities=(reason, *found.ambiguities))

    def _held_place(self, gripper: NDArray | None, grasped: int | None) -> Floats | None:
        """Where the gripper has the held link's centre (3,), which trails behind the gripper by as
        much as in the last image; None where it holds nothing."""
        if grasped is None:
            self._trailing = None
            return None
        if not 0 <= grasped < self.rope.links:
            raise ValueError(f"the held link is 0 to {self.rope.links - 1}, got {grasped}")
        if gripper is None or np.shape(gripper) != (3,) or not np.isfinite(gripper).all():
            raise ValueError(f"a held link needs the gripper's place, x, y, z in m: {gripper}")
        place = np.asarray(gripper, np.float64)
        return place if self._trailing is None else place + self._trailing


def constant_velocity(
    points: Floats, velocities: Floats, seconds: float, gripper: Floats | None, grasped: int | None
) -> Floats:
    """A `Predict`: a held rope goes on at constant velocity, its held link to the gripper, with
    links as long as before on average; a rope that is let go stays where it is."""
    if gripper is None or grasped is None:
        return points.copy()
    moved = points + velocities * min(seconds, _LONGEST)
    ends = slice(grasped, grasped + 2)
    moved[ends] += gripper - moved[ends].mean(axis=0)
    mobility = np.ones(len(points))
    mobility[ends] = _STIFF
    link = float(np.linalg.norm(np.diff(points, axis=0), axis=1).mean())
    return project_lengths(moved, link, mobility)


def rope_points(image: RgbdImage, target: Target) -> Floats:
    """At most `_POINTS` points (N, 3) of the rope's axis, metres: below its surface in the image by
    what the upper half of a round rope is higher than its axis on average."""
    row, column = np.nonzero(target.mask.numpy() & np.isfinite(image.depth))
    chosen = np.linspace(0, len(row) - 1, min(_POINTS, len(row))).astype(int)
    row, column = row[chosen], column[chosen]
    depth = image.depth[row, column].astype(np.float64) + 0.25 * np.pi * target.rope.radius
    return target.camera.unproject(np.stack([column, row], axis=1), depth)


class CpdTracker:
    """Follows one rope, with the methods of `Tracker`."""

    def __init__(
        self, camera: Camera, rope: RopeConfig, initial: NDArray, predict: bool = False
    ) -> None:
        """Take up a rope (V, 3), metres, head first; with `predict` it first moves on as in
        `Tracker`, with the gripper that holds it."""
        self.camera, self.rope, self.predict = camera, rope, predict
        self.points = np.array(initial, np.float64)
        self._velocities = np.zeros_like(self.points)
        self._time: float | None = None

    def update(
        self, image: RgbdImage, gripper: NDArray | None = None, grasped: int | None = None
    ) -> RopeEstimate:
        """See `Tracker.update`; crossings have no certainty."""
        seconds = 0.0 if self._time is None else image.time - self._time
        self._time = image.time
        start = self.points
        if self.predict:
            start = constant_velocity(start, self._velocities, seconds, gripper, grasped)
        target = observe(image, self.camera, self.rope)
        shape = drift(start, rope_points(image, target), self.rope)
        if seconds > 0:
            self._velocities = (shape - self.points) / seconds
        self.points = shape
        fraction = coverage_fraction(shape, target)
        visible = visible_vertices(shape, target.mask.numpy(), image, self.camera, self.rope)
        return RopeEstimate(shape.copy(), visible, state_or_none(shape), (), fraction, True, ())


def drift(start: Floats, cloud: Floats, rope: RopeConfig) -> Floats:
    """The rope near `start` (V, 3) that points (N, 3) belong to, metres.

    Moves are G W with the kernel G; W solves (P1 G + lambda sigma^2) W = P X - P1 Y0 (Myronenko and
    Song, Eq. 22), where P (V, N) are the points' shares in each vertex. Without points it stays.
    """
    if len(cloud) == 0:
        return start
    count = len(start)
    along = np.arange(count) * rope.link_length
    kernel = np.exp(-((along[:, None] - along) ** 2) / (2 * _COHERENCE**2))  # (V, V)
    near = cdist(start, cloud).min(axis=1)
    likely = np.exp(-((near / _SEEN) ** 2))
    likely /= likely.sum()
    shape, variance = start, _DEVIATION**2
    box = float(np.prod(np.ptp(cloud, axis=0) + _DEVIATION))
    for _ in range(_ITERATIONS):
        square = cdist(shape, cloud, "sqeuclidean")
        density = np.exp(-square / (2 * variance)) / (2 * np.pi * variance) ** 1.5
        joint = (1 - _OUTLIERS) * likely[:, None] * density
        share = joint / (joint.sum(axis=0) + _OUTLIERS / box)  # (V, N)
        mass = share.sum(axis=1)
        pull = share @ cloud - mass[:, None] * start
        stiff = _STIFFNESS * variance * np.eye(count)
        shape = start + kernel @ np.linalg.solve(mass[:, None] * kernel + stiff, pull)
        left = (share * cdist(shape, cloud, "sqeuclidean")).sum() / (3 * max(mass.sum(), 1e-9))
        variance = max(float(left), (0.25 * rope.radius) ** 2)
    shape = project_lengths(shape, rope.link_length)
    shape[:, 2] = np.maximum(shape[:, 2], rope.radius)
    return shape
