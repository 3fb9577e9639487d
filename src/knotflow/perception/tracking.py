"""A rope followed from image to image (Sec. VI).

Each image begins with a prediction: the rope goes on as it moved, drawn along by the gripper that
holds it. It is laid onto the rope's points, and a few gradient steps in image space, on a grid
coarser than the image, make it account for what is seen; what is hidden goes along with the rest.
Over and under do not change while strands stay on each other, so what images say of a crossing is
gathered from image to image. A shape that no longer accounts for the image is lost, and the rope is
estimated anew.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from knotflow.perception.camera import Camera
from knotflow.perception.certainty import CrossingEvidence
from knotflow.perception.crossings import CrossingMemory
from knotflow.perception.doubts import ends_at_strands, list_doubts
from knotflow.perception.estimation import EstimateConfig, RopeEstimate, estimate
from knotflow.perception.evidence import explained, measure_radius, nearest_pixels, observe, seen
from knotflow.perception.fitting import FitConfig, fit
from knotflow.perception.image import RgbdImage
from knotflow.perception.losses import Target
from knotflow.perception.motion import go_on
from knotflow.perception.network import Network
from knotflow.perception.point_drift import rope_points
from knotflow.perception.registration import register
from knotflow.perception.tracing import TraceError
from knotflow.simulation import RopeConfig, state_or_none

Floats = NDArray[np.float64]

Predict = Callable[[Floats, Floats, float, Floats | None, int | None], Floats]
"""Where a rope (V, 3), metres, with velocities (V, 3), metres a second, will be some seconds later,
when the gripper, which holds the link of that index, will be at a place (3,), such as
`execution.ModelPrediction`; both are None where it holds nothing."""

_UNIT = 0.01  # metres, by which distances from the prediction are measured


@dataclass
class TrackerConfig:
    """How a rope is tracked."""

    fit: FitConfig = field(
        default_factory=lambda: FitConfig(steps=4, step_size=3e-3, softness=(4e-3, 3e-3))
    )
    """The gradient steps of each image."""
    points: int = 400
    """Points of the rope's image that the prediction is laid onto before."""
    across: float = 1.4
    """Pixels that a rope is wide on the grid that these steps look at."""
    hidden: float = 0.2
    """Weight of the prediction where the image shows nothing."""
    shown: float = 0.02
    """Weight of the prediction elsewhere; it keeps the rope from sliding along itself."""
    held: float = 0.1
    """Weight of the held link's place in the gripper."""
    lost: float = 0.8
    """A shape that accounts for less of the rope's image is lost."""
    patience: int = 5
    """Images from one attempt to find a lost rope to the next, which takes seconds."""
    estimate: EstimateConfig = field(default_factory=EstimateConfig)
    """How a lost rope is found, and one at rest is looked at."""


