"""First guesses at a rope's shape: its mask's skeleton, followed through crossings and lifted.

Branching points within a rope's width are cut out as a junction, which leaves arms. They are paired
at all junctions at once: straight on, leaving little of the skeleton out.
"""

from __future__ import annotations

import itertools
import math

import networkx as nx
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial import cKDTree
from skimage.morphology import remove_small_objects, skeletonize

from knotflow.perception.camera.pinhole import Camera
from knotflow.perception.estimation.fitting import project_lengths
from knotflow.simulation import RopeConfig
from knotflow.topology.polyline import (
    DegenerateCurveError,
    Floats,
    arc_lengths,
    interpolate,
    planar_crossings,
)

_ZOOM = 3  # a mask is smoothed on a grid this much finer, or its skeleton is ragged
_SMOOTH = 0.3  # pixels
_JUNCTION = 0.75  # rope widths around a branching point that belong to its junction
_CLOSED = 0.2  # rope widths
_SHARED, _ASIDE = 6.0, 0.5  # rope widths: longest arm that two strands share, and its bow
_TANGENT = 1.5  # rope widths along an arm that give its direction
_LEFT_OUT = 30.0  # cost of leaving out all of the skeleton, in squared radians of turning
_RAGGED = 1.04  # a path of pixels is about this much longer than the line it follows
_TOLERANCE = 0.05  # of the length, that a rope seen at an angle or raised may be off
_MOST_PAIRINGS = 3000
_MOST_PATHS = 60
_PAIRINGS_EACH = 4  # of a junction, the straightest
_LITTLE, _DRAWN_BACK = 0.01, 3  # share of a link that an end is drawn back, and how often
_BESIDE = (1.2, 3.0)  # radii from a crossing, between which a strand's height is its own

ArmEnd = tuple[int, int]
"""An arm's index, and 0 for its first pixel or -1 for its last."""


class TraceError(ValueError):
    """A mask in which no rope can be followed."""


def trace(mask: NDArray, width: float, length: float | None = None) -> list[Floats]:
    """The likeliest paths of the rope in its mask (H, W), shares 0..1 or bool, best first, at least
    one: pixels (N, 2), u and v, from either end. The rope's `width` and `length`, if known, are in
    pixels. A path costs the squared turning at junctions, radians, and what it leaves out.

    Raises:
        TraceError: the mask holds nothing as long as it is wide.
    """
    return [path for _, path in rank_paths(mask, width, length)]


def rank_paths(
    mask: NDArray, width: float, length: float | None = None, shared: bool = False
) -> list[tuple[float, Floats]]:
    """The paths of `trace` with their costs; with `shared`, an arm that two strands share where
    they cross at a small angle, or touch, belongs to their junction."""
    width *= _ZOOM
    arms, junctions = _skeleton(mask, width, _CLOSED if shared else 0.0)
    if shared:
        arms, junctions = _without_shared(arms, junctions, width)
    total = sum(_length(arm) for arm in arms)
    if not total:  # no arms, or single pixels
        raise TraceError(
            f"nothing in the mask ({float(mask.sum()):.0f} pixels) is longer than a rope is wide "
            f"({width / _ZOOM:.1f} pixels)"
        )
    choices = [_pairings(ends, arms, width) for ends in junctions]
    while np.prod([len(one) for one in choices], dtype=float) > _MOST_PAIRINGS:
        longest = max(range(len(choices)), key=lambda k: len(choices[k]))
        choices[longest] = choices[longest][:-1]
    found: dict[tuple[ArmEnd, ...], tuple[float, Floats]] = {}
    for pairing in itertools.product(*choices):
        turning = sum(cost for cost, _ in pairing)
        onward = {a: b for _, pairs in pairing for pair in pairs for a, b in (pair, pair[::-1])}
        for walk in _walks(len(arms), onward):
            covered = sum(_length(arms[arm]) for arm, _ in walk) / total
            least, path = found.get(walk) or (np.inf, _follow(walk, arms))
            cost = turning + _LEFT_OUT * (1 - covered)
            if length:
                misfit = abs(_length(path) / (_RAGGED * length) - 1)
                cost += _LEFT_OUT * max(0.0, misfit - _TOLERANCE)
            if cost < least:
                found[walk] = cost, path
    distinct: list[tuple[float, Floats]] = []
    for cost, path in sorted(found.values(), key=lambda one: one[0])[:_MOST_PATHS]:
        if all(_apart(path, other) > 0.5 * width / _ZOOM for _, other in distinct):
            distinct.append((cost, path))
    return distinct


