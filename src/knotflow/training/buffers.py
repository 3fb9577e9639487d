"""Replay buffers of trials, the batches drawn from them, and buffers of start shapes."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
import torch
from tensordict import TensorDict
from torch import Tensor
from torch.nn.functional import pad
from torchrl.data import LazyTensorStorage, TensorDictReplayBuffer

from knotflow.samplers.primitives.encoding import HEIGHT_CENTRE, HEIGHT_SCALE, PLANE_SCALE
from knotflow.simulation import SPLINE_HIGH, SPLINE_LOW
from knotflow.topology import TopologicalState
from knotflow.topology.polyline import Floats
from knotflow.topology.symmetry import representative
from knotflow.training.config import AugmentationConfig


class ReplayBuffer:
    """A TorchRL ring buffer whose contents and write cursor can be saved."""

    def __init__(self, capacity: int, generator: torch.Generator) -> None:
        self._generator = generator
        self._replay = TensorDictReplayBuffer(
            storage=LazyTensorStorage(capacity), generator=generator
        )

    def __len__(self) -> int:
        return len(self._replay)

    def state_dict(self) -> dict[str, Any]:
        return {
            "count": len(self),
            "items": self._replay[:].to_dict() if len(self) else {},
            "writer": self._replay.writer.state_dict(),
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        self._replay.empty()
        if state["count"]:
            self._replay.extend(TensorDict(state["items"], [state["count"]]))
        self._replay.writer.load_state_dict(state["writer"])

    def _draw(self, count: int) -> TensorDict:
        """All items, or `count` random ones where there are more."""
        return self._replay[:] if len(self) <= count else self._replay.sample(count)


class TrialBuffer(ReplayBuffer):
    """Encoded ropes, each with up to `slots` trials; the networks' trunks run once a rope."""

    def __init__(self, capacity: int, slots: int, generator: torch.Generator) -> None:
        super().__init__(capacity, generator)
        self.slots = slots

    def extend(
        self, states: TensorDict, splines: Sequence[Tensor], rewards: Sequence[Tensor]
    ) -> None:
        """Add S ropes with splines (K_s, 6) in network space and rewards (K_s,) each.

        Raises:
            ValueError: a rope has no trials, or more than there are slots.
        """
        counts = [len(spline) for spline in splines]
        if bad := [count for count in counts if not 0 < count <= self.slots]:
            raise ValueError(f"a rope of this buffer has 1 to {self.slots} trials, not {bad[0]}")
        items = {
            "states": states,
            "spline": torch.stack(
                [pad(s.float(), (0, 0, 0, self.slots - len(s))) for s in splines]
            ),
            "reward": torch.stack([pad(r.float(), (0, self.slots - len(r))) for r in rewards]),
            "count": torch.tensor(counts),
        }
        self._replay.extend(TensorDict(items, batch_size=[len(counts)]))

    def sample(self, ropes: int, trials: int) -> TensorDict:
        """Up to `trials` trials of each of up to `ropes` ropes, as `learner` describes them."""
        items = self._draw(ropes)
        count, reward = items["count"], items["reward"]
        keys = torch.rand(len(items), self.slots, generator=self._generator)
        keys[torch.arange(self.slots) >= count[:, None]] = 2.0
        order = keys.argsort(dim=1)[:, :trials]
        valid = keys.gather(1, order) < 2.0
        owner = torch.arange(len(items))[:, None].expand_as(order)[valid]
        return TensorDict(
            {
                "states": items["states"],
                "owner": owner,
                "spline": items["spline"].gather(1, order[..., None].expand(-1, -1, 6))[valid],
                "reward": reward.gather(1, order)[valid],
                "baseline": (reward.sum(1) / count)[owner],
                "next_value": torch.full((len(owner),), torch.nan),
                "weight": torch.ones(len(owner)),
            }
        )


class TransitionBuffer(ReplayBuffer):
    """Single trials, each with the rope that a next action would begin with.

    `next_value` is that action's value when stored or last refreshed: QT-Opt's lagged targets.
    """

    @property
    def num_successes(self) -> int:
        return int((self._replay[:]["reward"] > 0.5).sum()) if len(self) else 0

    def extend(self, trials: TensorDict) -> None:
        """Add trials [N], see `learner`; the oldest are overwritten.

        Further keys are "next_states" [N] and "next_primitive" (N,), int64, -1 for none.
        """
        if len(trials):
            self._replay.extend(trials)

    def refresh(self, value: Callable[[int, TensorDict], Tensor], count: int) -> None:
        """Revalue `count` random trials; `value(primitive, states [M])` gives values (M,)."""
        if not len(self):
            return
        rows = torch.randperm(len(self), generator=self._generator)[:count]
        items = self._replay[rows].clone()
        for primitive in sorted({*items["next_primitive"].tolist()} - {-1}):
            own = torch.nonzero(items["next_primitive"] == primitive)[:, 0]
            items["next_value"][own] = value(primitive, items["next_states"][own])
        self._replay[rows] = items

    def sample(self, ropes: int, trials: int) -> TensorDict:
        """Up to `ropes` trials as `learner` describes them."""
        items = self._draw(ropes)
        own = {"weight": torch.ones(len(items)), "owner": torch.arange(len(items))}
        return items.select("states", "spline", "reward", "baseline", "next_value").update(own)


