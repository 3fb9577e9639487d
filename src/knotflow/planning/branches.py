"""What a search tree is made of: nodes, the branches between them, and reports of its growth."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from knotflow.planning.dag import Edge
from knotflow.planning.plan_step import PlanStep
from knotflow.simulation import Rollouts, SimulationConfig
from knotflow.topology import TopologicalState

DIVERGED = "diverged"
UNREADABLE = "unreadable"
"""Outcomes of a branch that have no state: the simulation blew up, or the projection of its end
shape does not determine its state."""


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
        failures: branches from this node that did not become nodes.
        values: (E,) probability of success along each edge, as far as a critic told; else 1.
    """

    points: NDArray[np.float64]
    state: TopologicalState
    distance: int
    edges: tuple[Edge, ...] = ()
    parent: Node | None = None
    step: PlanStep | None = None
    failures: int = 0
    values: NDArray[np.float64] = field(init=False)

    def __post_init__(self) -> None:
        """Every edge is as promising as any, until a critic tells."""
        self.values = np.ones(len(self.edges))

    def steps(self) -> tuple[PlanStep, ...]:
        """What was executed from the root to here."""
        steps: list[PlanStep] = []
        node: Node | None = self
        while node is not None and node.step is not None:
            steps.append(node.step)
            node = node.parent
        return tuple(reversed(steps))


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