def _skeleton(
    mask: NDArray, width: float, closed: float
) -> tuple[list[Floats], list[list[ArmEnd]]]:
    """Arms (N, 2) of rows and columns on the finer grid, and the arm ends at each junction; those
    less than two times `closed` widths apart are one."""
    fine = ndimage.zoom(mask.astype(float), _ZOOM, order=1, grid_mode=True, mode="grid-constant")
    fine = ndimage.gaussian_filter(fine, _SMOOTH * _ZOOM) > 0.5
    fine = remove_small_objects(fine, max_size=int(width**2), connectivity=2)
    bones = skeletonize(fine)
    around = np.ones((3, 3))
    neighbours = ndimage.convolve(bones.astype(int), around.astype(int), mode="constant") - 1
    branching = bones & (neighbours > 2)
    if branching.any():
        near = ndimage.distance_transform_edt(~branching) <= _JUNCTION * width
    else:
        near = np.zeros_like(bones)
    if closed:
        near = ndimage.binary_closing(near, around, iterations=math.ceil(closed * width))
    places, _ = ndimage.label(near, around)
    pieces, count = ndimage.label(bones & ~near, around)
    boxes = ndimage.find_objects(pieces)
    touching = ndimage.grey_dilation(places, size=(3, 3))
    arms: list[Floats] = []
    at: dict[int, list[ArmEnd]] = {}
    for index in range(1, count + 1):
        corner = np.array([axis.start for axis in boxes[index - 1]])
        path = _ordered(np.argwhere(pieces[boxes[index - 1]] == index) + corner)
        ends = [int(touching[tuple(path[end])]) for end in (0, -1)]
        if 0 not in ends or _length(path) > width:  # no spur
            for end, place in zip((0, -1), ends, strict=True):
                if place:
                    at.setdefault(place, []).append((len(arms), end))
            arms.append(path.astype(float))
    return arms, list(at.values())


def _without_shared(
    arms: list[Floats], junctions: list[list[ArmEnd]], width: float
) -> tuple[list[Floats], list[list[ArmEnd]]]:
    """Arms and junctions without the short and straight arms between two junctions of three arms,
    which are joined."""
    place = {end: ends for ends in junctions for end in ends}
    gone = set()
    for arm, path in sorted(enumerate(arms), key=lambda one: _length(one[1])):
        first, second = place.get((arm, 0)), place.get((arm, -1))
        if first is None or second is None or first is second:
            continue
        chord = path[-1] - path[0]
        span = float(np.linalg.norm(chord)) + 1e-9
        off = np.abs((path - path[0]) @ [chord[1], -chord[0]]).max() / span
        if len(first) == len(second) == 3 and span < _SHARED * width and off < _ASIDE * width:
            gone.add(arm)
            first += second
            junctions.remove(second)
            for end in second:
                place[end] = first
            first[:] = [end for end in first if end[0] != arm]
    number = {arm: at for at, arm in enumerate(arm for arm in range(len(arms)) if arm not in gone)}
    kept = [arm for at, arm in enumerate(arms) if at not in gone]
    return kept, [[(number[arm], end) for arm, end in ends] for ends in junctions]


def _ordered(pixels: NDArray[np.intp]) -> NDArray[np.intp]:
    """Pixels (N, 2) of a path, from one end to the other."""
    graph = nx.empty_graph(len(pixels))
    graph.add_edges_from(sorted(cKDTree(pixels).query_pairs(1.5)))
    ends = [node for node, degree in graph.degree if degree <= 1] or [0]
    reached = list(nx.bfs_tree(graph, ends[0]))
    path = nx.shortest_path(graph, ends[0], ends[1] if len(ends) > 1 else reached[-1])
    return pixels[path]


