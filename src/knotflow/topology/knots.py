"""Knots as goal states, and the graph of all ways to tie them (paper Sec. IV, V-B d).

A knot can be tied into an open rope when both ends lie in the outer face of a diagram of it, that
is when the rope is a closed minimal diagram cut at some segment. One diagram, its cuts, mirror
images and reversals give all states of a name.
"""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING

from knotflow.topology.state import TopologicalState

if TYPE_CHECKING:
    import networkx as nx

_DIAGRAMS = {
    "unknot": "trivial",
    "overhand": "4o1+2o5+6o3+",  # 3_1, the goal of the paper's Fig. 1
    "figure_eight": "4o1+2o7-6o3-8o5+",  # 4_1
    "pentagram": "6o1+2o7+8o3+4o9+10o5+",  # 5_1, Sec. VII-E
    "three_twist": "4o1+2o7+8o3+10o5+6o9+",  # 5_2
}

KNOT_NAMES: tuple[str, ...] = tuple(_DIAGRAMS)


def knot(name: str) -> frozenset[TopologicalState]:
    """The states in which a rope is tied into the named knot with the fewest crossings.

    Raises:
        ValueError: an unknown name.
    """
    if name not in _DIAGRAMS:
        raise ValueError(f"unknown knot {name!r}; valid names: {', '.join(KNOT_NAMES)}")
    diagram = TopologicalState.parse(_DIAGRAMS[name])
    count = 2 * diagram.num_crossings
    cuts = {
        TopologicalState.from_crossings(
            ((over - 1 + shift) % count + 1, (under - 1 + shift) % count + 1, sign)
            for over, under, sign in diagram.crossings
        )
        for shift in range(max(count, 1))
    }
    mirrors = cuts | {state.mirrored() for state in cuts}
    return frozenset(mirrors | {state.reversed() for state in mirrors})


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