class Tracker:
    """Follows one rope; an image a call."""

    def __init__(
        self,
        camera: Camera,
        rope: RopeConfig,
        initial: RopeEstimate | NDArray,
        config: TrackerConfig | None = None,
        predict: Predict | None = None,
        network: Network | None = None,
    ) -> None:
        """Take up a rope.

        Args:
            camera: of all images.
            rope: its length, radius and number of links.
            initial: the rope at first, or its points (V, 3), metres, head first, which are taken
                for right, over and under too.
            config: how.
            predict: gives the next shape before it is seen; without, the rope goes on as it moved
                (`motion.go_on`).
            network: proposes one more guess where a lost rope is looked for; the one that the
                package ships without.

        Raises:
            ValueError: points of another rope.
        """
        self.camera, self.rope, self.config = camera, rope, config or TrackerConfig()
        self._predict, self._network = predict, network
        self._time: float | None = None
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
        self._spread = np.full(len(points), 0.5 * self._resolution)
        if isinstance(initial, RopeEstimate):
            self._take(initial)
        else:
            self.points, self.velocities = points, np.zeros_like(points)
            self._crossings = CrossingMemory.of_shape(points)

    def update(
        self, image: RgbdImage, gripper: NDArray | None = None, grasped: int | None = None
    ) -> RopeEstimate:
        """The rope in the next image.

        Args:
            image: of this camera, with its time.
            gripper: (3,) metres, where the gripper is.
            grasped: index of the link whose centre it holds; None holds nothing.

        Raises:
            ImageError: an image of another size.
            ValueError: a link that there is not, or one that is held nowhere.
        """
        held = self._held(gripper, grasped)
        seconds = 0.0 if self._time is None else max(0.0, image.time - self._time)
        self._time = image.time
        now = self.points, self.velocities, seconds
        if self._predict is None:
            predicted = go_on(*now, held, grasped)
        else:  # a model knows how far behind the gripper its link is
            predicted = self._predict(*now, None if grasped is None else gripper, grasped)
        target = replace(observe(image, self.camera, self.rope), seen_radius=self._seen_radius)
        grid = self.camera.binning(predicted, 2 * self.rope.radius, self.config.across)
        coarse, camera = target.binned(grid), self.camera.binned(grid)
        shape = predicted
        if bool(target.rope.any()):
            cloud = rope_points(image, target, self.camera, self.rope, self.config.points)
            laid = register(predicted, cloud, self.rope)
            known = target.known.numpy()[nearest_pixels(laid, self.camera)]
            shape = self._fit(laid, known, coarse, camera, held, grasped)
        shape, crossings = self._crossings.update(shape, coarse, camera, self.rope, self.config.fit)
        if self._seen_radius is None:
            self._seen_radius = measure_radius(shape, target, self.camera, self.rope)
            target = replace(target, seen_radius=self._seen_radius)
        share = explained(shape, target, self.camera, self.rope)
        if share < self.config.lost:
            found = self._find(image, share, predicted)
            if found is not None:
                return found
            self.velocities = np.zeros_like(shape)  # those of a lost rope say nothing
        else:
            self._waited = self.config.patience
            if seconds > 0:
                self.velocities = self._without_noise(shape - self.points) / seconds
        self.points = shape
        if grasped is not None:
            self._trailing = shape[grasped : grasped + 2].mean(axis=0) - np.asarray(gripper)
        shown = seen(shape, target.rope.numpy(), image, self.camera, self.rope)
        self._spread = self._spreads(shape, predicted, shown)
        return self._estimate(shape, crossings, share, shown, target)

    def look(self, image: RgbdImage) -> RopeEstimate:
        """The rope at rest, estimated with care; takes a second where the shape it was tracked to
        accounts for the image, and several where others are looked for.

        Raises:
            ImageError: an image of another size.
            TraceError: no rope in the image.
        """
        found = self._estimated(image, self.points, self.config.estimate, likely=[self.points])
        self.reseat(found, image.time)
        return found

    def reseat(self, found: RopeEstimate, time: float) -> None:
        """Go on from an estimate of the rope at rest, from an image taken at that time, seconds."""
        self._time = time
        self._take(found)

    def _fit(
        self,
        predicted: Floats,
        known: NDArray[np.bool_],
        coarse: Target,
        camera: Camera,
        held: Floats | None,
        grasped: int | None,
    ) -> Floats:
        """The shape near the prediction that accounts for the coarse image of `camera`, which says
        something of the vertices that are `known` (V,)."""
        config = self.config
        trust = np.where(known, config.shown, config.hidden)
        weight, expected = torch.as_tensor(trust), torch.as_tensor(predicted)

        def off_prediction(points: Tensor) -> Tensor:
            loss = (weight * ((points - expected) / _UNIT).square().sum(1)).mean()
            if held is not None and grasped is not None:
                centre = 0.5 * (points[grasped] + points[grasped + 1])
                apart = (centre - torch.as_tensor(held)) / _UNIT
                loss = loss + config.held / len(points) * apart.square().sum()
            return loss

        return fit(predicted, coarse, camera, self.rope, config.fit, off_prediction)

    def _find(self, image: RgbdImage, share: float, predicted: Floats) -> RopeEstimate | None:
        """A lost rope, estimated from the image alone; None where that does no better."""
        self._waited += 1
        if self._waited < self.config.patience:
            return None
        self._waited = 0
        brief = replace(self.config.estimate, wider=None)
        try:
            found = self._estimated(image, predicted, brief)
        except TraceError:
            return None
        if found.explained <= share:
            return None
        doubt = "the track was lost, and the rope estimated anew"
        found = replace(found, doubts=(doubt, *found.doubts))
        self._take(found)
        return found

    def _estimated(
        self,
        image: RgbdImage,
        earlier: Floats,
        config: EstimateConfig,
        likely: Sequence[Floats] = (),
    ) -> RopeEstimate:
        """The rope estimated from an image, from its own guesses and from `likely` shapes."""
        return estimate(
            image,
            self.camera,
            self.rope,
            config=config,
            earlier=earlier,
            network=self._network,
            likely=likely,
        )

    def _take(self, found: RopeEstimate) -> None:
        """Go on from an estimate of a rope at rest."""
        self.points, self._spread = found.points.copy(), found.spread.copy()
        self.velocities = np.zeros_like(self.points)
        self._crossings = CrossingMemory.of(found.crossings)
        self._seen_radius = found.seen_radius

    def _estimate(
        self,
        shape: Floats,
        crossings: tuple[CrossingEvidence, ...],
        share: float,
        shown: NDArray[np.bool_],
        target: Target,
    ) -> RopeEstimate:
        state = state_or_none(shape)
        config = self.config.estimate
        doubts = list_doubts(state, crossings, share, target, config.certain, config.explained)
        if share < self.config.lost:
            doubts.insert(0, "the track is lost")
        return RopeEstimate(
            shape.copy(),
            shown,
            state,
            crossings,
            share,
            self._spread.copy(),
            True,
            tuple(doubts),
            target.seen_radius,
            ends_at_strands(shape, self.rope),
        )

    def _spreads(self, shape: Floats, predicted: Floats, shown: NDArray[np.bool_]) -> Floats:
        """(V,) metres. A vertex that is seen is known to half a pixel; a hidden one drifts by as
        much as the prediction is off where the rope is seen."""
        known = 0.5 * self._resolution
        off = np.linalg.norm(shape - predicted, axis=1)
        drift = float(np.sqrt((off[shown] ** 2).mean())) if shown.any() else known
        return np.where(shown, known, np.hypot(self._spread, drift))

    def _without_noise(self, moves: Floats) -> Floats:
        """Moves (V, 3), metres, with those of less than half a pixel damped: they would add up."""
        square = (moves**2).sum(axis=1, keepdims=True)
        return moves * square / (square + (0.5 * self._resolution) ** 2)

    def _held(self, gripper: NDArray | None, grasped: int | None) -> Floats | None:
        """Where the gripper has the held link's centre (3,); None where it holds nothing.

        A grasp gives: the link trails behind the gripper by what it did in the last image.
        """
        if grasped is None:
            self._trailing = None
            return None
        if not 0 <= grasped < self.rope.links:
            raise ValueError(f"the held link is 0 to {self.rope.links - 1}, got {grasped}")
        if gripper is None or np.shape(gripper) != (3,) or not np.isfinite(gripper).all():
            raise ValueError(f"a held link needs the gripper's place, x, y, z in m: {gripper}")
        place = np.asarray(gripper, np.float64)
        return place if self._trailing is None else place + self._trailing
