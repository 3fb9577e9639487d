"""Which way a rope runs through its image: guesses are rewired while that accounts for it better.

Where strands of a shape meet or touch, the loop between is reversed, over and under are exchanged,
and strands that touch are crossed twice; an end is led to rope that the shape leaves out. All take
gradient steps on a grid coarser than the image, the best few then on the image as it is; the best
shape that has not been is rewired next.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
import torch
from numpy.typing import NDArray
from scipy import ndimage

from knotflow.perception.estimation.crossings import exchange_heights
from knotflow.perception.estimation.evidence import Target, coverage_fraction
from knotflow.perception.estimation.fitting import (
    FitConfig,
    fit,
    image_loss,
    project_lengths,
    shape_loss,
)
from knotflow.perception.estimation.skeleton import passages
from knotflow.simulation import RopeConfig, state_or_none
from knotflow.topology import TopologicalState
from knotflow.topology.polyline import Floats, interpolate

Progress = Callable[[], bool | None]
"""Called in each round of a search; False ends it with the best so far."""

_MAX_SHAPE_LOSS = 0.025  # of a plausible shape, whatever the image
_CONTACTS = 8  # places where strands meet or nearly do, the closest ones, that are rewired
_FINE = 4  # places of a link at which strands are compared
_TOUCHING = 3.0  # radii between the axes of strands, in the plane, that may touch
_APART = 6.0  # radii along the rope, from where on two places are two strands
_NEAR = 1.5  # radii, mean over vertices, up to which first guesses in the same state are the same
_SAME = 3e-3  # metres, mean over vertices, up to which two shapes are the same
_MISSED = 0.5  # share of a pixel that is rope, more than a shape has
_PARTS = 3  # pieces of rope left out, the largest ones, to which an end is led
_REACH = 0.12  # metres from an end to these pieces
_TWIST = 4.0  # radii along a strand from its middle to either of two crossings


@dataclass
class SearchConfig:
    """How first guesses are chosen among, and rewired."""

    coarse: FitConfig = field(
        default_factory=lambda: FitConfig(steps=40, step_size=4e-3, softness=(6e-3, 3e-3))
    )
    """The gradient steps that all shapes take, on the coarser grid."""
    paths: int = 8
    """Likeliest paths through the mask that are first guesses."""
    guesses: int = 8
    """First guesses, the best, that are fitted to the image as it is."""
    rewirings: int = 3
    """The same of a shape's rewirings."""
    beam: int = 5
    """Shapes fitted, the best, that are rewired one after the other."""
    rounds: int = 8
    """Shapes that are rewired, at most."""
    enough: float = 0.995
    """Coverage fraction of a best shape, plausible as a rope, after which no other is rewired."""


@dataclass(frozen=True, eq=False)
class SearchResult:
    """Fitted `shapes` (V, 3), metres, the likeliest first; and `done`, those that were rewired."""

    shapes: list[Floats]
    done: list[Floats]


def search(
    guesses: Sequence[Floats],
    target: Target,
    config: SearchConfig | None = None,
    fine: FitConfig | None = None,
    before: SearchResult | None = None,
    progress: Progress | None = None,
) -> SearchResult:
    """Shapes (V, 3), metres, from `guesses` (V, 3) or rewired, fitted as `fine` has it; continues
    the search made `before`."""
    config, fine = config or SearchConfig(), fine or FitConfig()
    rope, known = target.rope, before.shapes if before else guesses
    coarse = target.coarse(known[0])

    def ordered(shapes: Sequence[Floats]) -> list[Floats]:
        """Different shapes, the likeliest first."""
        losses = total_loss(np.stack(shapes), target, fine)
        kept: list[Floats] = []
        for one in losses.argsort(kind="stable"):
            if not _is_among(shapes[one], kept):
                kept.append(shapes[one])
        return kept

    def fitted(first: Sequence[Floats], kept: int) -> list[Floats]:
        rough = ordered([*fit(np.stack(first), coarse, config.coarse)])
        return [*fit(np.stack(rough[:kept]), target, fine)]

    shapes, done = ([*before.shapes], [*before.done]) if before else ([], [])
    if new := _distinct(guesses, rope):
        shapes = ordered([*shapes, *fitted(new, config.guesses)])
    while len(done) < config.rounds:
        fresh = [one for one in shapes[: config.beam] if not _is_among(one, done)]
        if not fresh or (
            _is_among(shapes[0], done) and is_plausible(shapes[0], target, config.enough)
        ):
            break
        if progress is not None and progress() is False:
            break
        done.append(fresh[0])
        others = propose_rewirings(fresh[0], rope, _CONTACTS)
        others += extend_to_missed(fresh[0], coarse)
        if others:
            shapes = ordered([*shapes, *fitted(others, config.rewirings)])
    return SearchResult(shapes, done)


