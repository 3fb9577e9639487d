"""A rope's shape and topological state from one RGB-D image (Sec. VI).

The rope is segmented, first guesses follow its skeleton, come from a network or are given, gradient
steps in image space make them account for the image, and each crossing of the best is weighed
against its other way round. What the image does not say is not invented: a shape that does not
account for the image, or a crossing in doubt, makes the estimate doubtful.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence, Set
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from knotflow.perception.camera import Camera
from knotflow.perception.certainty import CrossingEvidence, weigh_crossings
from knotflow.perception.doubts import (
    END_DOUBTS,
    ends_at_strands,
    leaves_image,
    list_doubts,
)
from knotflow.perception.evidence import explained, measure_radius, observe, pixels_per_metre, seen
from knotflow.perception.fitting import FitConfig, fit
from knotflow.perception.head import contrast, head_end, is_away_from_ends
from knotflow.perception.image import RgbdImage
from knotflow.perception.lifting import lift
from knotflow.perception.losses import Target
from knotflow.perception.network import Network, shipped_network
from knotflow.perception.searching import (
    Progress,
    SearchConfig,
    Searched,
    is_plausible,
    search,
    total_loss,
)
from knotflow.perception.segmentation import segment
from knotflow.perception.tracing import TraceError, trace
from knotflow.perception.uncertainty import spread
from knotflow.simulation import RopeConfig, state_or_none
from knotflow.topology import TopologicalState

Floats = NDArray[np.float64]
Pairs = frozenset[tuple[int, int]]

_MARGIN = 10  # pixels around what is seen of a rope, that a fit looks at


@dataclass
class EstimateConfig:
    """How a rope is estimated."""

    fit: FitConfig | None = None
    """The gradient steps; None is the default ones."""
    propose: bool = True
    """Whether a network proposes first guesses, beside the paths through the mask."""
    search: SearchConfig = field(default_factory=SearchConfig)
    """How first guesses are chosen among, and rearranged."""
    wider: SearchConfig | None = field(
        default_factory=lambda: SearchConfig(
            paths=24, first=12, candidates=8, beam=18, rounds=24, enough=2.0
        )
    )
    """How it is searched on where what was found is in doubt or not settled; None takes it as it
    is."""
    certain: float = 0.95
    """A crossing whose certainty is lower is in doubt."""
    explained: float = 0.98
    """A shape that accounts for less of the rope's image is in doubt."""
    settled: float = 0.99
    """A likely shape that accounts for less is compared with what the image alone suggests, and one
    that was searched for is searched on from."""
    credit: float = 2.0
    """By so much the logarithm of a shape's likelihood has to exceed that of a likely shape to
    replace it with another state. Of 54 tracked ropes at rest, of seeds of their own, that were
    compared so, 12 were tracked in a wrong state: there the image's own guess was ahead by 2.4 to
    22, and where it misled by -0.2 to 1.8."""
    rival: float = 1.5
    """A path with other crossings is a rival if the logarithm of its likelihood is at most this
    much less: of 40 ropes of 0 to 3 crossings, of a seed of their own, the true path was the
    likeliest but once, by 1.7, and mostly by 1.5 to 5."""
    head_contrast: float = 0.15
    """Distance in RGB (0..1) from the rope's colour that marks a head."""


