"""A rope followed from image to image (Sec. VI): predicted, registered to its points, and fitted by
a few gradient steps on a grid coarser than the image, or by more in the image where these do not
do. A lost rope is estimated from the image.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
import torch
from numpy.typing import NDArray
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
from knotflow.perception.estimation.fitting import FitConfig, fit, register
from knotflow.perception.estimation.skeleton import TraceError
from knotflow.perception.networks.network import StrandNetwork
from knotflow.simulation import RopeConfig, state_or_none
from knotflow.topology.polyline import Floats

Predict = Callable[[Floats, Floats, float, Floats | None, int | None], Floats]
"""Predicts the rope (V, 3), metres, from its points, its velocities (V, 3), metres a second, the
seconds that pass, the gripper's place (3,) then, and the link that it holds; both are None where it
holds nothing. `execution.ModelPrediction` is one."""

_POINTS = 400  # of the rope's image that the prediction is registered to
# Weights of the prediction where the image shows nothing, and elsewhere, where it keeps the rope
# from sliding along itself; and of the held link's place in the gripper.
_HIDDEN, _VISIBLE, _HELD = 0.2, 0.02, 0.1
_UNIT = 0.01  # metres, by which distances from the prediction are measured
_AROUND = 0.1  # metres around the prediction within which the rope is looked for


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
    """How a lost rope is found."""


class Tracker:
    """Follows one rope, an image a call: its `points` (V, 3), metres, head first, and `velocities`
    (V, 3), metres a second."""

    def __init__(
        self,
        camera: Camera,
        rope: RopeConfig,
        points: NDArray,
        predict: Predict,
        config: TrackerConfig | None = None,
        network: StrandNetwork | None = None,
    ) -> None:
        """Take up a rope from its true points (V, 3), metres, head first; see also `restart`.

        A `network`, by default the shipped one, proposes guesses where a lost rope is looked for.

        Raises:
            ValueError: points of another rope.
        """
        self.camera, self.rope, self.config = camera, rope, config or TrackerConfig()
        self._time: float | None = None
        self._predict, self._network = predict, network
        self._waited = self.config.patience
        self._trailing: Floats | None = None
        self._seen_radius: float | None = None
        points = np.array(points, np.float64)
        if points.shape != (rope.num_vertices, 3) or not np.isfinite(points).all():
            raise ValueError(
                f"a track begins with points ({rope.num_vertices}, 3) in metres, all finite; got "
                f"shape {points.shape}"
            )
        self._resolution = float(camera.project(points)[:, 2].mean()) / camera.fx  # m a pixel
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
        towards = None if held is None else gripper
        predicted = self._predict(self.points, self.velocities, seconds, towards, grasped)
        near, target = self._observe(image, predicted)
        coarse = target.coarse(predicted)
        shape = predicted
        if bool(target.mask.any()):
            registered = register(predicted, rope_points(near, target), self.rope)
            shape = self._fit(registered, target, coarse, self.config.fit, held, grasped)
            if coverage_fraction(shape, target) < self.config.lost:  # after these few steps
                more = self.config.estimate.fit
                shape = self._fit(predicted, target, target, more, held, grasped)
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
        if grasped is not None and self._trailing is None:
            self._trailing = shape[grasped : grasped + 2].mean(axis=0) - np.asarray(gripper)
        state = state_or_none(shape)
        ambiguities = list_ambiguities(state, crossings, fraction, target)
        return RopeEstimate(
            shape.copy(),
            visible_vertices(shape, target.mask.numpy(), near, target.camera, self.rope),
            state,
            crossings,
            fraction,
            True,
            (*(["the track is lost"] if lost else []), *ambiguities),
            target.seen_radius,
            ambiguous_ends(shape, self.rope),
        )

    def restart(self, found: RopeEstimate, time: float | None) -> None:
        """Continue from an estimate of the rope at rest, from an image of that time, seconds."""
        self._time = time
        self.points, self.velocities = found.points.copy(), np.zeros_like(found.points)
        self._crossings = CrossingMemory.of(found.crossings)
        self._seen_radius = found.seen_radius

    def _observe(self, image: RgbdImage, predicted: Floats) -> tuple[RgbdImage, Target]:
        """What the part of the image around a predicted rope (V, 3) says of it, with that part; all
        of the image where rope reaches the part's border, or none is there.

        Raises:
            ImageError: an image of another size.
        """
        image.check(self.camera)
        size = self.camera.width - 1, self.camera.height - 1
        u, v = np.nan_to_num(self.camera.project(predicted)[:, :2]).clip(0, size).T
        margin = _AROUND / self._resolution
        rows, columns = (
            slice(max(0, int(one.min() - margin)), max(1, int(one.max() + margin)))
            for one in (v, u)
        )
        for part in ((rows, columns), (slice(None), slice(None))):
            if part[0] == rows and not np.isfinite(image.depth[part]).any():
                continue
            near = RgbdImage(image.rgb[part], image.depth[part], image.time)
            target = observe(near, self.camera.cropped(*part), self.rope)
            if bool(target.mask.any()) and not target.leaves_image:
                break
        return near, replace(target, seen_radius=self._seen_radius)

    def _fit(
        self,
        predicted: Floats,
        target: Target,
        grid: Target,
        config: FitConfig,
        held: Floats | None,
        grasped: int | None,
    ) -> Floats:
        """The shape near the prediction that accounts for the target, fitted on a grid as fine or
        coarser."""
        known = target.known.numpy()[target.camera.nearest_pixels(predicted)]
        trust = np.where(known, _VISIBLE, _HIDDEN)
        weight, expected = torch.as_tensor(trust), torch.as_tensor(predicted)

        def off_prediction(points: Tensor) -> Tensor:
            loss = (weight * ((points - expected) / _UNIT).square().sum(1)).mean()
            if held is not None and grasped is not None:
                centre = 0.5 * (points[grasped] + points[grasped + 1])
                apart = (centre - torch.as_tensor(held)) / _UNIT
                loss = loss + _HELD / len(points) * apart.square().sum()
            return loss

        return fit(predicted, grid, config, off_prediction)

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
            found = estimate(image, self.camera, self.rope, None, brief, predicted, self._network)
        except TraceError:
            return None
        if found.coverage_fraction <= fraction:
            return None
        self.restart(found, image.time)
        reason = "the track was lost, and the rope estimated anew"
        return replace(found, ambiguities=(reason, *found.ambiguities))

    def _held_place(self, gripper: NDArray | None, grasped: int | None) -> Floats | None:
        """Where the gripper has the held link's centre (3,), which is beside the gripper where it
        was when it was caught; None where it holds nothing."""
        if grasped is None:
            self._trailing = None
            return None
        if not 0 <= grasped < self.rope.links:
            raise ValueError(f"the held link is 0 to {self.rope.links - 1}, got {grasped}")
        if gripper is None or np.shape(gripper) != (3,) or not np.isfinite(gripper).all():
            raise ValueError(f"a held link needs the gripper's place, x, y, z in m: {gripper}")
        place = np.asarray(gripper, np.float64)
        return place if self._trailing is None else place + self._trailing


def rope_points(image: RgbdImage, target: Target) -> Floats:
    """At most `_POINTS` points (N, 3) of the rope's axis, metres: below its surface in the image by
    what the upper half of a round rope is higher than its axis on average."""
    row, column = np.nonzero(target.mask.numpy() & np.isfinite(image.depth))
    chosen = np.linspace(0, len(row) - 1, min(_POINTS, len(row))).astype(int)
    row, column = row[chosen], column[chosen]
    depth = image.depth[row, column].astype(np.float64) + 0.25 * np.pi * target.rope.radius
    return target.camera.unproject(np.stack([column, row], axis=1), depth)