def _distinct(guesses: Sequence[Floats], rope: RopeConfig) -> list[Floats]:
    """Guesses (V, 3) without those near an earlier one in its state, from either end."""
    kept: list[tuple[Floats, TopologicalState | None]] = []
    for guess in guesses:
        states = [state_or_none(one) for one in (guess, guess[::-1])]
        if not any(
            state is not None
            and state == before
            and mean_distance(one, other) < _NEAR * rope.radius
            for other, before in kept
            for one, state in zip((guess, guess[::-1]), states, strict=True)
        ):
            kept.append((guess, states[0]))
    return [guess for guess, _ in kept]


def _is_among(shape: Floats, others: list[Floats]) -> bool:
    """Whether a shape (V, 3) is the same as one of others, from either end."""
    return any(
        mean_distance(one, shape) <= _SAME for other in others for one in (other, other[::-1])
    )


def mean_distance(shape: Floats, other: Floats) -> float:
    """Between corresponding vertices (V, 3), metres."""
    return float(np.linalg.norm(shape - other, axis=1).mean())


def total_loss(shapes: NDArray, target: Target, config: FitConfig) -> Floats:
    """(N,) how badly shapes (N, V, 3) account for an image, and how unlike a rope they are."""
    points = torch.as_tensor(shapes)
    with torch.no_grad():
        loss = image_loss(points, target, config) + shape_loss(points, target.rope)
    return loss.numpy()


def is_plausible(shape: Floats, target: Target, fraction: float) -> bool:
    """Whether a shape (V, 3) accounts for a fraction of the rope's image, and bends as a rope."""
    with torch.no_grad():
        loss = float(shape_loss(torch.as_tensor(shape), target.rope))
    if loss >= _MAX_SHAPE_LOSS:
        return False
    return coverage_fraction(shape, target) >= target.required_coverage(fraction)


def propose_rewirings(shape: Floats, rope: RopeConfig, contacts: int) -> list[Floats]:
    """Shapes (V, 3), metres, that differ from one (V, 3) in how strands go on where they meet."""
    found = []
    for first, second, cross in _contacts(shape, rope)[:contacts]:
        found.append(_reverse_between(shape, first, second, rope))
        if cross:
            found.append(exchange_heights(shape, first, second, rope))
        else:
            found += [
                _twist(shape, first, second, before, after, rope)
                for before in (1, -1)
                for after in (1, -1)
            ]
    return found


