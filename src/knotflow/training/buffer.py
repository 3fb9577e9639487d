"""Replay buffers of trials, grouped by start shape."""

from __future__ import annotations

from collections.abc import Sequence
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
        self, states: TensorDict, splines: Sequence[Tensor], rewards: Sequence[Tensor]
    ) -> None:
        """Add S ropes with splines (K_s, 6) in network space and rewards (K_s,) each.

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
        items = self._replay[:] if len(self) <= ropes else self._replay.sample(ropes)
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


def mixed(parts: Sequence[TensorDict], shares: Sequence[float]) -> TensorDict:
    """Batches from several buffers as one, in which each counts with its share."""
    offset = 0
    owners, weights = [], []
    total = sum(len(part["owner"]) for part in parts)
    for part, share in zip(parts, shares, strict=True):
        owners.append(part["owner"] + offset)
        weights.append(part["weight"] * share / sum(shares) * total / len(part["owner"]))
        offset += len(part["states"])
    keys = ("spline", "reward", "baseline")
    return TensorDict(
        {
            "states": torch.cat([part["states"] for part in parts]),
            "owner": torch.cat(owners),
            "weight": torch.cat(weights),
            **{key: torch.cat([part[key] for part in parts]) for key in keys},
        }
    )
