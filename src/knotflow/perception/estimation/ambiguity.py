"""What is ambiguous about an estimated rope: its ends, head and tail, its crossings; in words."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from knotflow.perception.camera.image import RgbdImage
from knotflow.perception.camera.pinhole import Camera
from knotflow.perception.estimation.chain import nearest_on_chain
from knotflow.perception.estimation.crossings import CrossingEvidence
from knotflow.perception.estimation.evidence import Target
from knotflow.simulation import RopeConfig
from knotflow.topology import TopologicalState

Floats = NDArray[np.float64]

END_AMBIGUITIES = {
    0: "the head ends at another strand",
    -1: "the tail ends at another strand",
}
"""What is said of an end that may or may not cross a strand."""

_HEAD_VERTICES = 2  # that have the head's colour


def ambiguous_ends(shape: NDArray, rope: RopeConfig) -> tuple[int, ...]:
    """The ends, 0 for the head and -1 for the tail, of a shape (V, 3) that may or may not cross a
    strand: those within a radius of another strand's centre line, seen from above."""
    own = math.ceil(math.pi / rope.max_bend)  # links of the tightest half turn
    ends = []
    for end, from_end in ((0, shape[:, :2]), (-1, shape[::-1, :2])):
        others = from_end[own:]
        if len(others) > 1:
            *_, off = nearest_on_chain(from_end[:1], others)
            if np.linalg.norm(off) < rope.radius:
                ends.append(end)
    return tuple(ends)


def list_ambiguities(
    state: TopologicalState | None,
    crossings: tuple[CrossingEvidence, ...],
    fraction: float,
    target: Target,
    min_certainty: float,
    min_coverage: float,
) -> list[str]:
    """What is ambiguous about a shape that accounts for a `fraction` of the rope's image."""
    found = []
    if target.leaves_image:
        found.append("the rope leaves the image")
    elif state is None:
        found.append("the shape's projection does not determine its state")
    if fraction < target.required_coverage(min_coverage):
        found.append(f"the shape accounts for {fraction:.0%} of the rope in the image")
    for number, crossing in enumerate(crossings, 1):
        if crossing.certainty < min_certainty:
            found.append(
                f"crossing {number} is this way round with {crossing.certainty:.0%} certainty"
            )
    return found


def head_contrast(
    shape: NDArray, mask: NDArray[np.bool_], image: RgbdImage, camera: Camera
) -> Floats:
    """(V,) distance in RGB (0..1) of the colour at each vertex of a shape (V, 3) from the rope's,
    whose pixels are the `mask` (H, W); 0 where none is nearest to the vertex."""
    column, row, _ = camera.project(shape).T
    pixels = np.argwhere(mask)
    apart = np.hypot(pixels[:, :1] - row, pixels[:, 1:] - column)  # (P, V)
    nearest = apart.argmin(axis=1)
    colours = image.rgb[mask] / 255.0
    plain = np.median(colours, axis=0)
    found = np.zeros(len(shape))
    for vertex in np.unique(nearest):
        found[vertex] = np.linalg.norm(np.median(colours[nearest == vertex], axis=0) - plain)
    return found


def find_head(contrasts: NDArray, least: float) -> int | None:
    """0 where the first vertices are of another colour than the rope, -1 where the last are; None
    where neither stand out by `least`, and twice as much as the other."""
    first, last = contrasts[:_HEAD_VERTICES].max(), contrasts[-_HEAD_VERTICES:].max()
    if max(first, last) <= max(least, 2 * min(first, last)):
        return None
    return 0 if first > last else -1


def is_head_inside(contrasts: NDArray, least: float) -> bool:
    """Whether a head is seen along the shape, where it cannot be."""
    ends = max(contrasts[:_HEAD_VERTICES].max(), contrasts[-_HEAD_VERTICES:].max())
    along = contrasts[_HEAD_VERTICES:-_HEAD_VERTICES].max(initial=0.0)
    return bool(along > max(least, 2 * ends))
