"""A rope's shape and topological state from one RGB-D image (Sec. VI)."""

from __future__ import annotations

from collections.abc import Sequence, Set
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from knotflow.perception.camera.image import RgbdImage
from knotflow.perception.camera.pinhole import Camera
from knotflow.perception.estimation.crossings import (
    END_AMBIGUITIES,
    CrossingEvidence,
    ambiguous_ends,
    score_crossings,
)
from knotflow.perception.estimation.evidence import (
    Target,
    coverage_fraction,
    find_head,
    head_contrast,
    is_head_inside,
    measure_radius,
    observe,
    pixels_per_metre,
    visible_vertices,
)
from knotflow.perception.estimation.fitting import FitConfig, fit
from knotflow.perception.estimation.search import (
    Progress,
    SearchConfig,
    SearchResult,
    is_plausible,
    mean_distance,
    search,
    total_loss,
)
from knotflow.perception.estimation.skeleton import TraceError, lift, trace
from knotflow.perception.networks.network import StrandNetwork, shipped_network
from knotflow.perception.networks.strands import trace_rope
from knotflow.perception.photo.colours import NO_HEAD, Colour, Colours, end_of_colour
from knotflow.perception.photo.lifting import shape_by_colour
from knotflow.simulation import RopeConfig, state_or_none
from knotflow.topology import TopologicalState
from knotflow.topology.polyline import Floats

_MIN_CERTAINTY, _MIN_COVERAGE = 0.95, 0.98  # of a crossing and a shape that are not ambiguous
_LENGTH_ERROR = 0.03  # share of the rope's length, from which it may be another one's
_SETTLED = 0.99  # coverage fraction of a likely shape that needs no comparison or further search
_RIVAL_MARGIN = 1.5  # log likelihood by which a path with other crossings is lower, at most
_PIXELS = 5.0  # width of the rope, about which finer images are binned


@dataclass
class EstimateConfig:
    """How a rope is estimated."""

    fit: FitConfig = field(default_factory=FitConfig)
    """The gradient steps."""
    search: SearchConfig = field(default_factory=SearchConfig)
    """How first guesses are chosen among, and rewired."""
    fallback_search: SearchConfig | None = field(
        default_factory=lambda: SearchConfig(
            paths=24, guesses=12, rewirings=8, beam=18, rounds=24, enough=2.0
        )
    )
    """How the search continues where its result is ambiguous or leaves rope out; None
    takes the result as it is."""
    colour: bool = True
    """Whether the rope is first looked for by colour alone, as in a photograph; what is found is a
    likely shape."""
    proposals: int = 12
    """First guesses of the network, at most."""
    prior_credit: float = 2.0
    """A shape in another state replaces a likely shape if its log likelihood is higher by this."""


@dataclass(frozen=True, eq=False)
class RopeEstimate:
    """A rope estimated from an image."""

    points: Floats
    """(V, 3) metres, head first, world frame."""
    visible: NDArray[np.bool_]
    """(V,) whether the image shows each vertex."""
    state: TopologicalState | None
    """Of `points`; None where their projection cannot be read, or the rope leaves the image."""
    crossings: tuple[CrossingEvidence, ...]
    """In the order met."""
    coverage_fraction: float
    """Share of the rope in the image that `points` account for, 0..1."""
    head_known: bool
    """Whether a colour or an earlier shape distinguished head from tail."""
    ambiguities: tuple[str, ...]
    """Why the state may be another one, beside the ends."""
    seen_radius: float | None = None
    """Of its silhouette, metres, see `Target`; None where it was not measured."""
    ambiguous_ends: tuple[int, ...] = ()
    """0 for the head and -1 for the tail, where that end may or may not cross a strand."""

    @property
    def ambiguous(self) -> bool:
        """Whether the state may be another one."""
        return bool(self.all_ambiguities)

    @property
    def all_ambiguities(self) -> tuple[str, ...]:
        """Those of the ends too; empty for an estimate to rely on."""
        return self.ambiguities + tuple(END_AMBIGUITIES[end] for end in self.ambiguous_ends)


