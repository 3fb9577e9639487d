"""A rope's shape and topological state from one RGB-D image (Sec. VI)."""

from __future__ import annotations

from collections.abc import Callable, Sequence, Set
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from knotflow.perception.camera.image import RgbdImage
from knotflow.perception.camera.pinhole import Camera
from knotflow.perception.estimation.ambiguity import (
    END_AMBIGUITIES,
    ambiguous_ends,
    find_head,
    head_contrast,
    is_head_inside,
    list_ambiguities,
)
from knotflow.perception.estimation.crossings import CrossingEvidence, score_crossings
from knotflow.perception.estimation.evidence import (
    Target,
    coverage_fraction,
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
from knotflow.perception.estimation.segmentation import segment
from knotflow.perception.estimation.skeleton import TraceError, lift, trace
from knotflow.perception.networks.network import Network, shipped_network
from knotflow.simulation import RopeConfig, state_or_none
from knotflow.topology import TopologicalState

Floats = NDArray[np.float64]

_MARGIN = 10  # pixels around what is seen of a rope, that a fit looks at


@dataclass
class EstimateConfig:
    """How a rope is estimated."""

    fit: FitConfig = field(default_factory=FitConfig)
    """The gradient steps."""
    propose: bool = True
    """Whether a network proposes first guesses, beside the paths through the mask."""
    search: SearchConfig = field(default_factory=SearchConfig)
    """How first guesses are chosen among, and rewired."""
    fallback_search: SearchConfig | None = field(
        default_factory=lambda: SearchConfig(
            paths=24, guesses=12, rewirings=8, beam=18, rounds=24, enough=2.0
        )
    )
    """How the search continues where its result is ambiguous or below `settled_coverage`; None
    takes the result as it is."""
    min_certainty: float = 0.95
    """A crossing of less certainty is ambiguous."""
    min_coverage: float = 0.98
    """A shape of less coverage fraction is ambiguous."""
    settled_coverage: float = 0.99
    """A likely shape of less is compared with the image's own guesses, and a search goes on."""
    prior_credit: float = 2.0
    """A shape in another state replaces a likely shape if its log likelihood is higher by this."""
    rival_margin: float = 1.5
    """A path with other crossings is a rival if its log likelihood is lower by at most this."""
    head_contrast: float = 0.15
    """Distance in RGB (0..1) from the rope's colour that marks a head."""


@dataclass(frozen=True, eq=False)
class RopeEstimate:
    """What an image says of a rope."""

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
    """Why the state may be another one, in words, beside the ends."""
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
    network: Network | None = None,
    likely: Sequence[NDArray] = (),
    progress: Progress | None = None,
) -> RopeEstimate:
    """The rope of an image.

    Args:
        image, camera, rope: the image is of this camera, and of one such rope.
        initial: (V, 3) metres, a guess of the shape, from either end, instead of all others.
        config: how.
        earlier: (V, 3) metres, the shape before, head first; tells the head where no colour does.
        network: proposes further first guesses; the shipped one by default.
        likely: shapes (V, 3), metres, such as a track's or a plan's; guesses from the image are
            searched only where none of these accounts for nearly all of it.
        progress: called every second or so of a search, which takes half a minute at most.

    Raises:
        ImageError: an image of another size.
        TraceError: no rope in the image, and no `initial` shape.
    """
    config = config or EstimateConfig()
    target = observe(image, camera, rope)
    mask = target.rope.numpy()

    def head_inside(shape: Floats) -> bool:
        return is_head_inside(head_contrast(shape, mask, image, camera), config.head_contrast)

    if initial is not None:
        target = _with_radius(initial, target, camera, rope, config)
        near, eye = _crop([initial], target, camera)
        shape = fit(initial, near, eye, rope, config.fit)
        best = _select([shape], near, eye, rope, config, head_inside)
    else:
        best, target = _search_all(
            target, image, camera, rope, config, head_inside, network, likely, progress
        )
    head = find_head(head_contrast(best.shape, mask, image, camera), config.head_contrast)
    if head is None and earlier is not None:
        closer = mean_distance(best.shape[::-1], earlier) < mean_distance(best.shape, earlier)
        head = -1 if closer else 0
    if head == -1:
        best = best.reversed()
    return RopeEstimate(
        best.shape,
        visible_vertices(best.shape, mask, image, camera, rope),
        best.state(target),
        best.crossings,
        best.fraction,
        head is not None,
        best.ambiguities(target, config),
        target.seen_radius,
        ambiguous_ends(best.shape, rope),
    )


