"""Replay buffers: of trials grouped by start shape, and of transitions that may lead on."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import torch
from tensordict import TensorDict
from torch import Tensor
from torch.nn.functional import pad
from torchrl.data import LazyTensorStorage, TensorDictReplayBuffer


class TrialBuffer:
    """Encoded ropes, each with the trials made on it: a TorchRL replay buffer of ropes.

    An item is a rope with `slots` places for trials. Sampling takes ropes, then trials of each, so
    that the networks' trunks run once a rope. Symmetric copies need no room here: encoding makes
    them equal.
    """

    def __init__(self, capacity: int, slots: int, generator: torch.Generator) -> None:
        self.slots = slots
        self._generator = generator
        self._replay = TensorDictReplayBuffer(
            storage=LazyTensorStorage(capacity), generator=generator
        )

    def __len__(self) -> int:
        """Number of ropes."""
        return len(self._replay)

    @property
    def trials(self) -> int:
        """Number of trials."""
        return int(self._replay[:]["count"].sum()) if len(self) else 0

    def extend(
        self,
        states: TensorDict,
        splines: Sequence[Tensor],
        rewards: Sequence[Tensor],
        also: TensorDict | None = None,
    ) -> None:
        """Add S ropes with splines (K_s, 6) in network space and rewards (K_s,) each.

        `also` [S] holds what else is to be kept with each rope; every call gives the same keys.

        Raises:
            ValueError: a rope has no trials, or more than there are slots.
        """
        items = []
        for spline, reward in zip(splines, rewards, strict=True):
            count = len(spline)
            if not 0 < count <= self.slots:
                raise ValueError(f"a rope of this buffer has 1 to {self.slots} trials, not {count}")
            padding = self.slots - count
            items.append(
                TensorDict(
                    {
                        "spline": pad(spline.float(), (0, 0, 0, padding)),
                        "reward": pad(reward.float(), (0, padding)),
                        "count": torch.tensor(count),
                    }
                )
            )
        stacked = TensorDict.stack(items)
        stacked["states"] = states
        if also is not None:
            stacked.update(also)
        self._replay.extend(stacked)

    def state_dict(self) -> dict[str, Any]:
        """The contents, and where the next ones go; the generator is its owner's to save."""
        return {"count": len(self), "items": self._replay[:].to_dict() if len(self) else {}}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Take over the contents of another buffer."""
        self._replay.empty()
        if state["count"]:
            self._replay.extend(TensorDict(state["items"], [state["count"]]))

    def sample(self, ropes: int, trials: int) -> TensorDict:
        """Up to `trials` trials of each of up to `ropes` ropes, as `losses` describes them."""
        return self._drawn(self._items(ropes), trials)

    def _items(self, ropes: int) -> TensorDict:
        return self._replay[:] if len(self) <= ropes else self._replay.sample(ropes)

    def _drawn(self, items: TensorDict, trials: int) -> TensorDict:
        count = items["count"]
        keys = torch.rand(len(items), self.slots, generator=self._generator)
        keys[torch.arange(self.slots) >= count[:, None]] = 2.0
        order = keys.argsort(dim=1)[:, :trials]
        valid = keys.gather(1, order) < 2.0
        owner = torch.arange(len(items))[:, None].expand_as(order)[valid]
        reward = items["reward"]
        baseline = reward.sum(1) / count
        return TensorDict(
            {
                "states": items["states"],
                "owner": owner,
                "spline": items["spline"].gather(1, order[..., None].expand(-1, -1, 6))[valid],
                "reward": reward.gather(1, order)[valid],
                "baseline": baseline[owner],
                "weight": torch.ones(len(owner)),
            }
        )


class TransitionBuffer(TrialBuffer):
    """Trials of steps of an episode, each with the encoded rope that the next step begins with.

    An item is one trial. `next_value` of its batches is what `value` gave at the last refresh:
    QT-Opt's targets, worked out once in a while with the critics as they are then, not anew with
    every gradient step.
    """

    def __init__(self, capacity: int, generator: torch.Generator) -> None:
        super().__init__(capacity, 1, generator)

    def add(
        self,
        states: TensorDict,
        splines: Tensor,
        rewards: Tensor,
        following: TensorDict,
        leads_to: Tensor,
    ) -> None:
        """Add N trials; their next values are 0 until they are refreshed.

        Args:
            states: [N] the ropes they were tried on, encoded for their action.
            splines: (N, 6) in network space.
            rewards: (N,) of the step itself.
            following: [N] the ropes they led to, encoded for the next action; of trials that lead
                nowhere it is not looked at.
            leads_to: (N,) int64, the number of the next step; -1 where the episode ended.
        """
        values = torch.zeros(len(splines))
        self.extend(
            states,
            list(splines[:, None]),
            list(rewards[:, None]),
            TensorDict(
                {"following": following, "leads_to": leads_to, "next_value": values},
                batch_size=[len(splines)],
            ),
        )

    def refresh(self, value: Callable[[int, TensorDict], Tensor]) -> dict[int, float]:
        """Work out all next values again; gives the mean of those that lead to each step.

        `value(step, states [M])` gives (M,) values of the ropes that a step begins with.
        """
        if not len(self):
            return {}
        items = self._replay[:].clone()
        leads_to, means = items["leads_to"], {}
        for step in sorted({*leads_to.tolist()} - {-1}):
            rows = torch.nonzero(leads_to == step)[:, 0]
            values = value(step, items["following"][rows])
            items["next_value"][rows] = values
            means[step] = float(values.mean())
        self._replay[torch.arange(len(self))] = items
        return means

    def sample(self, ropes: int, trials: int) -> TensorDict:
        """Up to `ropes` trials, with the key `next_value`."""
        items = self._items(ropes)
        batch = self._drawn(items, trials)
        batch["next_value"] = items["next_value"][batch["owner"]]
        batch["baseline"] = batch["baseline"] + batch["next_value"]  # one trial an item
        return batch


def mixed(parts: Sequence[TensorDict], shares: Sequence[float]) -> TensorDict:
    """Batches from several buffers as one, in which each counts with its share."""
    offset = 0
    owners, weights = [], []
    total = sum(len(part["owner"]) for part in parts)
    for part, share in zip(parts, shares, strict=True):
        owners.append(part["owner"] + offset)
        weights.append(part["weight"] * share / sum(shares) * total / len(part["owner"]))
        offset += len(part["states"])
    keys = ["spline", "reward", "baseline"]
    if any("next_value" in part.keys() for part in parts):
        keys.append("next_value")
        parts = [_with_next_value(part) for part in parts]
    return TensorDict(
        {
            "states": torch.cat([part["states"] for part in parts]),
            "owner": torch.cat(owners),
            "weight": torch.cat(weights),
            **{key: torch.cat([part[key] for part in parts]) for key in keys},
        }
    )


def _with_next_value(part: TensorDict) -> TensorDict:
    """The batch of single-step trials as one of episodes' last steps: nothing comes next."""
    if "next_value" in part.keys():
        return part
    return part.copy().update({"next_value": torch.zeros_like(part["reward"])})
