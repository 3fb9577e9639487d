"""Knots as goal states, and the graph of all ways to tie them (paper Sec. IV, V-B d).

A knot can be tied into an open rope when both ends lie in the outer face of a diagram of it, that
is when the rope is a closed minimal diagram cut at some segment. One diagram, its cuts, mirror
images and reversals give all states of a prime knot's name. Knots with an end inside, the slip knot
and the bowline, have open diagrams of their own.
"""

from __future__ import annotations

from collections import deque
from functools import cache
from typing import TYPE_CHECKING, NamedTuple

from knotflow.topology.state import TopologicalState

if TYPE_CHECKING:
    import networkx as nx


class NamedKnot(NamedTuple):
    """An entry of the catalogue."""

    name: str
    aliases: tuple[str, ...]
    """Other names; a prime knot's, as of its closed curve, is Rolfsen's."""
    diagrams: tuple[str, ...]
    """Crossings of the fewest there are."""
    use: str
    closed: bool = True
    """Whether the diagram may be cut anywhere."""


CATALOGUE = (
    NamedKnot("unknot", ("0_1",), ("trivial",), "nothing tied"),
    NamedKnot(
        *("overhand", ("3_1", "trefoil"), ("4o1+2o5+6o3+",)),  # the goal of the paper's Fig. 1
        "stopper, and the beginning of most others",
    ),
    NamedKnot("figure_eight", ("4_1",), ("4o1+2o7-6o3-8o5+",), "stopper of climbers and sailors"),
    NamedKnot(
        *("pentagram", ("5_1", "double_overhand"), ("6o1+2o7+8o3+4o9+10o5+",)),  # Sec. VII-E
        "heavier stopper: an overhand with another turn",
    ),
    NamedKnot("three_twist", ("5_2",), ("4o1+2o7+8o3+10o5+6o9+",), "a figure eight's next of kin"),
    NamedKnot(
        "stevedore", ("6_1",), ("4o1+2o9-8o3-12o5+6o11+10o7+",), "stopper of blocks and pulleys"
    ),
    NamedKnot("6_2", (), ("4o1+2o9-8o3-10o5+6o11+12o7+",), "prime, six crossings"),
    NamedKnot("6_3", (), ("4o1+2o7+8o3+10o5-6o11-12o9-",), "prime, six crossings"),
    NamedKnot(
        *("slip_knot", ("noose",), ("1o9-6o2-7o3+4o8+10o5+", "1o8-7o2-6o3+4o9+10o5+")),
        "an overhand with a bight: quick release, or a noose by its other end",
        closed=False,
    ),
    NamedKnot(
        "bowline",
        (),
        ("1o11-7o2+13o3-4o14-5o9+10o6+12o8-", "1o11-12o2-8o3+4o14-5o9+10o6+13o7-"),
        "a loop that does not slip and can be untied; the tail ends inside it",
        closed=False,
    ),
)
"""Knots by the number of their crossings, and those with an end inside."""
_BY_NAME = {name: one for one in CATALOGUE for name in (one.name, *one.aliases)}
KNOT_NAMES: tuple[str, ...] = tuple(one.name for one in CATALOGUE)


def knot(name: str) -> frozenset[TopologicalState]:
    """The states in which a rope is tied into the named knot with the fewest crossings.

    Raises:
        ValueError: an unknown name.
    """
    if name not in _BY_NAME:
        raise ValueError(f"unknown knot {name!r}; valid names: {', '.join(_BY_NAME)}")
    entry = _BY_NAME[name]
    states = {TopologicalState.parse(diagram) for diagram in entry.diagrams}
    if entry.closed:
        states = {cut for state in states for cut in _cuts(state)}
    mirrors = states | {state.mirrored() for state in states}
    return frozenset(mirrors | {state.reversed() for state in mirrors})


def _cuts(diagram: TopologicalState) -> set[TopologicalState]:
    """The states of a closed diagram cut at each of its segments."""
    count = 2 * diagram.num_crossings
    return {
        TopologicalState.from_crossings(
            ((over - 1 + shift) % count + 1, (under - 1 + shift) % count + 1, sign)
            for over, under, sign in diagram.crossings
        )
        for shift in range(max(count, 1))
    }


def is_knot_name(name: str) -> bool:
    """Whether `knot` knows a name."""
    return name in _BY_NAME


def solution_graph(*goals: TopologicalState) -> nx.MultiDiGraph:
    """Every action path from the trivial state to any of the goals.

    Returns:
        A directed acyclic multigraph. Its nodes are the TopologicalStates on some path; an edge
        is one action, in its attribute `action`, with `str(action)` as its key.
    """
    import networkx as nx

    graph = nx.MultiDiGraph()
    graph.add_nodes_from(goals)
    open_states = deque(graph.nodes)
    while open_states:
        state = open_states.popleft()
        for action, previous in state.predecessors():
            if previous not in graph:
                open_states.append(previous)
            graph.add_edge(previous, state, key=str(action), action=action)
    return graph


@cache
def all_states(crossings: int) -> tuple[TopologicalState, ...]:
    """Every state with so many crossings, sorted; five take minutes."""
    states: list[set[TopologicalState]] = [set() for _ in range(crossings + 1)]
    states[0].add(TopologicalState.trivial())
    for fewer in states[:-1]:
        for state in fewer:
            for _, after in state.actions():
                if after.num_crossings <= crossings:
                    states[after.num_crossings].add(after)
    return tuple(sorted(states[crossings]))