def _search_all(
    target: Target,
    image: RgbdImage,
    camera: Camera,
    rope: RopeConfig,
    config: EstimateConfig,
    head_inside: Callable[[Floats], bool],
    network: Network | None,
    likely: Sequence[NDArray],
    progress: Progress | None,
) -> tuple[_Candidate, Target]:
    """The likeliest shape of all guesses, see `estimate`, and the target with its seen radius."""
    if not bool(target.rope.any()):
        raise TraceError("nothing in the image is taken for rope")
    if len(likely):
        target = _with_radius(likely[0], target, camera, rope, config)
    near, eye = _crop(likely, target, camera)
    settled = config.settled_coverage, config.search, config.fit
    shapes: list[Floats] = []
    for guess in likely:
        shapes.append(fit(guess, near, eye, rope, config.fit))
        if is_plausible(shapes[-1], near, eye, rope, *settled):
            return _select(shapes, near, eye, rope, config, head_inside), target
    expected = {state_or_none(one) for fitted in shapes for one in (fitted, fitted[::-1])} - {None}
    efforts = [one for one in (config.search, config.fallback_search) if one is not None]
    paths = _trace_paths(target, image, camera, rope, max(effort.paths for effort in efforts))
    proposed: list[Floats] = []
    if config.propose and (network := network or shipped_network()) is not None:
        proposed = network.guesses(image, camera, rope, segment(image, camera, rope.radius))
    guesses = [*paths, *proposed, *shapes]
    target = _with_radius(guesses[0], target, camera, rope, config)
    near, eye = _crop(guesses, target, camera)
    found: SearchResult | None = None
    for effort in efforts:  # the second goes on from what the first has found
        tried = 0 if found is None else config.search.paths
        fresh = [*paths[tried : effort.paths], *(() if found else [*proposed, *shapes])]
        found = search(fresh, near, eye, rope, effort, config.fit, found, progress)
        best = _select(found.shapes, near, eye, rope, config, head_inside, expected)
        if target.leaves_image or (
            is_plausible(best.shape, near, eye, rope, *settled)
            and not best.ambiguities(target, config)
        ):
            break
    return best, target


@dataclass(frozen=True, eq=False)
class _Candidate:
    """The likeliest of several shapes and its coverage `fraction`; `rivalled` where one with other
    crossings is hardly less likely, `head_inside` where a head is seen away from its ends."""

    shape: Floats
    crossings: tuple[CrossingEvidence, ...]
    fraction: float
    rivalled: bool
    head_inside: bool

    def reversed(self) -> _Candidate:
        crossings = (one.reversed() for one in self.crossings)
        ordered = tuple(sorted(crossings, key=lambda one: one.fractions))
        return replace(self, shape=self.shape[::-1].copy(), crossings=ordered)

    def state(self, target: Target) -> TopologicalState | None:
        """Its state, where the image shows all of the rope and its projection can be read."""
        return None if target.leaves_image else state_or_none(self.shape)

    def ambiguities(self, target: Target, config: EstimateConfig) -> tuple[str, ...]:
        limits = config.min_certainty, config.min_coverage
        found = list_ambiguities(self.state(target), self.crossings, self.fraction, target, *limits)
        if self.rivalled:
            found.append("another path through the image accounts for it as well")
        if self.head_inside:
            found.append("the head is seen away from both ends")
        return tuple(found)


