"""A first guess at a rope's shape: the skeleton of its mask, followed through the crossings.

The skeleton of a mask branches where strands cross, and two strands at an acute angle share a
stretch of it. So all branching points within a rope's width of each other are cut out as one
junction. What is left are arms, free of branches. Which arm goes on in which is decided for all
junctions at once: of the pairings whose walk from one end of the rope to the other leaves least of
the skeleton out, the straightest. No learning; it is the yardstick and the fallback of what is
learned.
"""

from __future__ import annotations

import itertools
from collections import Counter
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_ZOOM = 3  # a mask is smoothed on a grid this much finer, or its skeleton is ragged
_SMOOTH = 0.3  # pixels
_JUNCTION = 0.75  # rope widths around a branching point that belong to its junction
_TANGENT = 1.5  # rope widths along an arm that give its direction
_SIDE_BY_SIDE = 0.75  # rope widths from an arm's middle to its edge that make it two strands
_SHARED = 8.0  # rope widths: two strands that cross do not share more
_LEFT_OUT = 30.0  # cost of leaving out all of the skeleton, in squared radians of turning
_RAGGED = 1.04  # a path of pixels is about this much longer than the line it follows
_TOLERANCE = 0.05  # of the length, that a rope seen at an angle or raised may be off
_MOST_PAIRINGS = 3000
_MOST_PATHS = 60
_PAIRINGS_EACH = 4  # of a junction, the straightest

ArmEnd = tuple[int, int]
"""An arm's index, and 0 for its first pixel or -1 for its last."""


class TraceError(ValueError):
    """A mask in which no rope can be followed."""


@dataclass(frozen=True, eq=False)
class Trace:
    """A rope followed in an image.

    Attributes:
        pixels: (N, 2) u, v along the rope, from either end.
        cost: squared turning at junctions, radians, and what was left out.
        covered: share of the skeleton's length that the path follows.
    """

    pixels: Floats
    cost: float
    covered: float


def trace(mask: NDArray, width: float, length: float | None = None) -> list[Trace]:
    """Follow the rope in its mask.

    Args:
        mask: (H, W) share of each pixel that is rope, 0..1, or whether it is.
        width: of the rope in the image, pixels.
        length: of the rope in the image, pixels, if it is known: the path shall have it.

    Returns:
        The likeliest paths, best first; never none.

    Raises:
        TraceError: the mask holds nothing as long as it is wide.
    """
    width *= _ZOOM
    arms, junctions = _skeleton(mask, width)
    if not arms:
        raise TraceError(
            f"nothing in the mask ({float(mask.sum()):.0f} pixels) is longer than a rope is wide "
            f"({width / _ZOOM:.1f} pixels)"
        )
    total = sum(_length(arm) for arm in arms)
    choices = [_pairings(ends, arms, width) for ends in junctions]
    while np.prod([len(one) for one in choices], dtype=float) > _MOST_PAIRINGS:
        longest = max(range(len(choices)), key=lambda k: len(choices[k]))
        choices[longest] = choices[longest][:-1]
    found: dict[tuple[ArmEnd, ...], Trace] = {}
    for pairing in itertools.product(*choices):
        turning = sum(cost for cost, _ in pairing)
        onward = {a: b for _, pairs in pairing for pair in pairs for a, b in (pair, pair[::-1])}
        for walk in _walks(len(arms), onward):
            covered = sum(_length(arms[arm]) for arm, _ in walk) / total
            path = found.get(walk) or _follow(walk, arms, covered)
            cost = turning + _LEFT_OUT * (1 - covered)
            if length:
                misfit = abs(_length(path.pixels) / (_RAGGED * length) - 1)
                cost += _LEFT_OUT * max(0.0, misfit - _TOLERANCE)
            if cost < path.cost:
                found[walk] = replace(path, cost=cost)
    likeliest = sorted(found.values(), key=lambda one: one.cost)[:_MOST_PATHS]
    distinct: list[Trace] = []
    for path in likeliest:
        if all(_apart(path, other) > 0.5 * width / _ZOOM for other in distinct):
            distinct.append(path)
    return distinct


