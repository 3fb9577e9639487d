"""Robust plans: ropes unlike the planner's go through a plan with it.

A spline that ties the planner's rope may fail on one with another friction or stiffness, and what
is off after one step is off further after the next. So every node of a search may carry the shapes
of N perturbed ropes, each executing what the planner's rope executed, open loop and with a gripper
that errs. The search prefers nodes that more of them reach, and goes on from the first plan to such
as more of them execute, until enough do or its budget is spent.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from knotflow.planning.branches import Node, Simulator
from knotflow.planning.config import PlannerConfig
from knotflow.simulation import (
    ACTUATION,
    REACH,
    RopeSimulator,
    SimulationConfig,
    clip_splines,
    grasped_link,
    perturb_rope,
    state_or_none,
)


class Ensemble:
    """N perturbed ropes, and how they fare where the planner's rope was taken."""

    def __init__(
        self,
        simulation: SimulationConfig,
        config: PlannerConfig,
        rng: np.random.Generator,
        simulators: Sequence[Simulator] | None = None,
    ) -> None:
        """Draw the ropes and the gripper's errors; `simulators` takes the place of the ropes'."""
        level, ropes = config.ensemble_level, config.ensemble
        self._simulators: Sequence[Simulator] = simulators or [
            RopeSimulator(replace(simulation, rope=perturb_rope(simulation.rope, level, rng)))
            for _ in range(ropes)
        ]
        self._radius, self._sway = simulation.rope.radius, ACTUATION[level]
        self._enough = config.survival * len(self._simulators)
        self._least = 1
        self._rng = rng

    def lay(self, root: Node) -> None:
        """All ropes begin where the planner's does."""
        root.ensemble = tuple(
            root.points + [0.0, 0.0, simulator.config.rope.radius - self._radius]
            for simulator in self._simulators
        )

    def suffices(self, node: Node) -> bool:
        """Whether so many ropes are left that no better plan than to this node is sought."""
        return node.left >= self._enough

    def falls_short(self, node: Node) -> bool:
        """Whether too few ropes are left at a node for a plan beyond it to be kept."""
        return node.left < self._least

    def surpass(self, node: Node) -> None:
        """From now on keep only what more ropes reach than this node."""
        self._least = node.left + 1

    def survivors(self, nodes: Sequence[Node]) -> list[Node]:
        """Those of the new nodes whose state enough ropes reach; they carry these ropes' shapes.

        A rope that was lost before stays lost. Where too many are, the others are not tried.
        """
        shapes: list[list[NDArray | None]] = [[None] * len(self._simulators) for _ in nodes]
        for number, simulator in enumerate(self._simulators):
            to_come = len(self._simulators) - number
            rows: list[int] = []
            starts: list[NDArray] = []
            splines: list[NDArray] = []
            for row, node in enumerate(nodes):
                assert node.parent is not None and node.step is not None
                rope = node.parent.ensemble[number]
                so_far = sum(shape is not None for shape in shapes[row])
                if rope is None or so_far + to_come < self._least:
                    continue
                spline = self._sent(node.step.spline, node.parent.points, rope)
                if spline is not None:
                    rows.append(row)
                    starts.append(rope)
                    splines.append(spline)
            if not rows:
                continue
            rollouts = simulator.execute(np.stack(starts), np.stack(splines))
            for place, row in enumerate(rows):
                end = rollouts.end_points[place]
                if not rollouts.diverged[place] and state_or_none(end) == nodes[row].state:
                    shapes[row][number] = end
        kept = []
        for node, own in zip(nodes, shapes, strict=True):
            node.ensemble = tuple(own)
            if not self.falls_short(node):
                kept.append(node)
        return kept

    def _sent(self, spline: NDArray, planned: NDArray, rope: NDArray) -> NDArray[np.float64] | None:
        """What a gripper that is sent along the spline (6,) for the planner's rope (V, 3) does to
        another one; None where it grasps beside it.

        The rope stays in the fingers where it was caught, as far off as it was then.
        """
        link = int(grasped_link(spline, len(planned) - 1))
        closing, at_grasp, midway, at_end = (
            self._rng.normal(0.0, self._sway, (4, 2)) if self._sway else np.zeros((4, 2))
        )
        hand = (planned[link] + planned[link + 1]) / 2 + [*at_grasp, 0.0]
        centres = (rope[1:] + rope[:-1]) / 2
        distance = np.linalg.norm(centres - (hand + [*closing, 0.0]), axis=1)
        caught = int(distance.argmin())
        if distance[caught] > REACH:
            return None
        sent = spline.copy()
        if caught != link:
            sent[0] = (caught + 0.5) / len(centres)
        off = (centres[caught] - hand)[:2]
        sent[1:3] += off + midway
        sent[4:6] += off + at_end
        return clip_splines(sent)
