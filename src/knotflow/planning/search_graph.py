"""The graph of a search that may undo: a goal's solution DAG and the ways back into it.

R1, R2 and Cross only add crossings, so in the solution DAG alone a rope with a crossing that the
goal lacks has no plan, and a search that went astray has no way back. Undoing takes crossings back,
at worst all of them: with it every state has a plan to every goal whose DAG has the trivial state.
"""

from __future__ import annotations

from collections.abc import Iterable

import networkx as nx

from knotflow.planning.dag import SolutionDag, UnreachableGoalError
from knotflow.topology import TopologicalState


class SearchGraph(SolutionDag):
    """A solution DAG with, from each of its states and of any others, all that can be undone.

    Forward edges are those of the DAG; the Action of an undoing is an `Undo`. Both count one for
    `distance`. The graph grows by `extend`, which changes neither distance nor edges of the states
    that it has.

    Attributes:
        dag: the solution DAG it was made from.
    """

    def __init__(self, dag: SolutionDag, *starts: TopologicalState) -> None:
        """Join a solution DAG with all that its states and the starts can be undone to.

        Raises:
            UnreachableGoalError: a start from which no actions and undoings lead to a goal. That
                takes a DAG `along` one path that does not begin with the trivial state.
        """
        graph = dag.graph.copy()
        for state in _undone(dag.graph):
            for undoing, previous in state.undo_actions():
                graph.add_edge(state, previous, key=str(undoing), action=undoing)
        leading = set(dag.goals).union(*(nx.ancestors(graph, goal) for goal in dag.goals))
        super().__init__(graph.subgraph(leading).copy(), dag.goals)
        self.dag = dag
        for start in starts:
            self.extend(start)

    def extend(self, state: TopologicalState) -> None:
        """Add a state, if it is new, and all that it can be undone to.

        Raises:
            UnreachableGoalError: no undoings lead from the state into the graph.
        """
        if state in self:
            return
        # Undoing leads down, so a state comes after all those that it can be undone to.
        new = [below for below in _undone([state]) if below not in self]
        for below in sorted(new, key=lambda one: (one.num_crossings, one)):
            edges = [edge for edge in below.undo_actions() if edge[1] in self]
            if not edges:
                continue
            for undoing, previous in edges:
                self.graph.add_edge(below, previous, key=str(undoing), action=undoing)
            self._edges[below] = tuple(sorted(edges, key=lambda edge: str(edge[0])))
            self._distance[below] = 1 + min(self._distance[previous] for _, previous in edges)
        if state not in self:
            raise UnreachableGoalError(
                f"the state {state} cannot be undone to any of the {len(self)} states from which "
                f"actions and undoings lead to {self._goal_names}"
            )

    def check_start(self, state: TopologicalState) -> None:
        """Refuse a state that is not in the graph.

        Raises:
            UnreachableGoalError: says what adds it.
        """
        if state not in self:
            raise UnreachableGoalError(
                f"the state {state} is none of the {len(self)} of this search graph to "
                f"{self._goal_names}: extend() adds it"
            )


def _undone(states: Iterable[TopologicalState]) -> set[TopologicalState]:
    """The states and all that they can be undone to."""
    found = set(states)
    waiting = list(found)
    while waiting:
        for _, previous in waiting.pop().undo_actions():
            if previous not in found:
                found.add(previous)
                waiting.append(previous)
    return found
