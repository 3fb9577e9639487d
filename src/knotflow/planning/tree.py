"""Tree search over rope shapes and their topological states (paper Sec. V-B d).

At each expansion a node of the tree is chosen at random, leaf or not, biased towards states that
are nearer to the goal in the solution DAG; then an outgoing edge of its state at random. The
sampler proposes a spline for the edge's action, the simulator executes it, and the end shape
becomes a node only if it has exactly the state that the action leads to. The search ends when a
goal state is reached.

With `batch` above 1 as many expansions are chosen by the same rule from the tree as it stands, and
simulated at once. Every plan found is as valid as one found one by one; the tree is somewhat
larger, because the choices of a batch do not know of each other's outcomes.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from knotflow.planning.branches import (
    DIVERGED,
    UNREADABLE,
    Node,
    Progress,
    SearchUpdate,
    Simulator,
)
from knotflow.planning.config import PlannerConfig
from knotflow.planning.dag import Edge
from knotflow.planning.goals import Goal
from knotflow.planning.growth import (
    appraise,
    edge_probabilities,
    node_probabilities,
)
from knotflow.planning.plan import KnotPlan, PlanStep, Tried
from knotflow.samplers import Sampler
from knotflow.simulation import Attempts, Observer, Rollouts, check_points, end_states
from knotflow.topology import Action, TopologicalState


@dataclass(eq=False)
class _Clock:
    """Where the seconds of a search go."""

    began: float = field(default_factory=time.perf_counter)
    sampling: float = 0.0
    simulation: float = 0.0

    @property
    def seconds(self) -> float:
        return time.perf_counter() - self.began


class TreeSearch:
    """A tree in the making; `run` grows it until the goal is reached or a budget is spent."""

    def __init__(
        self,
        points: NDArray,
        goal: Goal,
        sampler: Sampler,
        simulator: Simulator,
        rng: np.random.Generator,
        config: PlannerConfig | None = None,
        observe: Observer | None = None,
    ) -> None:
        """Plant the root: see `plan_knot` for the arguments and errors."""
        self.goal, self.sampler, self.simulator, self.rng = goal, sampler, simulator, rng
        self.config, self.observe = config or PlannerConfig(), observe
        points = check_points(points, simulator.config.rope)
        state = TopologicalState.from_curve(points)
        self.nodes = [self._node(points, state)]
        self.branches = 0
        self.tried: Counter[tuple[TopologicalState, Action, str, bool]] = Counter()
        self._clock = _Clock()

    def expand(self, count: int) -> SearchUpdate:
        """Choose, sample and simulate `count` branches, and add those that succeed."""
        chosen = self._choose(count)
        clock = time.perf_counter()
        splines = self._sample(chosen)
        self._clock.sampling += time.perf_counter() - clock
        clock = time.perf_counter()
        rollouts = self.simulator.execute(np.stack([node.points for node, _ in chosen]), splines)
        self._clock.simulation += time.perf_counter() - clock
        ends = end_states(rollouts)
        known = len(self.nodes)
        for row, (node, edge) in enumerate(chosen):
            self._add(node, edge, splines[row], rollouts, row, ends[row])
        clock = time.perf_counter()
        appraise(self.nodes[known:], self.sampler, self.config, self.rng)
        self._clock.sampling += time.perf_counter() - clock
        self.branches += count
        if self.observe is not None:
            for attempts in _by_action(chosen, splines, rollouts, ends):
                self.observe(attempts)
        nearest = min(node.distance for node in self.nodes)
        return SearchUpdate(self.branches, len(self.nodes), nearest, self._clock.seconds)

    def run(self, progress: Progress | None = None) -> KnotPlan:
        """Grow the tree; see `plan_knot`."""
        config = self.config
        self._clock = _Clock()
        appraise(self.nodes[:1], self.sampler, self.config, self.rng)
        reason = ""
        while not reason:
            if any(node.distance == 0 for node in self.nodes):
                tied = "the rope was tied already" if not self.branches else "the goal was reached"
                return self._plan(solved=True, reason=tied)
            if self.branches >= config.max_branches:
                reason = f"{config.max_branches} branches were simulated without reaching the goal"
            elif self._clock.seconds >= config.max_seconds:
                reason = f"{config.max_seconds:g} s passed without reaching the goal"
            else:
                update = self.expand(min(config.batch, config.max_branches - self.branches))
                if progress is not None:
                    progress(update)
        return self._plan(solved=False, reason=reason)

    def _choose(self, count: int) -> list[tuple[Node, Edge]]:
        """Independent draws of a node, then of one of its outgoing edges."""
        chances = node_probabilities(self.nodes, self.config)
        chosen = []
        for row in self.rng.choice(len(self.nodes), size=count, p=chances):
            node = self.nodes[row]
            edge = self.rng.choice(len(node.edges), p=edge_probabilities(node, self.config))
            chosen.append((node, node.edges[edge]))
        return chosen

    def _node(
        self,
        points: NDArray,
        state: TopologicalState,
        parent: Node | None = None,
        step: PlanStep | None = None,
    ) -> Node:
        dag = self.goal.dag
        return Node(points, state, dag.distance(state), dag.edges_from(state), parent, step)

    def _sample(self, chosen: list[tuple[Node, Edge]]) -> NDArray[np.float64]:
        """Splines (B, 6), asking the sampler once for all branches of one node and action."""
        rows: dict[tuple[int, Action], list[int]] = {}
        for row, (node, (action, _)) in enumerate(chosen):
            rows.setdefault((id(node), action), []).append(row)
        splines = np.empty((len(chosen), 6))
        for (_, action), same in rows.items():
            points = chosen[same[0]][0].points
            splines[same] = self.sampler.sample(points, action, len(same), self.rng)
        return splines

    def _add(
        self,
        node: Node,
        edge: Edge,
        spline: NDArray,
        rollouts: Rollouts,
        row: int,
        state: TopologicalState | None,
    ) -> None:
        """Judge one branch, and add its end to the tree if it has exactly the action's state."""
        action, goal_state = edge
        end = rollouts.end_points[row]
        success = state == goal_state
        if success:
            step = PlanStep(
                action=action,
                spline=spline.copy(),
                start=node.points,
                start_state=node.state,
                end=end.copy(),
                end_state=goal_state,
                times=rollouts.times,
                trajectory=rollouts.trajectory[row].copy(),
                gripper=rollouts.gripper[row].copy(),
            )
            self.nodes.append(self._node(step.end, goal_state, node, step))
        else:
            node.failures += 1
        lost = DIVERGED if rollouts.diverged[row] else UNREADABLE
        outcome = lost if state is None else str(state)
        self.tried[node.state, action, outcome, success] += 1

    def _plan(self, solved: bool, reason: str) -> KnotPlan:
        # The first of the nearest nodes: the goal's, or the farthest that a failed search came.
        best = min(self.nodes, key=lambda node: node.distance)
        root, simulation = self.nodes[0], self.simulator.config
        return KnotPlan(
            goal=self.goal.name,
            goal_states=tuple(sorted(self.goal.states)),
            solved=solved,
            reason=reason,
            start=root.points,
            start_state=root.state,
            steps=best.steps(),
            tried=tuple(
                Tried(state, action, outcome, success, count)
                for (state, action, outcome, success), count in self.tried.items()
            ),
            branches=self.branches,
            nodes=len(self.nodes),
            seconds=self._clock.seconds,
            sampling_seconds=self._clock.sampling,
            simulation_seconds=self._clock.simulation,
            radius=simulation.rope.radius,
            move_time=simulation.move_time,
        )