@dataclass(frozen=True, eq=False)
class RopeEstimate:
    """What an image says of a rope.

    Attributes:
        points: (V, 3) metres, head first, world frame.
        seen: (V,) bool, vertices that the image shows.
        state: the topological state of `points`; None where their projection cannot be read, and
            for a single image that the rope leaves, as it may cross itself outside.
        crossings: each with its certainty, in the order met.
        explained: share of the rope in the image that `points` account for, 0..1.
        spread: (V,) metres, standard deviation of each vertex's distance, were the crossings right.
        head_known: whether a colour or an earlier shape distinguished head from tail.
        doubts: what else is in doubt than the ends, in words.
        seen_radius: of its silhouette, metres, see `Target`; None where it was not measured.
        ends: 0 for the head and -1 for the tail, where it is in doubt whether that end crosses the
            strand that it lies at, see `ends_at_strands`.
    """

    points: Floats
    seen: NDArray[np.bool_]
    state: TopologicalState | None
    crossings: tuple[CrossingEvidence, ...]
    explained: float
    spread: Floats
    head_known: bool
    doubts: tuple[str, ...]
    seen_radius: float | None = None
    ends: tuple[int, ...] = ()

    @property
    def doubtful(self) -> bool:
        """Whether the state may be another one."""
        return bool(self.in_doubt)

    @property
    def in_doubt(self) -> tuple[str, ...]:
        """All that is in doubt, in words; empty for an estimate to rely on."""
        return self.doubts + tuple(END_DOUBTS[end] for end in self.ends)


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
        image: of this camera.
        camera: its intrinsics and pose.
        rope: its length, radius and number of links.
        initial: (V, 3) metres, a guess of the shape, from either end. Without, the mask's skeleton
            is followed.
        config: how.
        earlier: (V, 3) metres, the shape it had shortly before, head first. It decides which end is
            the head where no colour does.
        network: proposes further first guesses, where `initial` is not given; the one that the
            package ships without.
        likely: shapes (V, 3), metres, that it may have for other reasons than the image, such as a
            track's or a plan's. They are tried first, one after the other; the image alone is
            ambiguous where strands touch, so its own guesses are searched only where none of these
            accounts for nearly all of it.
        progress: called every second or so while guesses are searched, which takes half a minute
            where the rope is in doubt.

    Raises:
        ImageError: an image of another size.
        TraceError: no rope in the image, and no `initial` shape.
    """
    config = config or EstimateConfig()
    target = observe(image, camera, rope)

    def colours(shape: Floats) -> Floats:
        return contrast(shape, target.rope.numpy(), image, camera)

    def away(shape: Floats) -> bool:
        return is_away_from_ends(colours(shape), config.head_contrast)

    if initial is not None:
        target = _sized(initial, target, camera, rope, config)
        near, eye = _view([initial], target, camera)
        shape = fit(initial, near, eye, rope, config.fit or FitConfig())
        best = _best([shape], near, eye, rope, config, away)
    else:
        best, target, near, eye = _found(
            target, image, camera, rope, config, away, network, likely, progress
        )
    head = head_end(colours(best.shape), config.head_contrast)
    if head is None and earlier is not None:
        head = -1 if _apart(best.shape[::-1], earlier) < _apart(best.shape, earlier) else 0
    if head == -1:
        best = best.turned()
    return RopeEstimate(
        best.shape,
        seen(best.shape, target.rope.numpy(), image, camera, rope),
        best.state(target),
        best.crossings,
        best.explained,
        spread(best.shape, near, eye, rope, config.fit or FitConfig()),
        head is not None,
        best.doubts(target, config),
        target.seen_radius,
        ends_at_strands(best.shape, rope),
    )


def _found(
    target: Target,
    image: RgbdImage,
    camera: Camera,
    rope: RopeConfig,
    config: EstimateConfig,
    away: Callable[[Floats], bool],
    network: Network | None,
    likely: Sequence[NDArray],
    progress: Progress | None,
) -> tuple[_Best, Target, Target, Camera]:
    """The likeliest shape of all that are tried, see `estimate`; and the target with its rope as
    thick as it is seen to be, the part of it that was looked at, and the camera of that part."""
    if not bool(target.rope.any()):
        raise TraceError("nothing in the image is taken for rope")
    fine = config.fit or FitConfig()
    if len(likely):
        target = _sized(likely[0], target, camera, rope, config)
    near, eye = _view(likely, target, camera)
    shapes: list[Floats] = []
    for guess in likely:
        shapes.append(fit(guess, near, eye, rope, fine))
        if is_plausible(shapes[-1], near, eye, rope, config.settled, config.search, fine):
            return _best(shapes, near, eye, rope, config, away), target, near, eye
    expected = {state_or_none(one) for fitted in shapes for one in (fitted, fitted[::-1])} - {None}
    efforts = [config.search] if config.wider is None else [config.search, config.wider]
    paths = _guesses(target, image, camera, rope, max(effort.paths for effort in efforts))
    proposed: list[Floats] = []
    if config.propose and (network := network or shipped_network()) is not None:
        proposed = _proposed(image, camera, rope, network)
    guesses = [*paths, *proposed, *shapes]
    target = _sized(guesses[0], target, camera, rope, config)
    near, eye = _view(guesses, target, camera)
    found: Searched | None = None
    for effort in efforts:  # the second goes on from what the first has found
        tried = 0 if found is None else config.search.paths
        fresh = [*paths[tried : effort.paths], *(() if found else [*proposed, *shapes])]
        found = search(fresh, near, eye, rope, effort, fine, found, progress)
        best = _best(found.shapes, near, eye, rope, config, away, expected)
        settled = is_plausible(best.shape, near, eye, rope, config.settled, config.search, fine)
        if leaves_image(target) or (settled and not best.doubts(target, config)):
            break
    return best, target, near, eye


@dataclass(frozen=True, eq=False)
class _Best:
    """The likeliest of several shapes, see `RopeEstimate`; `rivalled` where one with other
    crossings is hardly less likely, `headless` where a head is seen, but away from its ends."""

    shape: Floats
    crossings: tuple[CrossingEvidence, ...]
    explained: float
    rivalled: bool
    headless: bool

    def turned(self) -> _Best:
        """The same from its other end."""
        crossings = sorted((one.turned() for one in self.crossings), key=lambda one: one.fractions)
        return replace(self, shape=self.shape[::-1].copy(), crossings=tuple(crossings))

    def state(self, target: Target) -> TopologicalState | None:
        """Its state, where the image shows all of the rope and its projection can be read."""
        return None if leaves_image(target) else state_or_none(self.shape)

    def doubts(self, target: Target, config: EstimateConfig) -> tuple[str, ...]:
        """What is in doubt about it, in words."""
        known = self.state(target), self.crossings, self.explained, target
        found = list_doubts(*known, config.certain, config.explained)
        if self.rivalled:
            found.append("another path through the image accounts for it as well")
        if self.headless:
            found.append("the head is seen away from both ends")
        return tuple(found)


def _best(
    shapes: Sequence[Floats],
    target: Target,
    camera: Camera,
    rope: RopeConfig,
    config: EstimateConfig,
    away: Callable[[Floats], bool],
    expected: Set[TopologicalState | None] = frozenset(),
) -> _Best:
    """The likeliest of fitted shapes (V, 3), those in a state that is `expected` with credit; one
    with a head `away` from its ends only where all are."""
    fine = config.fit or FitConfig()
    headed = [one for one in shapes if not away(one)]
    shapes = headed or shapes
    losses = total_loss(np.stack(shapes), target, camera, rope, fine)
    if expected:
        credited = [state_or_none(one) in expected for one in shapes]
        losses[credited] -= config.credit / target.independent_pixels
    likeliest = int(losses.argmin())
    shape, crossings = weigh_crossings(shapes[likeliest], target, camera, rope, fine)
    share = explained(shape, target, camera, rope)
    less_likely = (losses - losses[likeliest]) * target.independent_pixels
    rivals = {
        _shadow(one) for one, less in zip(shapes, less_likely, strict=True) if less < config.rival
    } - {None}
    return _Best(shape, crossings, share, len(rivals) > 1, not headed)


def propose(
    image: RgbdImage,
    camera: Camera,
    rope: RopeConfig,
    network: Network,
    config: EstimateConfig | None = None,
) -> RopeEstimate:
    """A network's guess at the rope of an image as it is: without gradient steps, and with no
    crossing weighed, so a crossing's way round is as the guess has it. Its spread is the network's
    own confidence.

    Raises:
        ImageError: an image of another size.
        TraceError: no rope in the image.
    """
    config = config or EstimateConfig()
    target = observe(image, camera, rope)
    shape, confidence = network.propose(image, camera, rope, segment(image, camera, rope.radius))
    head = head_end(contrast(shape, target.rope.numpy(), image, camera), config.head_contrast)
    if head == -1:
        shape, confidence = shape[::-1].copy(), confidence[::-1]
    share = explained(shape, target, camera, rope)
    state = None if leaves_image(target) else state_or_none(shape)
    return RopeEstimate(
        shape,
        seen(shape, target.rope.numpy(), image, camera, rope),
        state,
        (),
        share,
        -2 * rope.radius / np.log1p(-confidence.clip(1e-6, 1 - 1e-9)),
        head is not None,
        tuple(list_doubts(state, (), share, target, config.certain, config.explained)),
        ends=ends_at_strands(shape, rope),
    )


def propose_points(image: RgbdImage, camera: Camera, rope: RopeConfig, network: Network) -> Floats:
    """A network's guess (V, 3), metres, from either end."""
    return _proposed(image, camera, rope, network)[0]