def estimate(
    image: RgbdImage,
    camera: Camera,
    rope: RopeConfig,
    initial: NDArray | None = None,
    config: EstimateConfig | None = None,
    earlier: NDArray | None = None,
    network: StrandNetwork | None = None,
    likely: Sequence[NDArray] = (),
    progress: Progress | None = None,
    colours: Colours | None = None,
) -> RopeEstimate:
    """Estimate a rope's shape and state from an image.

    Args:
        initial: (V, 3) metres, a guess of the shape, from either end, instead of all others.
        earlier: (V, 3) metres, an earlier shape, head first; tells the head where no colour does.
        network: proposes further first guesses; the shipped one by default.
        likely: shapes (V, 3), metres, such as a track's or a plan's; guesses from the image are
            searched only where none of these accounts for nearly all of it.
        progress: called every second or so of a search, which takes half a minute at most; see
            `Progress`.
        colours: of the rope and of its head, where they are known.

    Raises:
        ImageError: an image of another size.
        TraceError: no rope in the image, and no `initial` shape.
    """
    config, colours = config or EstimateConfig(), colours or Colours()
    image.check(camera)
    width = 2 * rope.radius * camera.fx / float(np.nanmedian(image.depth))
    factor = camera.feasible_binning(width / _PIXELS)
    image, camera = image.binned(factor), camera.binned(factor)
    target = observe(image, camera, rope)
    if initial is not None:
        target = _with_radius(initial, target, config)
        near = target.around([initial])
        best = _select([fit(initial, near, config.fit)], near, target, image, config)
    else:
        best, target = _search_all(target, image, config, network, likely, progress, colours.rope)
    return _head_first(best, target, image, earlier, colours.head)


class _Candidate(NamedTuple):
    """The likeliest of several shapes, its coverage `fraction`, and `reasons` to doubt it."""

    shape: Floats
    crossings: tuple[CrossingEvidence, ...]
    fraction: float
    reasons: tuple[str, ...] = ()

    def is_path_settled(self, near: Target) -> bool:
        """Whether no further guess is needed; which strand is on top may still be uncertain."""
        read = state_or_none(self.shape) is not None
        return read and not self.reasons and is_plausible(self.shape, near, _SETTLED)

    def ambiguities(self, target: Target) -> tuple[str, ...]:
        state = state_or_none(self.shape)
        return (*list_ambiguities(state, self.crossings, self.fraction, target), *self.reasons)


def list_ambiguities(
    state: TopologicalState | None,
    crossings: tuple[CrossingEvidence, ...],
    fraction: float,
    target: Target,
) -> list[str]:
    """What is ambiguous about a shape that accounts for a `fraction` of the rope's image."""
    found = []
    if target.leaves_image:
        found.append("the rope leaves the image")
    elif state is None:
        found.append("the shape's projection does not determine its state")
    if fraction < target.required_coverage(_MIN_COVERAGE):
        found.append(f"the shape accounts for {fraction:.0%} of the rope in the image")
        seen, length = target.seen_length, target.rope.length
        if seen is not None and abs(seen / length - 1.0) > _LENGTH_ERROR:
            found.append(f"the rope looks {seen:.2g} m long, and not {length:.2g} m")
    for number, crossing in enumerate(crossings, 1):
        if crossing.certainty < _MIN_CERTAINTY:
            found.append(
                f"crossing {number} is this way round with {crossing.certainty:.0%} certainty"
            )
    return found


def _head_first(
    best: _Candidate,
    target: Target,
    image: RgbdImage,
    earlier: NDArray | None = None,
    colour: Colour | None = None,
) -> RopeEstimate:
    """The estimate, its head by its `colour` if known or one that stands out, or else as in an
    `earlier` shape (V, 3)."""
    shape, crossings = best.shape, best.crossings
    reasons = best.reasons
    if colour is None:
        head = find_head(head_contrast(shape, target, image))
    else:
        head = end_of_colour(image.rgb, target.camera.project(shape)[:, :2], colour)
        reasons += (NO_HEAD,) * (head is None)
    if head is None and earlier is not None:
        closer = mean_distance(shape[::-1], earlier) < mean_distance(shape, earlier)
        head = -1 if closer else 0
    if head == -1:
        turned = (one.reversed() for one in crossings)
        shape, crossings = shape[::-1].copy(), tuple(sorted(turned, key=lambda one: one.fractions))
    best = best._replace(shape=shape, crossings=crossings, reasons=reasons)
    return RopeEstimate(
        shape,
        visible_vertices(shape, target.mask.numpy(), image, target.camera, target.rope),
        None if target.leaves_image else state_or_none(shape),
        crossings,
        best.fraction,
        head is not None,
        best.ambiguities(target),
        target.seen_radius,
        ambiguous_ends(shape, target.rope),
    )


