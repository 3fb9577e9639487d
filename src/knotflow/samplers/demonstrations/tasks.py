"""Tasks: an action from a start state; the eight topological actions of Fig. 6, and any others."""

from __future__ import annotations

import re
from dataclasses import dataclass

from knotflow.topology import Action, TopologicalState, parse_action, solution_graph


@dataclass(frozen=True)
class Task:
    """One topological action from one start state."""

    action: Action
    """The action to instantiate."""
    start_actions: tuple[Action, ...]
    """Actions that lead from the trivial state to the start state."""

    @property
    def name(self) -> str:
        """The action as a file name, such as "C_2_0_1"."""
        return re.sub(r"\W+", "_", str(self.action)).strip("_")

    @property
    def start_state(self) -> TopologicalState:
        """The state the rope is in before the action."""
        state = TopologicalState.trivial()
        for action in self.start_actions:
            state = state.apply(action)
        return state

    @property
    def goal_state(self) -> TopologicalState:
        """The state that counts as success."""
        return self.start_state.apply(self.action)


def _task(action: str, *start: str) -> Task:
    return Task(parse_action(action), tuple(parse_action(one) for one in start))


TASKS: tuple[Task, ...] = (
    _task("R1(0,1,1)"),
    _task("R2(0,0,1,1)"),
    _task("C(0,1,1)", "R1(0,1,1)"),
    _task("C(0,2,1)", "R1(0,1,1)"),
    _task("C(4,2,1)", "R1(0,1,1)", "C(1,2,1)"),
    _task("C(1,2,1)", "R1(0,1,1)"),
    _task("C(2,0,1)", "R1(0,1,1)", "C(0,1,1)"),
    _task("C(2,4,1)", "R1(0,1,1)", "C(0,1,1)"),
)
"""In the order of Fig. 6. The paper's text names five of them; its figure, which we do not have,
names the rest, for which C(1,2,1) and C(4,2,1) (Fig. 1's second overhand path) and C(0,2,1) stand.
"""


def task(action: str) -> Task:
    """The task of an action written like "C(2,0,1)".

    Raises:
        ValueError: for an action that is not one of the eight, naming those.
    """
    for candidate in TASKS:
        if str(candidate.action) == action:
            return candidate
    names = ", ".join(str(candidate.action) for candidate in TASKS)
    raise ValueError(f"no demonstrated action is called {action!r}; the eight are {names}")


def task_at(state: TopologicalState, action: Action) -> Task:
    """The task of an action in a state: one of the eight, or one whose start state is reached on a
    shortest way from the trivial one.

    Raises:
        IllegalActionError: the state does not allow the action.
    """
    import networkx as nx  # slow to import

    state.apply(action)
    for candidate in TASKS:
        if candidate.action == action and candidate.start_state == state:
            return candidate
    graph = solution_graph(state)
    path = nx.shortest_path(graph, TopologicalState.trivial(), state)
    steps = [next(iter(graph[a][b].values()))["action"] for a, b in nx.utils.pairwise(path)]
    return Task(action, tuple(steps))