def _proposed(image: RgbdImage, camera: Camera, rope: RopeConfig, network: Network) -> list[Floats]:
    """A network's guesses (V, 3), metres, from either end, the likeliest first."""
    segmentation = segment(image, camera, rope.radius)
    return [points for points, _ in network.guesses(image, camera, rope, segmentation)]


def _guesses(
    target: Target, image: RgbdImage, camera: Camera, rope: RopeConfig, count: int
) -> list[Floats]:
    """First shapes (V, 3) along so many paths through the mask, the likeliest first."""
    mask = target.rope.numpy()
    pixels = pixels_per_metre(mask, image, camera)
    paths = trace(target.coverage.numpy(), 2 * rope.radius * pixels, rope.length * pixels)
    paths = [path for path in paths if np.ptp(path.pixels, axis=0).any()]  # no single dots
    return [lift(path, mask, image.depth, camera, rope) for path in paths[:count]]


def _sized(
    guess: NDArray, target: Target, camera: Camera, rope: RopeConfig, config: EstimateConfig
) -> Target:
    """The target with its rope as thick as it is seen to be along a first guess (V, 3)."""
    near, eye = _view([guess], target, camera)
    grid = eye.binning(guess, 2 * rope.radius, config.search.across)
    shape = fit(guess, near.binned(grid), eye.binned(grid), rope, config.search.coarse)
    return replace(target, seen_radius=measure_radius(shape, near, eye, rope))