def mix(parts: Sequence[TensorDict], shares: Sequence[float]) -> TensorDict:
    """Batches of several buffers as one, each weighted with its share."""
    offset = 0
    owners, weights = [], []
    total = sum(len(part["owner"]) for part in parts)
    for part, share in zip(parts, shares, strict=True):
        owners.append(part["owner"] + offset)
        weights.append(part["weight"] * share / sum(shares) * total / len(part["owner"]))
        offset += len(part["states"])
    shared = ("states", "spline", "reward", "baseline", "next_value")
    columns = {key: torch.cat([part[key] for part in parts]) for key in shared}
    return TensorDict({**columns, "owner": torch.cat(owners), "weight": torch.cat(weights)})


def augment(
    batch: TensorDict, config: AugmentationConfig, generator: torch.Generator
) -> TensorDict:
    """A batch with each rope and its trials moved rigidly on the table at random."""
    ropes = len(batch["states"])
    angle = config.turn * torch.randn(ropes, generator=generator)
    turn = torch.stack([angle.cos(), -angle.sin(), angle.sin(), angle.cos()], 1).view(-1, 2, 2)
    shift = config.shift * torch.randn(ropes, 1, 2, generator=generator)
    streams = batch["states"]["streams"].clone()
    streams[..., :2] = streams[..., :2] @ turn.mT + shift
    streams[..., 4:6] = streams[..., 4:6] @ turn.mT  # directions
    owner, spline = batch["owner"], batch["spline"].clone()
    for columns in (slice(1, 3), slice(4, 6)):
        turned = (turn[owner] @ spline[:, columns, None])[..., 0]
        spline[:, columns] = turned + shift[owner, 0]
    out = batch.copy()
    out["states"] = batch["states"].copy().update({"streams": streams})
    out["spline"] = spline
    return out


def add_random_splines(batch: TensorDict, share: float, generator: torch.Generator) -> TensorDict:
    """A batch with a spline of reward 0 beside each trial, uniform over the range of all splines
    about the origin of the rope's frame; `share` is the weight of these in the batch."""
    owner = batch["owner"]
    low, high = (torch.from_numpy(bound).float() for bound in (SPLINE_LOW, SPLINE_HIGH))
    spline = low + (high - low) * torch.rand(len(owner), len(low), generator=generator)
    centre, unit = batch["states"]["grasp"][owner].unbind(-1)
    spline[:, 0] = (spline[:, 0] - centre) / unit
    spline[:, [1, 2, 4, 5]] /= PLANE_SCALE
    spline[:, 3] = (spline[:, 3] - HEIGHT_CENTRE) / HEIGHT_SCALE
    weight = torch.cat([(1 - share) * batch["weight"], share * batch["weight"]])
    return TensorDict(
        {
            "states": batch["states"],
            "owner": torch.cat([owner, owner]),
            "spline": torch.cat([batch["spline"], spline]),
            "reward": torch.cat([batch["reward"], torch.zeros(len(owner))]),
            "next_value": torch.cat([batch["next_value"], torch.full((len(owner),), torch.nan)]),
            "weight": 2 * weight,
        }
    )


class StateBuffer:
    """At most `capacity` rope shapes in each topological state; a full state forgets random ones.

    A shape is kept as its image in the representative state under Mirror and Reverse (Sec. V-A),
    with the number of its rope.
    """

    def __init__(self, capacity: int) -> None:
        self.capacity = capacity
        self._shapes: dict[TopologicalState, list[tuple[Floats, int]]] = {}

    def __iter__(self) -> Iterator[TopologicalState]:
        return iter(self._shapes)

    def __len__(self) -> int:
        return len(self._shapes)

    def add(
        self, points: Floats, state: TopologicalState, rng: np.random.Generator, rope: int = 0
    ) -> None:
        """Keep a shape (V, 3), metres, of a rope at rest in a state."""
        state, symmetry = representative(state)
        shapes = self._shapes.setdefault(state, [])
        shape = symmetry.of_points(np.asarray(points, dtype=np.float64)), rope
        if len(shapes) < self.capacity:
            shapes.append(shape)
        else:
            shapes[rng.integers(self.capacity)] = shape

    def draw(self, state: TopologicalState, rng: np.random.Generator) -> tuple[Floats, int]:
        """A shape (V, 3), metres, of a representative state, and its rope."""
        return self._shapes[state][rng.integers(len(self._shapes[state]))]

    def state_dict(self) -> dict[str, Any]:
        return {
            str(state): [(torch.from_numpy(shape), rope) for shape, rope in shapes]
            for state, shapes in self._shapes.items()
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        self._shapes = {
            TopologicalState.parse(name): [(shape.numpy(), rope) for shape, rope in shapes]
            for name, shapes in state.items()
        }


class InitialStateBuffer:
    """Start shapes in one topological state: given ones, and the newest that trials left behind."""

    def __init__(self, given: Floats, recycled_share: float, capacity: int) -> None:
        """Given shapes are (P, V, 3), metres; of recycled ones, `capacity` are kept."""
        self.given = np.asarray(given, dtype=np.float64)
        self.recycled_share, self.capacity = recycled_share, capacity
        self.recycled = self.given[:0]

    def draw(self, count: int, rng: np.random.Generator) -> Floats:
        """Shapes (count, V, 3), metres; given ones without repetition where there are enough."""
        out = self.given[rng.choice(len(self.given), count, replace=len(self.given) < count)]
        if len(self.recycled):
            rows = np.flatnonzero(rng.random(count) < self.recycled_share)
            out[rows] = self.recycled[rng.integers(len(self.recycled), size=len(rows))]
        return out

    def recycle(self, points: Floats) -> None:
        """Take shapes (N, V, 3) that trials ended in."""
        self.recycled = np.concatenate([self.recycled, points])[-self.capacity :]

    def state_dict(self) -> dict[str, Any]:
        return {"recycled": torch.from_numpy(self.recycled)}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        self.recycled = state["recycled"].numpy()
