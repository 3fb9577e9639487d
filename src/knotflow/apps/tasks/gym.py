"""Tying a rope as a Gymnasium environment, "knotflow/Tie-v0"."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box, Dict
from numpy.typing import NDArray

from knotflow.apps.tasks.encoding import ACTION_SIZE, action_code, goal_codes, to_splines
from knotflow.apps.tasks.episodes import Episodes
from knotflow.apps.tasks.task import TieTask
from knotflow.simulation import RopeSimulator, SimulationConfig

REACH = 10.0
"""Bound of the observed points, metres; a rope of 1 m on splines of +-0.6 m is far inside."""


class TieEnv(gymnasium.Env[dict[str, Any], NDArray]):
    """One rope on a table; each step is one spline, from rest to rest. Rules: `tasks.episodes`.

    An observation has
        points: (V, 3) float32, the rope as it lies, metres, head first, world frame;
        goals: (G, C, 3) int8, the states that count as success, see `goal_codes`;
        action: (5,) int8, the topological action that is asked for, see `action_code`.
    An action is a spline's 6 numbers, each scaled from its range to [-1, 1] (`to_box`). The reward
    is 1 when a goal state is reached, otherwise 0. `info` has `state` (text, or None where it
    cannot be read), `actions` (texts, the actions of the solution DAG that lead on from there),
    `is_success` and `diverged`.
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
            modes = ", ".join(self.metadata["render_modes"])
            raise ValueError(f"unknown render_mode {render_mode!r}; choose None or {modes}")
        self.task = TieTask.tie(task) if isinstance(task, str) else task
        self.render_mode = render_mode
        # A single rope gains nothing from threads.
        simulator = RopeSimulator(simulation or SimulationConfig(threads=1))
        self.episodes = Episodes(self.task, 1, simulator)
        """The game itself, for what the observation does not say."""
        self._goals = goal_codes(self.task)
        self._action = action_code(self.task.action)
        self.observation_space = Dict(
            points=Box(-REACH, REACH, self.episodes.points.shape[1:], np.float32),
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
        options = dict(options or {})
        index = options.pop("start", None)
        if options:
            raise ValueError(f"unknown options {sorted(options)}; there is: start")
        self.episodes.reset(0, self.np_random, index)
        return self._observation(), self._info(False, False)

    def step(self, action: NDArray) -> tuple[dict[str, NDArray], float, bool, bool, dict[str, Any]]:
        """Execute one spline, given as 6 numbers of [-1, 1]."""
        outcome = self.episodes.step(to_splines(action)[None])
        success = bool(outcome.success[0])
        return (
            self._observation(),
            float(success),
            bool(outcome.terminated[0]),
            bool(outcome.truncated[0]),
            self._info(success, bool(outcome.diverged[0])),
        )

    def render(self) -> NDArray[np.uint8] | None:  # type: ignore[override]
        """The rope from above as an image (480, 480, 3), where that was asked for."""
        if self.render_mode is None:
            return None
        from knotflow.apps.tasks.picture import picture

        return picture(self.episodes.points[0], self.episodes.simulator.config.rope.radius)

    def _observation(self) -> dict[str, NDArray]:
        return {
            "points": self.episodes.points[0].astype(np.float32),
            "goals": self._goals.copy(),
            "action": self._action.copy(),
        }

    def _info(self, success: bool, diverged: bool) -> dict[str, Any]:
        state = self.episodes.states[0]
        return {
            "state": None if state is None else str(state),
            "actions": tuple(str(action) for action in self.task.actions(state)),
            "is_success": success,
            "diverged": diverged,
        }