def _select(
    shapes: Sequence[Floats],
    target: Target,
    camera: Camera,
    rope: RopeConfig,
    config: EstimateConfig,
    head_inside: Callable[[Floats], bool],
    expected: Set[TopologicalState | None] = frozenset(),
) -> _Candidate:
    """The likeliest of fitted shapes (V, 3), those in a state that is `expected` with credit; one
    with a head inside only where all are."""
    headed = [one for one in shapes if not head_inside(one)]
    shapes = headed or shapes
    losses = total_loss(np.stack(shapes), target, camera, rope, config.fit)
    if expected:
        credited = [state_or_none(one) in expected for one in shapes]
        losses[credited] -= config.prior_credit / target.independent_pixels
    likeliest = int(losses.argmin())
    shape, crossings = score_crossings(shapes[likeliest], target, camera, rope, config.fit)
    fraction = coverage_fraction(shape, target, camera, rope)
    less_likely = (losses - losses[likeliest]) * target.independent_pixels
    rivals = {
        _unsigned_pairs(one)
        for one, less in zip(shapes, less_likely, strict=True)
        if less < config.rival_margin
    } - {None}
    return _Candidate(shape, crossings, fraction, len(rivals) > 1, not headed)


def propose(
    image: RgbdImage,
    camera: Camera,
    rope: RopeConfig,
    network: Network,
    config: EstimateConfig | None = None,
) -> RopeEstimate:
    """A network's likeliest guess at the rope of an image, without gradient steps and without
    comparing crossings.

    Raises:
        ImageError: an image of another size.
        TraceError: no rope in the image.
    """
    config = config or EstimateConfig()
    target = observe(image, camera, rope)
    mask = target.rope.numpy()
    shape = network.guesses(image, camera, rope, segment(image, camera, rope.radius))[0]
    head = find_head(head_contrast(shape, mask, image, camera), config.head_contrast)
    if head == -1:
        shape = shape[::-1].copy()
    fraction = coverage_fraction(shape, target, camera, rope)
    best = _Candidate(shape, (), fraction, rivalled=False, head_inside=False)
    return RopeEstimate(
        shape,
        visible_vertices(shape, mask, image, camera, rope),
        best.state(target),
        (),
        fraction,
        head is not None,
        best.ambiguities(target, config),
        ambiguous_ends=ambiguous_ends(shape, rope),
    )


def _trace_paths(
    target: Target, image: RgbdImage, camera: Camera, rope: RopeConfig, count: int
) -> list[Floats]:
    """First shapes (V, 3) along so many paths through the mask, the likeliest first."""
    mask = target.rope.numpy()
    pixels = pixels_per_metre(mask, image, camera)
    paths = trace(target.coverage.numpy(), 2 * rope.radius * pixels, rope.length * pixels)
    paths = [path for path in paths if np.ptp(path.pixels, axis=0).any()]  # no single dots
    return [lift(path, mask, image.depth, camera, rope) for path in paths[:count]]


def _with_radius(
    guess: NDArray, target: Target, camera: Camera, rope: RopeConfig, config: EstimateConfig
) -> Target:
    """The target with the rope's apparent radius along a first guess (V, 3)."""
    near, eye = _crop([guess], target, camera)
    grid = eye.binning(guess, 2 * rope.radius, config.search.pixels_across)
    shape = fit(guess, near.binned(grid), eye.binned(grid), rope, config.search.coarse)
    return replace(target, seen_radius=measure_radius(shape, near, eye, rope))


def _crop(shapes: Sequence[NDArray], target: Target, camera: Camera) -> tuple[Target, Camera]:
    """The part of an image around its rope and shapes (V, 3), and the camera of that part."""
    row, column = np.nonzero(target.rope.numpy())
    drawn = np.concatenate([*shapes, np.empty((0, 3))])
    u, v, _ = np.nan_to_num(camera.project(drawn)).round().astype(int).T
    spans = []
    for rope, places, size in ((row, v, camera.height), (column, u, camera.width)):
        inside = np.clip(np.r_[rope, places], 0, size - 1)
        low, high = int(inside.min()) - _MARGIN, int(inside.max()) + _MARGIN + 1
        spans.append(slice(max(0, low), min(size, high)))
    return target.cropped(*spans), camera.cropped(*spans)


def _unsigned_pairs(shape: Floats) -> frozenset[frozenset[tuple[int, int]]] | None:
    """Which positions along a shape (V, 3) meet at crossings, whatever is on top, from either end;
    None where it cannot be read."""
    state = state_or_none(shape)
    if state is None:
        return None
    pairs = [(min(over, under), max(over, under)) for over, under, _ in state.crossings]
    last = 2 * state.num_crossings + 1
    return frozenset((frozenset(pairs), frozenset((last - b, last - a) for a, b in pairs)))
