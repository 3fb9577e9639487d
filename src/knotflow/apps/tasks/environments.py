"""Tying ropes as Gymnasium environments: one rope, or many that are simulated together."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box, Dict
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from knotflow.apps.tasks.task import (
    ACTION_SIZE,
    Episodes,
    StepResult,
    TieTask,
    action_code,
    goal_codes,
    to_splines,
)
from knotflow.simulation import RopeSimulator, SimulationConfig

REACH = 10.0
"""Bound of the observed points, metres; a rope of 1 m on splines of +-0.6 m is far inside."""


class TieVectorEnv(VectorEnv[dict[str, Any], NDArray, NDArray]):
    """Ropes on tables of their own; each step is one spline a rope, from rest to rest.

    The rules are in `tasks.task`. An observation has, with a leading axis of `num_envs`,
        points: (V, 3) float32, the rope as it lies, metres, head first, world frame;
        goals: (G, C, 3) int8, the states that count as success, see `goal_codes`;
        action: (5,) int8, the topological action that is asked for, see `action_code`.
    An action is a spline's 6 numbers, each scaled from its range to [-1, 1] (`to_box`). The reward
    is 1 when a goal state is reached, otherwise 0. `info` has `state` (text, or None where it
    cannot be read), `actions` (texts, the actions of the solution DAG in that state),
    `is_success` and `diverged`. A rope whose episode has ended is laid anew in the next step.
    """

    metadata: dict[str, Any] = {
        "render_modes": ["rgb_array"],
        "render_fps": 2,
        "autoreset_mode": AutoresetMode.NEXT_STEP,
    }

    def __init__(
        self,
        num_envs: int = 16,
        task: TieTask | str = "overhand",
        simulation: SimulationConfig | None = None,
        render_mode: str | None = None,
    ) -> None:
        """A task, or the text of a goal to tie into random ropes: "overhand", "4o1+2o5+6o3+".

        Raises:
            ValueError: a text that names no goal, an unknown render mode, or no rope at all.
        """
        if num_envs < 1:
            raise ValueError(f"a vector environment has at least 1 rope, got {num_envs}")
        if render_mode not in (None, *self.metadata["render_modes"]):
            modes = ", ".join(self.metadata["render_modes"])
            raise ValueError(f"unknown render_mode {render_mode!r}; choose None or {modes}")
        self.num_envs = num_envs
        self.render_mode = render_mode
        self.task = TieTask.tie(task) if isinstance(task, str) else task
        self.episodes = Episodes(
            self.task, num_envs, RopeSimulator(simulation or SimulationConfig())
        )
        """The ropes and their states."""
        self._ended = np.zeros(num_envs, bool)
        goals, action = goal_codes(self.task), action_code(self.task.action)
        self._constants = {
            "goals": np.repeat(goals[None], num_envs, axis=0),
            "action": np.repeat(action[None], num_envs, axis=0),
        }
        self.single_observation_space = Dict(
            points=Box(-REACH, REACH, self.episodes.points.shape[1:], np.float32),
            goals=Box(-1, 127, goals.shape, np.int8),
            action=Box(-1, 127, (ACTION_SIZE,), np.int8),
        )
        self.single_action_space = Box(-1.0, 1.0, (6,), np.float32)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, NDArray], dict[str, Any]]:
        """Lay a rope on each table; `options={"start": i}` takes the i-th of the task's starts.

        Raises:
            ValueError: an unknown option, or no such start.
        """
        super().reset(seed=seed)
        options = dict(options or {})
        index = options.pop("start", None)
        if options:
            raise ValueError(f"unknown options {sorted(options)}; there is: start")
        for row in range(self.num_envs):
            self.episodes.reset(row, self.np_random, index)
        self._ended[:] = False
        return self._observation(), self._info(None)

    def step(
        self, actions: NDArray
    ) -> tuple[dict[str, NDArray], NDArray, NDArray, NDArray, dict[str, Any]]:
        """Execute one spline a rope, given as numbers (num_envs, 6) of [-1, 1]."""
        again = np.flatnonzero(self._ended)
        outcome = self.episodes.step(to_splines(actions))
        for row in again.tolist():
            self.episodes.reset(row, self.np_random)
            for flags in vars(outcome).values():
                flags[row] = False
        ends = outcome.terminated, outcome.truncated
        self._ended = outcome.terminated | outcome.truncated
        return self._observation(), outcome.success.astype(float), *ends, self._info(outcome)

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """Each rope from above as an image (480, 480, 3), if the render mode is "rgb_array"."""
        if self.render_mode is None:
            return None
        from knotflow.viz.rope import rope_image

        width, window = 2 * self.episodes.simulator.config.rope.radius, (-0.7, 0.7)
        ropes = self.episodes.points
        return tuple(rope_image(rope, width, window, window, (480, 480)) for rope in ropes)

    def _observation(self) -> dict[str, NDArray]:
        points = self.episodes.points.astype(np.float32)
        return {"points": points} | {name: code.copy() for name, code in self._constants.items()}

    def _info(self, outcome: StepResult | None) -> dict[str, Any]:
        """Arrays (num_envs,) of what the observation does not tell; no outcome after a reset."""
        states, none = self.episodes.states, np.zeros(self.num_envs, bool)
        actions = np.empty(self.num_envs, object)
        actions[:] = [tuple(map(str, self.task.actions(state))) for state in states]
        return {
            "state": np.array([None if one is None else str(one) for one in states], object),
            "actions": actions,
            "is_success": none if outcome is None else outcome.success,
            "diverged": none if outcome is None else outcome.diverged,
        }


class TieEnv(gymnasium.Env[dict[str, Any], NDArray]):
    """One rope on a table, "knotflow/Tie-v0": a `TieVectorEnv` of one rope, without its axis."""

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 2}

    def __init__(
        self,
        task: TieTask | str = "overhand",
        simulation: SimulationConfig | None = None,
        render_mode: str | None = None,
    ) -> None:
        """Arguments and errors are those of `TieVectorEnv`."""
        # A single rope gains nothing from threads.
        simulation = simulation or SimulationConfig(threads=1)
        self.vector = TieVectorEnv(1, task, simulation, render_mode)
        self.task, self.episodes = self.vector.task, self.vector.episodes
        self.render_mode = render_mode
        self.observation_space = self.vector.single_observation_space
        self.action_space = self.vector.single_action_space

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, NDArray], dict[str, Any]]:
        """See `TieVectorEnv.reset`."""
        super().reset(seed=seed)
        self.vector.np_random = self.np_random
        observation, info = self.vector.reset(options=options)
        return _first(observation), _first(info)

    def step(self, action: NDArray) -> tuple[dict[str, NDArray], float, bool, bool, dict[str, Any]]:
        """Execute one spline, given as 6 numbers of [-1, 1]."""
        observation, reward, terminated, truncated, info = self.vector.step(
            np.asarray(action)[None]
        )
        flags = bool(terminated[0]), bool(truncated[0])
        return _first(observation), float(reward[0]), *flags, _first(info)

    def render(self) -> NDArray[np.uint8] | None:  # type: ignore[override]
        """The rope from above as an image (480, 480, 3), if the render mode is "rgb_array"."""
        images = self.vector.render()
        return None if images is None else images[0]


def _first(batch: dict[str, Any]) -> dict[str, Any]:
    """Row 0 of every value; flags as Python's."""
    return {
        name: bool(values[0]) if values.dtype == bool else values[0]
        for name, values in batch.items()
    }
