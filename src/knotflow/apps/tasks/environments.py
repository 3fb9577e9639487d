"""Tying a rope as a Gymnasium environment."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box, Dict
from numpy.typing import NDArray

from knotflow.apps.tasks.task import ACTION_SIZE, TieTask, action_code, goal_codes, to_splines
from knotflow.simulation import RopeSimulator, SimulationConfig, end_states, state_or_none

REACH = 10.0
"""Bound of the observed points, metres; a rope of 1 m on splines of +-0.6 m is far inside."""


class TieEnv(gymnasium.Env[dict[str, Any], NDArray]):
    """A rope on a table, "knotflow/Tie-v0"; each step is one spline, from rest to rest.

    After each spline the state is read: in a goal state the episode is won, with a reward of 1; off
    the solution DAG, unreadable or diverged it is lost; else it continues until its splines are
    used up. An observation has
        points: (V, 3) float32, the rope as it lies, metres, head first, world frame;
        goals: (G, C, 3) int8, the states that count as success, see `goal_codes`;
        action: (5,) int8, the topological action that is asked for, see `action_code`.
    An action is a spline's 6 numbers, each scaled from its range to [-1, 1] (`to_box`). `info` has
    `state` (text, or None where it cannot be read), `actions` (texts, the actions of the solution
    DAG in that state), `is_success` and `diverged`.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 2}

    def __init__(
        self,
        task: TieTask | str = "overhand",
        simulation: SimulationConfig | None = None,
        render_mode: str | None = None,
    ) -> None:
        """A task, or the text of a goal to tie into random ropes: "overhand", "4o1+2o5+6o3+".

        Raises:
            ValueError: a text that names no goal, or an unknown render mode.
        """
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise ValueError(f"unknown render_mode {render_mode!r}; choose None or rgb_array")
        self.render_mode = render_mode
        self.task = TieTask.tie(task) if isinstance(task, str) else task
        # A single rope gains nothing from threads.
        self.simulator = RopeSimulator(simulation or SimulationConfig(threads=1))
        self.points = np.zeros((self.simulator.config.rope.num_vertices, 3))
        """(V, 3) the rope as it lies, metres."""
        self.state = state_or_none(self.points)
        self.used = 0
        """Splines executed in this episode."""
        self._goals, self._action = goal_codes(self.task), action_code(self.task.action)
        self.observation_space = Dict(
            points=Box(-REACH, REACH, self.points.shape, np.float32),
            goals=Box(-1, 127, self._goals.shape, np.int8),
            action=Box(-1, 127, (ACTION_SIZE,), np.int8),
        )
        self.action_space = Box(-1.0, 1.0, (6,), np.float32)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, NDArray], dict[str, Any]]:
        """Lay a rope on the table; `options={"start": i}` takes the i-th of the task's starts.

        Raises:
            ValueError: an unknown option, or no such start.
        """
        super().reset(seed=seed)
        if unknown := set(options or {}) - {"start"}:
            raise ValueError(f"unknown options {sorted(unknown)}; there is: start")
        start = (options or {}).get("start")
        self.points = self.task.start(self.np_random, self.simulator.config.rope, start)
        self.state = state_or_none(self.points)
        self.used = 0
        return self._observation(), self._info(success=False, diverged=False)

    def step(self, action: NDArray) -> tuple[dict[str, NDArray], float, bool, bool, dict[str, Any]]:
        """Execute one spline, given as 6 numbers of [-1, 1]."""
        return self.execute(to_splines(action))

    def execute(
        self, spline: NDArray
    ) -> tuple[dict[str, NDArray], float, bool, bool, dict[str, Any]]:
        """As `step`, with a spline (6,) as samplers propose it.

        Raises:
            SplineError: it is out of range.
        """
        rollouts = self.simulator.execute(self.points[None], np.asarray(spline)[None])
        (self.points,), (self.state,) = rollouts.end_points, end_states(rollouts)
        self.used += 1
        success = self.state in self.task.goal.states
        terminated = success or self.state is None or self.state not in self.task.goal.dag
        truncated = not terminated and self.used >= self.task.splines
        info = self._info(success, bool(rollouts.diverged[0]))
        return self._observation(), float(success), terminated, truncated, info

    def render(self) -> NDArray[np.uint8] | None:  # type: ignore[override]
        """The rope from above as an image (480, 480, 3), if the render mode is "rgb_array"."""
        if self.render_mode is None:
            return None
        from knotflow.viz.rope import rope_image

        width, window = 2 * self.simulator.config.rope.radius, (-0.7, 0.7)
        return rope_image(self.points, width, window, window, (480, 480))

    def _observation(self) -> dict[str, NDArray]:
        points = self.points.astype(np.float32)
        return {"points": points, "goals": self._goals.copy(), "action": self._action.copy()}

    def _info(self, success: bool, diverged: bool) -> dict[str, Any]:
        return {
            "state": None if self.state is None else str(self.state),
            "actions": tuple(map(str, self.task.actions(self.state))),
            "is_success": success,
            "diverged": diverged,
        }
