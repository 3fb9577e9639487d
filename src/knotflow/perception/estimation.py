"""A rope's shape and topological state from one RGB-D image (Sec. VI).

The rope is segmented, a first guess follows its skeleton (or is given), gradient steps in image
space make it account for the image, and each crossing is weighed against its other way round. What
the image does not say is not invented: a shape that does not account for the image, or a crossing
in doubt, makes the estimate doubtful.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray

from knotflow.perception.camera import Camera
from knotflow.perception.certainty import CrossingEvidence, weigh_crossings
from knotflow.perception.fitting import FitConfig, fit
from knotflow.perception.image import Label, RgbdImage
from knotflow.perception.lifting import lift
from knotflow.perception.losses import Target
from knotflow.perception.rendering import render
from knotflow.perception.segmentation import segment
from knotflow.perception.tracing import trace
from knotflow.perception.uncertainty import spread
from knotflow.perception.unmixing import coverage
from knotflow.simulation import RopeConfig, state_or_none
from knotflow.topology import TopologicalState

Floats = NDArray[np.float64]
Pairs = frozenset[tuple[int, int]]

_CLEARLY = 0.7  # difference in the share of a pixel that is rope, which is no matter of edges


@dataclass
class EstimateConfig:
    """How a rope is estimated."""

    fit: FitConfig | None = None
    """The gradient steps; None is the default ones."""
    candidates: int = 3
    """First guesses that are fitted, of which the one that accounts best for the image is taken."""
    certain: float = 0.95
    """A crossing whose certainty is lower is in doubt."""
    explained: float = 0.97
    """A shape that accounts for less of the rope's image is in doubt."""
    rival: float = 0.01
    """A path with other crossings is a rival if it accounts for at most this much less."""
    head_contrast: float = 0.15
    """Distance in RGB (0..1) from the rope's colour that marks a head."""


@dataclass(frozen=True, eq=False)
class RopeEstimate:
    """What an image says of a rope.

    Attributes:
        points: (V, 3) metres, head first, world frame.
        seen: (V,) bool, vertices that the image shows.
        state: the topological state of `points`; None where their projection cannot be read.
        crossings: each with its certainty, in the order met.
        explained: share of the rope in the image that `points` account for, 0..1.
        spread: (V,) metres, standard deviation of each vertex's distance, were the crossings right.
        head_known: whether a colour or an earlier shape told head from tail.
        doubts: what is in doubt, in words; empty for an estimate to rely on.
    """

    points: Floats
    seen: NDArray[np.bool_]
    state: TopologicalState | None
    crossings: tuple[CrossingEvidence, ...]
    explained: float
    spread: Floats
    head_known: bool
    doubts: tuple[str, ...]

    @property
    def doubtful(self) -> bool:
        """Whether the state may be another one."""
        return bool(self.doubts)


def estimate(
    image: RgbdImage,
    camera: Camera,
    rope: RopeConfig,
    initial: NDArray | None = None,
    config: EstimateConfig | None = None,
) -> RopeEstimate:
    """The rope of an image.

    Args:
        image: of this camera.
        camera: its intrinsics and pose.
        rope: its length, radius and number of links.
        initial: (V, 3) metres, the shape it had shortly before or a network's guess, head first.
            Without, the mask's skeleton is followed.
        config: how.

    Raises:
        ImageError: an image of another size.
        TraceError: no rope in the image, and no `initial` shape.
    """
    config = config or EstimateConfig()
    segmentation = segment(image, camera, rope.radius)
    mask = segmentation.rope
    known = mask | (segmentation.labels == Label.TABLE)
    share = coverage(image, segmentation)
    target = Target.of(mask, known, np.where(known, image.depth, np.nan), share)

    guesses = _guesses(mask, share, image, camera, rope, config) if initial is None else [initial]
    shapes = [fit(guess, target, camera, rope, config.fit) for guess in guesses]
    shares = [_explained(shape, target, camera, rope) for shape in shapes]
    best = int(np.argmax(shares))
    shape, crossings = weigh_crossings(shapes[best], target, camera, rope, config.fit)
    head_known = initial is not None
    if initial is None:
        shape, crossings, head_known = _head_first(shape, crossings, mask, image, camera, config)

    explained = _explained(shape, target, camera, rope)
    state = state_or_none(shape)
    rivals = {
        _shadow(one)
        for one, share in zip(shapes, shares, strict=True)
        if share > shares[best] - config.rival
    }
    return RopeEstimate(
        shape,
        _seen(shape, mask, image, camera, rope),
        state,
        crossings,
        explained,
        spread(shape, target, camera, rope, config.fit),
        head_known,
        tuple(_doubts(state, crossings, explained, rivals, _leaves(mask), config)),
    )


