"""Where a tree grows next: a node, then one of its outgoing edges (Sec. V-B d).

The paper chooses a node at random, biased towards states nearer to the goal, and an edge of its
state at random. Beyond it, a critic may say how promising each edge is from the shape of the node:
shapes of one state differ much, and from some of them, such as loops that are too tight, nothing
succeeds.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from knotflow.planning.branches import Node
from knotflow.planning.config import PlannerConfig
from knotflow.samplers import Sampler

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