def _by_action(
    chosen: list[tuple[Node, Edge]],
    splines: NDArray,
    rollouts: Rollouts,
    ends: Sequence[TopologicalState | None],
) -> Iterator[Attempts]:
    """A batch of branches, sorted by the state they began in and the action they were for."""
    rows: dict[tuple[TopologicalState, Action], list[int]] = {}
    for row, (node, (action, _)) in enumerate(chosen):
        rows.setdefault((node.state, action), []).append(row)
    for (state, action), same in rows.items():
        points = np.stack([chosen[row][0].points for row in same])
        outcome = tuple(ends[row] for row in same)
        yield Attempts(action, state, points, splines[same], rollouts[same], outcome)


def plan_knot(
    points: NDArray,
    goal: Goal,
    sampler: Sampler,
    simulator: Simulator,
    rng: np.random.Generator,
    config: PlannerConfig | None = None,
    progress: Progress | None = None,
    observe: Observer | None = None,
) -> KnotPlan:
    """Plan how to tie a knot into a rope as it lies (Sec. V-B d).

    The same rng gives the same plan for the same batch size, unless `max_seconds` ends it.

    Args:
        points: (V, 3) the rope at rest, metres; its state may be any of the goal's solution DAG.
        goal: what to tie.
        sampler: proposes splines.
        simulator: executes them.
        rng: everything random comes from it.
        config: bias, batch size and budgets.
        progress: called after every batch.
        observe: called with every batch's attempts, one action and start state at a time; their
            rollouts are all that the search simulates.

    Returns:
        The plan; one that is not solved holds the steps to the node nearest to the goal, what was
        tried, and why the search stopped.

    Raises:
        UnreachableGoalError: no actions lead from the rope's state to the goal.
        ShapeError: points that are not a shape of the simulator's rope.
        DegenerateCurveError: the projection of the rope does not determine its state.

    Warns:
        UnlikeRopeWarning: a trained sampler has learned with a rope of another size.
    """
    search = TreeSearch(points, goal, sampler, simulator, rng, config, observe)
    if (warn := getattr(sampler, "warn_if_unlike", None)) is not None:
        warn(simulator.config.rope)
    return search.run(progress)
