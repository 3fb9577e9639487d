"""Where a tree grows next: a node, then one of its outgoing edges (Sec. V-B d).

The paper chooses a node at random, biased towards states nearer to the goal, and an edge of its
state at random. Beyond it, a critic may say how promising each edge is from the shape of the node:
shapes of one state differ much, and from some of them, such as loops that are too tight, nothing
succeeds.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from knotflow.planning.branches import Node
from knotflow.samplers import Sampler


@dataclass
class PlannerConfig:
    """How the tree grows, and when to give up."""

    bias: float = 10.0
    """How many times likelier a node is chosen than one that is one edge farther from the goal;
    1 is no bias."""
    batch: int = 1
    """Splines simulated at once; 1 is the paper's search."""
    max_branches: int = 2000
    """Give up after this many simulated splines."""
    max_seconds: float = 600.0
    """Give up after this time, seconds of wall clock; a batch that has begun is finished."""
    value_bias: float = 0.0
    """Exponent of the value of a branch, the probability of success that the sampler's critic gives
    it, on its chance to be grown; 0 is the paper's rule. Without a critic every value is 1."""
    failure_discount: float = 1.0
    """Factor on a node's weight for every branch that failed from it; 1 is the paper's rule. Below
    1 the search leaves nodes from which nothing succeeds, such as loops that are too tight."""

    def __post_init__(self) -> None:
        """Refuse values that make no search."""
        if not self.bias >= 1.0:
            raise ValueError(f"planner.bias must be 1 or more, got {self.bias}")
        if not self.value_bias >= 0.0:
            raise ValueError(f"planner.value_bias must be 0 or more, got {self.value_bias}")
        for name in ("batch", "max_branches"):
            if getattr(self, name) < 1:
                raise ValueError(f"planner.{name} must be 1 or more, got {getattr(self, name)}")
        if not self.max_seconds > 0.0:
            raise ValueError(f"planner.max_seconds must be above 0, got {self.max_seconds}")
        if not 0.0 < self.failure_discount <= 1.0:
            raise ValueError(
                f"planner.failure_discount must lie in (0, 1], got {self.failure_discount}"
            )


LEAST_VALUE = 0.02
"""Added to every value: critics err, and a branch must not be given up for good."""


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


def appraise(
    nodes: Sequence[Node], sampler: Sampler, config: PlannerConfig, rng: np.random.Generator
) -> None:
    """Let the sampler's critic, if it has one and it counts, value the edges of new nodes."""
    values = getattr(sampler, "values", None)
    pairs = [(node, action) for node in nodes for action, _ in node.edges]
    if values is None or config.value_bias == 0 or not pairs:
        return
    found = values(np.stack([node.points for node, _ in pairs]), [edge for _, edge in pairs], rng)
    begin = 0
    for node in nodes:
        node.values = np.asarray(found[begin : begin + len(node.edges)])
        begin += len(node.edges)


def _promise(node: Node, config: PlannerConfig) -> NDArray[np.float64]:
    return (node.values + LEAST_VALUE) ** config.value_bias