def _view(shapes: Sequence[NDArray], target: Target, camera: Camera) -> tuple[Target, Camera]:
    """The part of an image around its rope and shapes (V, 3), and the camera of that part."""
    row, column = np.nonzero(target.rope.numpy())
    drawn = np.concatenate([*shapes, np.empty((0, 3))])
    u, v, _ = np.nan_to_num(camera.project(drawn)).round().astype(int).T
    spans = []
    for shown, places, size in ((row, v, camera.height), (column, u, camera.width)):
        inside = np.clip(np.r_[shown, places], 0, size - 1)
        low, high = int(inside.min()) - _MARGIN, int(inside.max()) + _MARGIN + 1
        spans.append(slice(max(0, low), min(size, high)))
    return target.cropped(*spans), camera.cropped(*spans)


def _apart(one: Floats, other: Floats) -> float:
    return float(np.linalg.norm(one - other, axis=1).mean())


def _shadow(shape: Floats) -> frozenset[Pairs] | None:
    """Which positions along a shape (V, 3) meet at crossings, whatever is on top, from either end;
    None where it cannot be read."""
    state = state_or_none(shape)
    if state is None:
        return None
    pairs = [(min(over, under), max(over, under)) for over, under, _ in state.crossings]
    last = 2 * state.num_crossings + 1
    return frozenset((frozenset(pairs), frozenset((last - b, last - a) for a, b in pairs)))
