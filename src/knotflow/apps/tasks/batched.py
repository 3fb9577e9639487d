"""Tying many ropes at once, as a TorchRL environment."""

from __future__ import annotations

import numpy as np
import torch
from tensordict import TensorDict, TensorDictBase
from torchrl.data import Binary, Bounded, Composite, Unbounded
from torchrl.envs import EnvBase

from knotflow.apps.tasks.encoding import ACTION_SIZE, action_code, goal_codes, to_splines
from knotflow.apps.tasks.episodes import Episodes
from knotflow.apps.tasks.task import TieTask
from knotflow.simulation import RopeSimulator, SimulationConfig


class BatchedTieEnv(EnvBase):
    """`batch` ropes on tables of their own, one simulator; the keys and rules of `TieEnv`.

    Batch-locked: all tensors have batch size [batch]. "points" are float32 (V, 3), "goals" int8
    (G, C, 3), "action_code" int8 (5,) is `TieEnv`'s observation "action"; "action" is the spline,
    float32 (6,) of [-1, 1]; "success" (1,) is the reward as a flag.
    """

    def __init__(
        self,
        task: TieTask | str = "overhand",
        batch: int = 16,
        simulation: SimulationConfig | None = None,
        seed: int = 0,
    ) -> None:
        """A task, or the text of a goal to tie into random ropes.

        Raises:
            ValueError: a text that names no goal, or no rope at all.
        """
        if batch < 1:
            raise ValueError(f"a batch has at least 1 rope, got {batch}")
        super().__init__(device="cpu", batch_size=torch.Size([batch]))
        self.task = TieTask.tie(task) if isinstance(task, str) else task
        self.episodes = Episodes(self.task, batch, RopeSimulator(simulation or SimulationConfig()))
        """The game itself, for what the tensors do not say."""
        self._goals = torch.from_numpy(goal_codes(self.task)).expand(batch, -1, -1, -1)
        self._code = torch.from_numpy(action_code(self.task.action)).expand(batch, -1)
        self._rng = np.random.default_rng(seed)
        flag = Binary(1, shape=(batch, 1), dtype=torch.bool)
        self.observation_spec = Composite(
            points=Unbounded(shape=self.episodes.points.shape, dtype=torch.float32),
            goals=Bounded(-1, 127, shape=self._goals.shape, dtype=torch.int8),
            action_code=Bounded(-1, 127, shape=(batch, ACTION_SIZE), dtype=torch.int8),
            success=flag.clone(),
            shape=(batch,),
        )
        self.action_spec = Bounded(-1.0, 1.0, shape=(batch, 6), dtype=torch.float32)
        self.reward_spec = Bounded(0.0, 1.0, shape=(batch, 1), dtype=torch.float32)
        self.done_spec = Composite(
            done=flag.clone(), terminated=flag.clone(), truncated=flag.clone(), shape=(batch,)
        )

    def _reset(self, tensordict: TensorDictBase | None = None, **kwargs: object) -> TensorDictBase:
        rows = torch.ones(len(self.episodes), dtype=torch.bool)
        if tensordict is not None and "_reset" in tensordict.keys():
            rows = tensordict["_reset"].reshape(-1)
        for row in torch.nonzero(rows)[:, 0].tolist():
            self.episodes.reset(row, self._rng)
        none = np.zeros(len(self.episodes), bool)
        return self._tensors(success=none, done=none, terminated=none, truncated=none)

    def _step(self, tensordict: TensorDictBase) -> TensorDictBase:
        actions = tensordict["action"].detach().cpu().numpy()
        outcome = self.episodes.step(to_splines(actions))
        out = self._tensors(
            success=outcome.success,
            done=outcome.terminated | outcome.truncated,
            terminated=outcome.terminated,
            truncated=outcome.truncated,
        )
        out["reward"] = out["success"].float()
        return out

    def _set_seed(self, seed: int | None) -> None:
        self._rng = np.random.default_rng(seed)

    def _tensors(self, **flags: np.ndarray) -> TensorDict:
        return TensorDict(
            {
                "points": torch.from_numpy(self.episodes.points.astype(np.float32)),
                "goals": self._goals.clone(),
                "action_code": self._code.clone(),
                **{name: torch.from_numpy(flag)[:, None] for name, flag in flags.items()},
            },
            batch_size=self.batch_size,
        )