def extend_to_missed(shape: Floats, target: Target) -> list[Floats]:
    """Shapes (V, 3), metres, of which an end reaches rope that one (V, 3) leaves out."""
    rope, left_out = target.rope, target.coverage - target.occupancy(shape)
    missed = ((left_out > _MISSED) & target.known).numpy()
    parts, count = ndimage.label(missed, np.ones((3, 3)))
    sizes = np.bincount(parts.ravel(), minlength=count + 1)[1:]
    found = []
    for part in np.argsort(-sizes)[:_PARTS] + 1:
        places = target.camera.on_plane(parts == part, rope.radius)
        for towards_tail in (True, False):
            ordered = shape if towards_tail else shape[::-1]
            apart = np.hypot(*(places - ordered[-1, :2]).T)
            if apart.min() > _REACH:
                continue
            far = places[apart.argmax()]
            # As many links from the end as it takes to reach there.
            links = np.arange(1, len(shape) // 2)
            needed = np.hypot(*(ordered[-1 - links, :2] - far).T) / rope.link_length
            back = int(links[np.abs(needed - links).argmin()])
            for height in (rope.radius, 3 * rope.radius):
                led = ordered.copy()
                share = np.arange(1, back + 1)[:, None] / back
                end = np.r_[far, height]
                led[-back:] = led[-1 - back] + share * (end - led[-1 - back])
                led[-back:, 2] = height
                led = project_lengths(led, rope.link_length)
                found.append(led if towards_tail else led[::-1].copy())
    return found


def _contacts(shape: Floats, rope: RopeConfig) -> list[tuple[float, float, bool]]:
    """Where strands meet or nearly do: both fractions of the length, and whether they cross."""
    links = len(shape) - 1
    found = [(0.0, float(one), float(other), True) for one, other in passages(shape) / links]
    along = np.linspace(0, 1, _FINE * links + 1)
    fine = np.stack([np.interp(along, np.linspace(0, 1, links + 1), shape[:, k]) for k in (0, 1)])
    apart = np.hypot(*(fine[:, :, None] - fine[:, None])) / rope.radius
    reach = round(_APART * rope.radius / rope.length * len(along))
    near = np.argwhere(np.triu(apart < _TOUCHING, reach))
    for i, j in sorted(near, key=lambda pair: apart[tuple(pair)]):
        apart_along = [abs(along[i] - s) + abs(along[j] - t) for _, s, t, _ in found]
        if min(apart_along, default=np.inf) > 2 * reach / len(along):
            found.append((float(apart[i, j]), float(along[i]), float(along[j]), False))
    return [one[1:] for one in sorted(found, key=lambda one: one[0])]


def _reverse_between(shape: Floats, first: float, second: float, rope: RopeConfig) -> Floats:
    """The shape with what is between two places run through the other way round."""
    along = np.linspace(0, 1, len(shape))
    inside = (along > first) & (along < second)
    at = along.copy()
    at[inside] = first + second - along[inside]
    return project_lengths(interpolate(at, along, shape), rope.link_length)


def _twist(
    shape: Floats, first: float, second: float, before: int, after: int, rope: RopeConfig
) -> Floats:
    """The shape with two strands that touch crossed twice; the first is over where the signs
    `before` and `after` the middle are +1."""
    along = np.linspace(0, 1, len(shape))

    def at(place: float) -> Floats:
        return interpolate(np.array([place]), along, shape)[0]

    step = 2 / (len(shape) - 1)
    ways = [(at(one + step) - at(one - step))[:2] for one in (first, second)]
    aside = (at(second) - at(first))[:2]
    distance = gap = float(np.hypot(*aside))
    if gap < 1e-9:
        aside, gap = np.array([-ways[0][1], ways[0][0]]), float(np.hypot(*ways[0]))
    middle = max(0.5 * (at(first)[2] + at(second)[2]), 2 * rope.radius)
    twisted = shape.copy()
    alike = 1.0 if ways[0] @ ways[1] >= 0 else -1.0
    for place, side, way in ((first, 1.0, 1.0), (second, -1.0, alike)):
        offset = (along - place) * rope.length / (_TWIST * rope.radius)
        bump = np.exp(-(offset**2))
        twisted[:, :2] += (side * (0.5 * distance + rope.radius) * bump)[:, None] * aside / gap
        over = np.where(way * offset < 0, before, after) * side
        near = np.abs(offset) < 1.7
        twisted[near, 2] = middle + over[near] * 1.1 * rope.radius
    return project_lengths(twisted, rope.link_length)
