"""Replay buffers: of trials grouped by start shape, and of single trials that may lead on."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import torch
from tensordict import TensorDict
from torch import Tensor
from torch.nn.functional import pad
from torchrl.data import LazyTensorStorage, TensorDictReplayBuffer


class ReplayBuffer:
    """A TorchRL replay buffer, whose contents can be saved."""

    def __init__(self, capacity: int, generator: torch.Generator) -> None:
        self._generator = generator
        self._replay = TensorDictReplayBuffer(
            storage=LazyTensorStorage(capacity), generator=generator
        )

    def __len__(self) -> int:
        """Number of items."""
        return len(self._replay)

    def state_dict(self) -> dict[str, Any]:
        """The contents, and where the next ones go; the generator is its owner's to save."""
        return {"count": len(self), "items": self._replay[:].to_dict() if len(self) else {}}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Take over the contents of another buffer."""
        self._replay.empty()
        if state["count"]:
            self._replay.extend(TensorDict(state["items"], [state["count"]]))


class TrialBuffer(ReplayBuffer):
    """Encoded ropes, each with the trials made on it: a TorchRL replay buffer of ropes.

    An item is a rope with `slots` places for trials. Sampling takes ropes, then trials of each, so
    that the networks' trunks run once a rope. Symmetric copies need no room here: encoding makes
    them equal.
    """

    def __init__(self, capacity: int, slots: int, generator: torch.Generator) -> None:
        super().__init__(capacity, generator)
        self.slots = slots

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


class TransitionBuffer(ReplayBuffer):
    """Single trials, each with the encoded rope that a next action would begin with.

    `next_value` is what that action's critic said when the trial was stored, or at the last
    refresh: QT-Opt's lagged targets, not worked out anew with every gradient step.
    """

    @property
    def successes(self) -> int:
        """Number of trials that succeeded."""
        return int((self._replay[:]["reward"] > 0.5).sum()) if len(self) else 0

    def extend(self, trials: TensorDict) -> None:
        """Add N trials, the oldest give way.

        Args:
            trials: [N] with "states" and "following" (encoded ropes before and after), "follower"
                (N,) int64 number of the primitive of the next action, -1 where none is valued,
                "spline" (N, 6) in network space, "reward", "baseline", "weight", "pull" and
                "next_value" (N,), the last NaN where there is no follower.
        """
        if len(trials):
            self._replay.extend(trials)

    def refresh(self, value: Callable[[int, TensorDict], Tensor], count: int) -> None:
        """Value what follows `count` random trials anew; `value(primitive, states [M])` is (M,)."""
        if not len(self):
            return
        rows = torch.randperm(len(self), generator=self._generator)[:count]
        items = self._replay[rows].clone()
        for follower in sorted({*items["follower"].tolist()} - {-1}):
            mine = torch.nonzero(items["follower"] == follower)[:, 0]
            items["next_value"][mine] = value(follower, items["following"][mine])
        self._replay[rows] = items

    def sample(self, ropes: int, trials: int) -> TensorDict:
        """Up to `ropes` trials as `losses` describes them, with the key `next_value`."""
        items = self._replay[:] if len(self) <= ropes else self._replay.sample(ropes)
        keys = ("states", "spline", "reward", "baseline", "weight", "pull", "next_value")
        batch = TensorDict({key: items[key] for key in keys})
        batch["owner"] = torch.arange(len(items))
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
        keys += ["next_value", "pull"]
        parts = [_like_transitions(part) for part in parts]
    return TensorDict(
        {
            "states": torch.cat([part["states"] for part in parts]),
            "owner": torch.cat(owners),
            "weight": torch.cat(weights),
            **{key: torch.cat([part[key] for part in parts]) for key in keys},
        }
    )


def _like_transitions(part: TensorDict) -> TensorDict:
    """The batch of trials of which nobody knows what comes next."""
    if "next_value" in part.keys():
        return part
    reward = part["reward"]
    unknown = torch.full_like(reward, torch.nan)
    return part.copy().update({"next_value": unknown, "pull": torch.ones_like(reward)})
