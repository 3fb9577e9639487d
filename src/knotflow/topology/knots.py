"""Named knots as sets of goal states.

A knot is tied into an open rope when both ends lie in the outer face of a diagram of it, that is
when the rope is a closed minimal diagram cut at some segment. One diagram and its cuts, mirror
images and reversals give all the states of a name: chiralities, over-first or under-first, and
where the rope may be cut.
"""

from __future__ import annotations

from types import MappingProxyType

from knotflow.topology.faces import Crossing
from knotflow.topology.state import TopologicalState

_DIAGRAMS: MappingProxyType[str, str] = MappingProxyType(
    {
        "unknot": "trivial",
        # 3_1, the goal of the paper's Fig. 1.
        "overhand": "4o1+2o5+6o3+",
        # 4_1
        "figure_eight": "4o1+2o7-6o3-8o5+",
        # 5_1, the pentagram-like knot of the paper's Sec. VII-E.
        "pentagram": "6o1+2o7+8o3+4o9+10o5+",
        # 5_2
        "three_twist": "4o1+2o7+8o3+10o5+6o9+",
    }
)

KNOT_NAMES: tuple[str, ...] = tuple(_DIAGRAMS)


def knot(name: str) -> frozenset[TopologicalState]:
    """The states in which a rope is tied into the named knot with the fewest crossings.

    Raises:
        ValueError: an unknown name; the message lists the valid ones.
    """
    if name not in _DIAGRAMS:
        raise ValueError(f"unknown knot {name!r}; valid names: {', '.join(KNOT_NAMES)}")
    cuts = _cuts(TopologicalState.parse(_DIAGRAMS[name]))
    mirrors = cuts | {state.mirrored() for state in cuts}
    return frozenset(mirrors | {state.reversed() for state in mirrors})


def _cuts(state: TopologicalState) -> set[TopologicalState]:
    """The states of the same closed diagram cut at each of its segments."""
    count = 2 * state.num_crossings

    def later(crossing: Crossing, shift: int) -> Crossing:
        over, under, sign = crossing
        return ((over - 1 + shift) % count + 1, (under - 1 + shift) % count + 1, sign)

    return {
        TopologicalState.from_crossings(later(crossing, shift) for crossing in state.crossings)
        for shift in range(max(count, 1))
    }