def _pairings(
    ends: list[ArmEnd], arms: list[Floats], width: float
) -> list[tuple[float, list[tuple[ArmEnd, ArmEnd]]]]:
    """Ways to go on at a junction, straightest first: the turning, and pairs of arm ends; of an odd
    number of arms one ends there."""
    turn = {pair: _turning(*pair, arms, width) for pair in itertools.combinations(ends, 2)}

    def matchings(rest: list[ArmEnd]) -> list[list[tuple[ArmEnd, ArmEnd]]]:
        if len(rest) < 2:
            return [[]]
        first, *others = rest
        with_first = [
            [(first, other), *more]
            for other in others
            for more in matchings([one for one in others if one != other])
        ]
        return with_first + (matchings(others) if len(rest) % 2 else [])

    costs = [(sum(turn[pair] for pair in pairs), pairs) for pairs in matchings(ends[:8])]
    return sorted(costs, key=lambda one: one[0])[:_PAIRINGS_EACH]


def _turning(one: ArmEnd, other: ArmEnd, arms: list[Floats], width: float) -> float:
    """Squared angles, radians, of going from one arm's end straight to another's and on."""
    (start, leaving), (end, entering) = _tip(one, arms, width), _tip(other, arms, width)
    bridge = end - start
    bends = (_angle(leaving, bridge), _angle(bridge, -entering))
    return sum(bend**2 for bend in bends) + _angle(leaving, -entering) ** 2


def _tip(end: ArmEnd, arms: list[Floats], width: float) -> tuple[Floats, Floats]:
    """An arm's end and the direction in which it leaves the arm."""
    arm = arms[end[0]] if end[1] == 0 else arms[end[0]][::-1]
    back = arm[min(len(arm) - 1, round(_TANGENT * width))]
    return arm[0], arm[0] - back


def _angle(one: Floats, other: Floats) -> float:
    cross = one[0] * other[1] - one[1] * other[0]
    return float(abs(np.arctan2(cross, one @ other))) if other.any() and one.any() else 0.0


def _walks(count: int, onward: dict[ArmEnd, ArmEnd]) -> list[tuple[ArmEnd, ...]]:
    """The walks from each end of the rope, as the ends at which arms are entered."""
    walks, used = [], set()
    for begin in itertools.product(range(count), (0, -1)):
        if begin in onward or begin in used:
            continue
        walk, at = [begin], begin
        while True:
            exit_ = (at[0], -1 - at[1])
            if exit_ not in onward:
                break
            at = onward[exit_]
            walk.append(at)
        used.add((walk[-1][0], -1 - walk[-1][1]))
        walks.append(tuple(walk))
    return walks or [((0, 0),)]


def _follow(walk: tuple[ArmEnd, ...], arms: list[Floats]) -> Floats:
    """The path (N, 2), pixels u and v, through arms, with straight bridges between them."""
    parts: list[Floats] = []
    for arm, entered in walk:
        path = arms[arm] if entered == 0 else arms[arm][::-1]
        if parts:
            gap = path[0] - parts[-1][-1]
            steps = max(2, round(float(np.hypot(*gap))))
            share = np.arange(1, steps)[:, None] / steps
            parts.append(parts[-1][-1] + share * gap)
        parts.append(path)
    return (np.concatenate(parts)[:, ::-1] + 0.5) / _ZOOM - 0.5


def _apart(one: Floats, other: Floats) -> float:
    """Mean distance of two paths, pixels, in whichever direction they are nearer."""
    first, second = (
        interpolate(np.linspace(0, 1, 60), np.linspace(0, 1, len(path)), path)
        for path in (one, other)
    )
    return float(
        min(np.linalg.norm(first - turned, axis=1).mean() for turned in (second, second[::-1]))
    )


def _length(path: NDArray) -> float:
    return float(arc_lengths(path)[-1])


