"""The solution graph: every way to tie a goal with topological actions (paper Sec. IV, V-B d).

The search goes backward from the goal by undoing actions. Undoing removes crossings, so it meets
few states; going forward from the straight rope would meet thousands at four crossings already.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from typing import TYPE_CHECKING

from knotflow.topology.action import Action
from knotflow.topology.state import TopologicalState

if TYPE_CHECKING:
    import networkx as nx

Step = tuple[Action, TopologicalState]
"""An action and the state it leads to."""


def solution_graph(*goals: TopologicalState) -> nx.MultiDiGraph:
    """Every action path from the trivial state to the goal (or to any of several goals).

    Returns:
        A directed acyclic multigraph. Nodes are the TopologicalStates on some path; an edge is
        one action, in its attribute `action`, with `str(action)` as its key. Every node lies on
        a path from the trivial state, and every node but a goal on a path to a goal.

    Raises:
        TypeError: no goal, or one that is not a TopologicalState.
    """
    import networkx as nx

    if not goals:
        raise TypeError("solution_graph needs at least one goal state")
    for goal in goals:
        if not isinstance(goal, TopologicalState):
            raise TypeError(
                f"a goal must be a TopologicalState, got {goal!r}; for a knot by name: "
                "solution_graph(*knot(name))"
            )
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


def solution_paths(graph: nx.MultiDiGraph, goal: TopologicalState) -> Iterator[tuple[Step, ...]]:
    """The paths of a solution graph from the trivial state to a goal in it, as (action, state)
    steps. Lazy: their number grows about exponentially with the crossings of the goal.

    Raises:
        ValueError: the goal is not a node of the graph.
    """
    if goal not in graph:
        raise ValueError(f"the state {goal} is not in this solution graph")

    def paths_to(state: TopologicalState) -> Iterator[tuple[Step, ...]]:
        if state.num_crossings == 0:
            yield ()
        for previous, _, action in graph.in_edges(state, data="action"):
            for path in paths_to(previous):
                yield (*path, (action, state))

    return paths_to(goal)
