"""What is in doubt about an estimated rope: said in words, and never decided by a guess."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from knotflow.perception.certainty import CrossingEvidence
from knotflow.perception.losses import Target
from knotflow.perception.registration import nearest_on_chain
from knotflow.simulation import RopeConfig
from knotflow.topology import TopologicalState

END_DOUBTS = {0: "the head ends at another strand", -1: "the tail ends at another strand"}
"""What is said of an end of which it is in doubt whether it crosses a strand."""

_BORDER = 2  # pixels: the last one may have lost its depth


def leaves_image(target: Target) -> bool:
    """Whether rope is seen at the border of an image."""
    inner = target.rope[_BORDER:-_BORDER, _BORDER:-_BORDER]
    return bool(target.rope.sum() > inner.sum())


def ends_at_strands(shape: NDArray, rope: RopeConfig) -> tuple[int, ...]:
    """The ends, 0 for the head and -1 for the tail, of which it is in doubt whether they cross.

    An end that lies within a radius of another strand's centre line, seen from above, is hidden
    under it or hides it, and a few millimetres decide whether the shape (V, 3) crosses there. Of
    168 looks at ropes between two actions, of seeds of their own, 6 of the 8 that misread the state
    had such an end, and 13 of the others.
    """
    own = math.ceil(math.pi / rope.max_bend)  # links of the tightest half turn
    ends = []
    for end, from_end in ((0, shape[:, :2]), (-1, shape[::-1, :2])):
        others = from_end[own:]
        if len(others) > 1:
            *_, off = nearest_on_chain(from_end[:1], others)
            if np.linalg.norm(off) < rope.radius:
                ends.append(end)
    return tuple(ends)


def list_doubts(
    state: TopologicalState | None,
    crossings: tuple[CrossingEvidence, ...],
    share: float,
    target: Target,
    certain: float,
    enough: float,
) -> list[str]:
    """What is in doubt about a shape that accounts for a `share` of the rope in the image, where
    that should be `enough`, and crossings `certain`."""
    doubts = []
    if leaves_image(target):
        doubts.append("the rope leaves the image")
    elif state is None:
        doubts.append("the shape's projection does not determine its state")
    if share < target.nearly(enough):
        doubts.append(f"the shape accounts for {share:.0%} of the rope in the image")
    for number, crossing in enumerate(crossings, 1):
        if crossing.certainty < certain:
            doubts.append(
                f"crossing {number} is this way round with {crossing.certainty:.0%} certainty"
            )
    return doubts