def _skeleton(mask: NDArray, width: float) -> tuple[list[Floats], list[list[ArmEnd]]]:
    """Arms (N, 2) of row and column on the finer grid, and the arm ends at each junction."""
    from scipy import ndimage
    from skimage.morphology import remove_small_objects, skeletonize

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
    places, _ = ndimage.label(near, around)
    pieces, count = ndimage.label(bones & ~near, around)
    boxes = ndimage.find_objects(pieces)
    thickness = ndimage.distance_transform_edt(fine)
    touching = ndimage.grey_dilation(places, size=(3, 3))
    paths: list[tuple[NDArray[np.intp], list[int]]] = []  # with the junction at either end, or 0
    for index in range(1, count + 1):
        corner = np.array([axis.start for axis in boxes[index - 1]])
        path = _ordered(np.argwhere(pieces[boxes[index - 1]] == index) + corner)
        ends = [int(touching[tuple(path[end])]) for end in (0, -1)]
        if 0 not in ends or _length(path) > width:  # no spur
            paths.append((path, ends))
    arms: list[Floats] = []
    at: dict[int, list[ArmEnd]] = {}
    strands = [_strands(path, thickness, width) for path, _ in paths]
    for index in _shared([ends for _, ends in paths], strands, width):
        strands[index] = 2 * strands[index]
    for (_, ends), sides in zip(paths, strands, strict=True):
        for side in sides:
            for end, place in zip((0, -1), ends, strict=True):
                if place:
                    at.setdefault(place, []).append((len(arms), end))
            arms.append(side)
    return arms, list(at.values())


def _shared(places: list[list[int]], strands: list[list[Floats]], width: float) -> list[int]:
    """Arms that two strands share, crossing at an acute angle: without them an odd number of
    strands would meet at both of their junctions, and one would have to end at each."""
    degree = Counter(
        place for ends, sides in zip(places, strands, strict=True) for place in ends for _ in sides
    )
    found = []
    for index in sorted(range(len(places)), key=lambda k: len(strands[k][0])):
        one, other = places[index]
        odd = one and other and one != other and degree[one] % 2 and degree[other] % 2
        if odd and _length(strands[index][0]) < _SHARED * width:
            found.append(index)
            degree.update((one, other))
    return found


def _strands(arm: NDArray[np.intp], thickness: Floats, width: float) -> list[Floats]:
    """The strands that an arm (N, 2) shows: itself, or two side by side where it is wide."""
    path = arm.astype(float)
    if np.median(thickness[tuple(arm.T)]) < _SIDE_BY_SIDE * width or len(arm) < 3:
        return [path]
    along = path[np.minimum(np.arange(len(arm)) + 3, len(arm) - 1)]
    along = along - path[np.maximum(np.arange(len(arm)) - 3, 0)]
    aside = along[:, ::-1] * [1.0, -1.0] / np.linalg.norm(along, axis=1, keepdims=True)
    return [path + 0.5 * width * aside, path - 0.5 * width * aside]


def _ordered(pixels: NDArray[np.intp]) -> NDArray[np.intp]:
    """Pixels (N, 2) of a path, from one end to the other."""
    import networkx as nx

    apart = np.abs(pixels[:, None] - pixels[None]).max(axis=2) == 1
    graph = nx.from_numpy_array(apart)
    ends = [node for node, degree in graph.degree if degree <= 1] or [0]
    reached = list(nx.bfs_tree(graph, ends[0]))
    path = nx.shortest_path(graph, ends[0], ends[1] if len(ends) > 1 else reached[-1])
    return pixels[path]


def _pairings(
    ends: list[ArmEnd], arms: list[Floats], width: float
) -> list[tuple[float, list[tuple[ArmEnd, ArmEnd]]]]:
    """Ways to go on at a junction, straightest first: the turning, and pairs of arm ends.

    Of an odd number of arms one ends there.
    """
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


def _follow(walk: tuple[ArmEnd, ...], arms: list[Floats], covered: float) -> Trace:
    """The path through arms, with straight bridges between them."""
    parts: list[Floats] = []
    for arm, entered in walk:
        path = arms[arm] if entered == 0 else arms[arm][::-1]
        if parts:
            gap = path[0] - parts[-1][-1]
            steps = max(2, round(float(np.hypot(*gap))))
            share = np.arange(1, steps)[:, None] / steps
            parts.append(parts[-1][-1] + share * gap)
        parts.append(path)
    pixels = (np.concatenate(parts)[:, ::-1] + 0.5) / _ZOOM - 0.5
    return Trace(pixels, np.inf, covered)


def _apart(one: Trace, other: Trace) -> float:
    """Mean distance of two paths, pixels, in whichever direction they are nearer."""
    even = np.linspace(0, 1, 60)
    first, second = (
        np.stack(
            [np.interp(even, np.linspace(0, 1, len(path)), path[:, k]) for k in (0, 1)], axis=1
        )
        for path in (one.pixels, other.pixels)
    )
    return float(
        min(np.linalg.norm(first - turned, axis=1).mean() for turned in (second, second[::-1]))
    )


def _length(path: NDArray) -> float:
    return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())