def lift(
    path: Floats, mask: NDArray[np.bool_], depth: NDArray, camera: Camera, rope: RopeConfig
) -> Floats:
    """The rope (V, 3), metres, world frame, along a path of pixels (N, 2) in an image of depth
    (H, W), metres, whose rope is the `mask` (H, W)."""
    axis = _axis(path, mask, depth, camera, rope.radius)  # (N, 3)
    along = arc_lengths(axis[:, :2])
    even = np.linspace(0.0, along[-1], rope.num_vertices)
    width = max(1, round(2 * rope.radius / (along[-1] / len(along))))  # path steps in a width
    padded = np.pad(axis, ((width, width), (0, 0)), "reflect", reflect_type="odd")
    smooth = ndimage.uniform_filter1d(padded, 2 * (width // 2) + 1, axis=0)[width:-width]
    shape = interpolate(even, along, smooth)
    shape[:, 2] = np.maximum(shape[:, 2], rope.radius)
    shape = _part_strands(shape, rope)
    return project_lengths(shape, rope.link_length)


def _axis(
    pixels: Floats, mask: NDArray[np.bool_], depth: NDArray, camera: Camera, radius: float
) -> Floats:
    """Points (N, 3) of the rope's axis at pixels (N, 2); on the table without a known depth."""
    column = np.clip(np.round(pixels[:, 0]).astype(int), 0, camera.width - 1)
    row = np.clip(np.round(pixels[:, 1]).astype(int), 0, camera.height - 1)
    known = np.where(mask, depth, np.nan)
    padded = np.pad(known, 1, constant_values=np.nan)
    shifts = [padded[row + 1 + i, column + 1 + j] for i in (-1, 0, 1) for j in (-1, 0, 1)]
    around = np.stack(shifts)  # (9, N)
    far = camera.unproject(pixels, np.ones(len(pixels))) - camera.position
    on_table = (radius - camera.position[2]) / np.minimum(far[:, 2], -1e-9)
    # The nearest pixels of nine are on the rope's ridge, the farther ones on its flanks.
    surface = np.where(
        np.isnan(around).all(axis=0), on_table, _known_quantile(around, 0.3) + radius
    )
    return camera.unproject(pixels, np.minimum(surface, on_table))


def _known_quantile(values: Floats, share: float) -> Floats:
    """Quantile (N,) of values (M, N) that are not NaN; `numpy.nanquantile` is slow on small M."""
    rising = np.sort(values, axis=0)  # NaN comes last
    last = (~np.isnan(values)).sum(axis=0) - 1
    at = share * np.maximum(last, 0)
    low = at.astype(int)
    columns = np.arange(values.shape[1])
    lower, upper = rising[low, columns], rising[np.minimum(low + 1, np.maximum(last, 0)), columns]
    return lower + (at - low) * (upper - lower)


def _part_strands(shape: Floats, rope: RopeConfig) -> Floats:
    """Lay one strand of each crossing over the other: beside a crossing, the upper strand is still
    above where the lower one is back on its own height."""
    along = arc_lengths(shape[:, :2])
    lifted = shape.copy()
    for places in np.interp(passages(shape), np.arange(len(shape)), along):
        beside = [
            [place + side * reach * rope.radius for side in (-1, 1) for reach in _BESIDE]
            for place in places
        ]
        heights = [float(np.interp(one, along, shape[:, 2]).mean()) for one in beside]
        over, under = (0, 1) if heights[0] > heights[1] else (1, 0)
        lower = min(heights[under], 2 * rope.radius)
        for strand, height in ((under, lower), (over, lower + 2.2 * rope.radius)):
            near = np.abs(along - places[strand]) < _BESIDE[1] * rope.radius
            lifted[near, 2] = height
    return lifted


def passages(shape: NDArray) -> Floats:
    """(C, 2) where a shape (V, 3) crosses itself, 0..V-1, the earlier passage first; an end that
    only touches a strand is no crossing."""
    curve = np.array(shape[:, :2], np.float64)
    for _ in range(_DRAWN_BACK):
        try:
            met = planar_crossings(curve)
        except DegenerateCurveError:
            curve[0] += _LITTLE * (curve[1] - curve[0])
            curve[-1] += _LITTLE * (curve[-2] - curve[-1])
        else:
            return np.stack([met.first + met.first_along, met.second + met.second_along], axis=1)
    return np.empty((0, 2))  # it ends along a strand