def _guesses(
    mask: NDArray[np.bool_],
    share: Floats,
    image: RgbdImage,
    camera: Camera,
    rope: RopeConfig,
    config: EstimateConfig,
) -> list[Floats]:
    """First shapes (V, 3) along the likeliest paths through the mask."""
    visible = image.depth[mask]
    distance = float(np.nanmedian(visible)) if np.isfinite(visible).any() else 1.0
    pixels = camera.fx / distance  # of a metre at the rope
    paths = trace(share, 2 * rope.radius * pixels, rope.length * pixels)
    return [lift(path, mask, image.depth, camera, rope) for path in paths[: config.candidates]]


def _explained(shape: Floats, target: Target, camera: Camera, rope: RopeConfig) -> float:
    """Share of the rope's image that a shape accounts for, 0..1.

    Rope where the shape has none, and shape where there is none, both count against it; pixels at
    the rope's edges, which are rope in part, for neither.
    """
    with torch.no_grad():
        _, occupancy = render(torch.as_tensor(shape), rope.radius, camera)
    wrong = ((occupancy - target.coverage).abs() > _CLEARLY) & target.known
    return max(0.0, 1 - float(wrong.sum() / target.coverage.sum().clamp(min=1)))


def _head_first(
    shape: Floats,
    crossings: tuple[CrossingEvidence, ...],
    mask: NDArray[np.bool_],
    image: RgbdImage,
    camera: Camera,
    config: EstimateConfig,
) -> tuple[Floats, tuple[CrossingEvidence, ...], bool]:
    """Shape and crossings with the coloured end first, and whether there is one."""
    rgb = image.rgb / 255.0
    column, row, _ = camera.project(shape).T
    pixels = np.argwhere(mask)
    apart = np.hypot(pixels[:, :1] - row, pixels[:, 1:] - column)  # (P, V)
    nearest = apart.argmin(axis=1)
    colours = rgb[pixels[:, 0], pixels[:, 1]]
    plain = np.median(colours, axis=0)
    contrast = [
        float(np.linalg.norm(np.median(colours[nearest == end], axis=0) - plain))
        if (nearest == end).any()
        else 0.0
        for end in (0, len(shape) - 1)
    ]
    head_known = max(contrast) > max(config.head_contrast, 2 * min(contrast))
    if head_known and contrast[1] > contrast[0]:
        turned = (
            replace(
                one,
                fractions=(1 - one.fractions[1], 1 - one.fractions[0]),
                first_over=not one.first_over,
            )
            for one in crossings
        )
        return shape[::-1].copy(), tuple(sorted(turned, key=lambda one: one.fractions)), True
    return shape, crossings, head_known


def _shadow(shape: Floats) -> frozenset[Pairs] | None:
    """Which positions along a shape (V, 3) meet at crossings, whatever is on top, from either end;
    None where it cannot be read."""
    state = state_or_none(shape)
    if state is None:
        return None
    pairs = [(min(over, under), max(over, under)) for over, under, _ in state.crossings]
    last = 2 * state.num_crossings + 1
    return frozenset((frozenset(pairs), frozenset((last - b, last - a) for a, b in pairs)))


def _seen(
    shape: Floats, mask: NDArray[np.bool_], image: RgbdImage, camera: Camera, rope: RopeConfig
) -> NDArray[np.bool_]:
    """(V,) whether the image shows the rope where the vertex is, and no other strand above it."""
    column, row, depth = camera.project(shape).T
    inside = (np.abs(column - (camera.width - 1) / 2) < camera.width / 2) & (
        np.abs(row - (camera.height - 1) / 2) < camera.height / 2
    )
    u = np.clip(np.nan_to_num(np.round(column)), 0, camera.width - 1).astype(int)
    v = np.clip(np.nan_to_num(np.round(row)), 0, camera.height - 1).astype(int)
    off = np.abs(image.depth[v, u] - (depth - rope.radius))
    return inside & mask[v, u] & (off < 1.5 * rope.radius)


def _leaves(mask: NDArray[np.bool_]) -> bool:
    """Whether the rope reaches the image's border."""
    return bool(mask[[0, -1]].any() or mask[:, [0, -1]].any())


def _doubts(
    state: TopologicalState | None,
    crossings: tuple[CrossingEvidence, ...],
    explained: float,
    rivals: set[frozenset[Pairs] | None],
    leaves: bool,
    config: EstimateConfig,
) -> list[str]:
    doubts = []
    if leaves:
        doubts.append("the rope leaves the image")
    if state is None:
        doubts.append("the shape's projection does not determine its state")
    if explained < config.explained:
        doubts.append(f"the shape accounts for {explained:.0%} of the rope in the image")
    if len(rivals) > 1:
        doubts.append("another path through the image accounts for it as well")
    for number, crossing in enumerate(crossings, 1):
        if crossing.certainty < config.certain:
            doubts.append(
                f"crossing {number} is this way round with {crossing.certainty:.0%} certainty"
            )
    return doubts
