"""The paper's rule where a tree grows next: a node, then one of its outgoing edges (Sec. V-B d).

The paper chooses a node at random, biased towards states nearer to the goal, and an edge of its
state at random. Beyond it, a critic may say how promising each edge is from the shape of the node:
shapes of one state differ much, and from some of them, such as loops that are too tight, nothing
succeeds.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from knotflow.planning.branches import Branch, Node
from knotflow.planning.config import PlannerConfig

LEAST_VALUE = 0.02
"""Added to every value: critics err, and a branch must not be given up for good."""


class PaperRule:
    """Independent draws of a node, then of one of its outgoing edges."""

    def __init__(self, config: PlannerConfig, rng: np.random.Generator) -> None:
        self._config, self._rng = config, rng
        self._nodes: list[Node] = []

    def choose(self, count: int) -> list[Branch]:
        """Branches drawn from the tree as it stands."""
        chances = node_probabilities(self._nodes, self._config)
        chosen = []
        for row in self._rng.choice(len(self._nodes), size=count, p=chances):
            node = self._nodes[row]
            edge = self._rng.choice(len(node.edges), p=edge_probabilities(node, self._config))
            chosen.append(Branch(node, int(edge)))
        return chosen

    def add(self, node: Node) -> None:
        """Draw it, too, from now on."""
        self._nodes.append(node)

    def drop(self, nodes: Sequence[Node]) -> None:
        """Draw them no more."""
        self._nodes = [node for node in self._nodes if node not in nodes]

    def learn(self, branch: Branch, child: Node | None) -> None:
        """Count a failure."""
        branch.node.failures += child is None


def node_probabilities(nodes: Sequence[Node], config: PlannerConfig) -> NDArray[np.float64]:
    """(N,) chance of each node to be expanded next.

    Proportional to bias ** -distance, and 0 where the goal is reached.
    """
    distance = np.array([node.distance for node in nodes])
    failures = np.array([node.failures for node in nodes])
    promise = np.array([_promise(node, config).mean() if node.edges else 1.0 for node in nodes])
    exponent = -distance * np.log(config.bias) + np.log(promise)
    exponent += failures * np.log(config.failure_discount)
    exponent[distance == 0] = -np.inf
    weight = np.exp(exponent - exponent.max())  # the largest is 1, however many failures
    return weight / weight.sum()


def edge_probabilities(node: Node, config: PlannerConfig) -> NDArray[np.float64]:
    """(E,) chance of each outgoing edge of a node that was chosen."""
    promise = _promise(node, config)
    return promise / promise.sum()


def _promise(node: Node, config: PlannerConfig) -> NDArray[np.float64]:
    return (node.values + LEAST_VALUE) ** config.value_bias
