"""What a search tree is made of: nodes, the branches between them, and reports of its growth."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from knotflow.planning.dag import Edge
from knotflow.planning.plan_step import PlanStep
from knotflow.simulation import Attempts, Rollouts, SimulationConfig
from knotflow.topology import Action, Arrange, TopologicalState

DIVERGED = "diverged"
UNREADABLE = "unreadable"
"""Outcomes of a branch that have no state: the simulation blew up, or the projection of its end
shape does not determine its state."""
FRAGILE = "fragile"
"""Outcome of a branch that reached its state with the planner's rope, and with too few others."""


class Simulator(Protocol):
    """What the search needs of a simulator; `simulation.RopeSimulator` is one."""

    config: SimulationConfig

    def execute(self, points: NDArray, splines: NDArray) -> Rollouts:
        """Simulate splines (B, 6) on ropes (B, V, 3), each from rest to rest."""
        ...


@dataclass(eq=False)
class Node:
    """A rope at rest in the tree.

    Attributes:
        points: (V, 3) metres.
        state: its topological state, one of the solution DAG.
        distance: edges from its state to the goal.
        edges: the outgoing edges of its state in the solution DAG; none where the goal is reached.
        parent: the node it was reached from; None for the root.
        step: what was executed there; None for the root.
        ensemble: (V, 3) perturbed ropes that were executed with it, None for those that were lost;
            empty without an ensemble.
        steady: its step was simulated again and can be relied on (`soundness.are_steady`).
        failures: branches from this node that did not become nodes.
        values: (E,) probability of success along each edge, as far as one is known; else 1.
        arranged_values: (E,) the same after an arranging spline, where the sampler estimates it;
            else `values`.
        tries: (2, E) branches from here, those that act (`ACT`) and those that arrange (`ARRANGE`).
        successes: (2, E) those that reached the edge's state, or kept this one.
    """

    points: NDArray[np.float64]
    state: TopologicalState
    distance: int
    edges: tuple[Edge, ...] = ()
    parent: Node | None = None
    step: PlanStep | None = None
    ensemble: tuple[NDArray[np.float64] | None, ...] = ()
    steady: bool = False
    failures: int = 0
    values: NDArray[np.float64] = field(init=False)
    arranged_values: NDArray[np.float64] = field(init=False)
    tries: NDArray[np.float64] = field(init=False)
    successes: NDArray[np.float64] = field(init=False)

    def __post_init__(self) -> None:
        """Every edge is as promising as any, until a critic values it."""
        self.values = self.arranged_values = np.ones(len(self.edges))
        self.tries, self.successes = np.zeros((2, 2, len(self.edges)))

    @property
    def left(self) -> int:
        """How many ropes of the ensemble are left."""
        return sum(rope is not None for rope in self.ensemble)

    @property
    def survival(self) -> float:
        """Share of the ensemble that is left, and so the chance that a rope unlike the planner's
        comes this far; 1 without an ensemble."""
        return self.left / len(self.ensemble) if self.ensemble else 1.0

    @property
    def arranged(self) -> int:
        """How many arranging steps in a row led here."""
        if self.parent is None or self.step is None or not isinstance(self.step.action, Arrange):
            return 0
        return 1 + self.parent.arranged

    def way(self) -> tuple[Node, ...]:
        """The nodes from the root, which is left out, to here."""
        return () if self.parent is None else (*self.parent.way(), self)

    def steps(self) -> tuple[PlanStep, ...]:
        """What was executed from the root to here."""
        return steps_to(self.way())


def steps_to(nodes: Sequence[Node]) -> tuple[PlanStep, ...]:
    """What each of some nodes was reached by; the root by nothing."""
    return tuple(node.step for node in nodes if node.step is not None)


ACT, ARRANGE = 0, 1
"""The two kinds of a branch: for the action of an edge, or to make room for it."""


@dataclass(frozen=True, eq=False)
class Branch:
    """A spline that is to be executed from a node.

    Attributes:
        node: where it begins.
        edge: index of the node's edge it is for.
        kind: ACT or ARRANGE.
    """

    node: Node
    edge: int
    kind: int = ACT

    @property
    def wanted(self) -> Action:
        """The action of the edge."""
        return self.node.edges[self.edge][0]

    @property
    def action(self) -> Action:
        """What the branch does: the edge's action, or arranging for it."""
        return Arrange(self.wanted) if self.kind == ARRANGE else self.wanted

    @property
    def goal(self) -> TopologicalState:
        """The state in which it succeeds."""
        return self.node.state if self.kind == ARRANGE else self.node.edges[self.edge][1]


class Rule(Protocol):
    """Where a tree grows next."""

    def choose(self, count: int) -> list[Branch]:
        """The next branches, from the nodes added so far."""
        ...

    def learn(self, branch: Branch, child: Node | None) -> None:
        """Take the outcome of a branch into account; `child` is None where nothing was kept."""
        ...

    def add(self, node: Node) -> None:
        """Take a new node, valued, into account; after the branches of its batch were learnt."""
        ...

    def drop(self, nodes: Sequence[Node]) -> None:
        """Choose none of these nodes any more; all that grew from them is among them."""
        ...


@dataclass(frozen=True)
class SearchUpdate:
    """What a search reports after each batch.

    Attributes:
        branches: splines simulated so far.
        nodes: nodes of the tree, its root included.
        distance: edges from the nearest node to the goal; 0 when solved.
        seconds: wall time so far.
    """

    branches: int
    nodes: int
    distance: int
    seconds: float


Progress = Callable[[SearchUpdate], None]


def by_action(
    chosen: Sequence[Branch],
    splines: NDArray,
    rollouts: Rollouts,
    ends: Sequence[TopologicalState | None],
) -> Iterator[Attempts]:
    """A batch of branches, sorted by the state they began in and the action they were for."""
    rows: dict[tuple[TopologicalState, Action], list[int]] = {}
    for row, branch in enumerate(chosen):
        rows.setdefault((branch.node.state, branch.action), []).append(row)
    for (state, action), same in rows.items():
        points = np.stack([chosen[row].node.points for row in same])
        outcome = tuple(ends[row] for row in same)
        yield Attempts.of(action, state, points, splines[same], rollouts[same], outcome)