def _search_all(
    target: Target,
    image: RgbdImage,
    config: EstimateConfig,
    network: StrandNetwork | None,
    likely: Sequence[NDArray],
    progress: Progress | None,
    colour: Colour | None,
) -> tuple[_Candidate, Target]:
    """The likeliest shape of all guesses, see `estimate`, and the target with its seen radius."""
    if not bool(target.mask.any()):
        raise TraceError("nothing in the image is taken for rope")
    if len(likely) == 0 and config.colour:
        seen = target.mask.numpy(), target.height.numpy()
        by_colour = shape_by_colour(image, target.camera, target.rope, *seen, colour)
        if by_colour is not None:
            likely, target = [by_colour[0]], replace(target, seen_length=by_colour[1])
    if len(likely) > 0:
        target = _with_radius(likely[0], target, config)
    near = target.around(likely)
    shapes: list[Floats] = []
    for guess in likely:
        shapes.append(fit(guess, near, config.fit))
        if is_plausible(shapes[-1], near, _SETTLED):
            return _select(shapes, near, target, image, config), target
    expected = {state_or_none(one) for fitted in shapes for one in (fitted, fitted[::-1])} - {None}
    efforts = [one for one in (config.search, config.fallback_search) if one is not None]
    mask, camera, rope = target.mask.numpy(), target.camera, target.rope
    pixels = pixels_per_metre(mask, image, camera)
    traced = trace(target.coverage.numpy(), 2 * rope.radius * pixels, rope.length * pixels)
    traced = [path for path in traced if np.ptp(path, axis=0).any()]  # no single dots
    most = max(effort.paths for effort in efforts)
    paths = [lift(path, mask, image.depth, camera, rope) for path in traced[:most]]
    proposed: list[Floats] = []
    if config.proposals:
        proposed = trace_rope(network or shipped_network(), target)[: config.proposals]
    guesses = [*paths, *proposed, *shapes]
    if not guesses:
        raise TraceError("no path leads along what is taken for rope")
    target = _with_radius(guesses[0], target, config)
    near = target.around(guesses)
    found: SearchResult | None = None
    for effort in efforts:  # the second goes on from what the first has found
        if found is not None and progress is not None and progress() is False:
            break
        tried = 0 if found is None else config.search.paths
        fresh = [*paths[tried : effort.paths], *(() if found else [*proposed, *shapes])]
        found = search(fresh, near, effort, config.fit, found, progress)
        best = _select(found.shapes, near, target, image, config, expected)
        if target.leaves_image or best.is_path_settled(near):
            break
    return best, target


def _select(
    shapes: Sequence[Floats],
    near: Target,
    target: Target,
    image: RgbdImage,
    config: EstimateConfig,
    expected: Set[TopologicalState | None] = frozenset(),
) -> _Candidate:
    """The likeliest of shapes (V, 3) fitted to the part of the image `near` them, those in a state
    that is `expected` with credit; one with a head inside only where all are."""
    headed = [one for one in shapes if not is_head_inside(head_contrast(one, target, image))]
    shapes = headed or shapes
    losses = total_loss(np.stack(shapes), near, config.fit)
    if expected:
        credited = [state_or_none(one) in expected for one in shapes]
        losses[credited] -= config.prior_credit / near.independent_pixels
    likeliest = int(losses.argmin())
    shape, crossings = score_crossings(shapes[likeliest], near, config.fit)
    less_likely = (losses - losses[likeliest]) * near.independent_pixels
    rivals = {
        _unsigned_pairs(one)
        for one, less in zip(shapes, less_likely, strict=True)
        if less < _RIVAL_MARGIN
    } - {None}
    reasons = []
    if len(rivals) > 1:
        reasons.append("another path through the image accounts for it as well")
    if not headed:
        reasons.append("the head is seen away from both ends")
    return _Candidate(shape, crossings, coverage_fraction(shape, near), tuple(reasons))


def _with_radius(guess: NDArray, target: Target, config: EstimateConfig) -> Target:
    """The target with the rope's apparent radius along a first guess (V, 3)."""
    near = target.around([guess])
    shape = fit(guess, near.coarse(guess), config.search.coarse)
    return replace(target, seen_radius=measure_radius(shape, near))


def _unsigned_pairs(shape: Floats) -> frozenset[frozenset[tuple[int, int]]] | None:
    """Which positions along a shape (V, 3) meet at crossings, whatever is on top, from either end;
    None where it cannot be read."""
    state = state_or_none(shape)
    if state is None:
        return None
    pairs = [(min(over, under), max(over, under)) for over, under, _ in state.crossings]
    last = 2 * state.num_crossings + 1
    return frozenset((frozenset(pairs), frozenset((last - b, last - a) for a, b in pairs)))
