"""Training samples from trials of self-play: of the action, and of arranging the rope for it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from tensordict import TensorDict
from torch import Tensor

from knotflow.samplers.primitives.canonical import ARRANGE, Canonical, canonicalise
from knotflow.samplers.primitives.encoding import encode_canonical
from knotflow.topology import Action, DegenerateCurveError, IllegalActionError, TopologicalState
from knotflow.training.curriculum import Curriculum

FARTHEST_GRASP = 3.5
"""Largest distance, network units, from where an action grasps, of trials that teach anything."""

Value = Callable[[int, TensorDict], Tensor]
"""Given a primitive and encoded ropes [N], their values (N,)."""


@dataclass(frozen=True)
class Query:
    """A rope (V, 3), its state, and an action to do or to arrange for."""

    points: NDArray[np.float64]
    state: TopologicalState
    action: Action
    rope: Canonical
    """The rope as the action's primitive sees it."""


@dataclass(frozen=True)
class Transition:
    """A spline (6,) tried for a query, and where it led."""

    query: Query
    spline: NDArray[np.float64]
    end_points: NDArray[np.float64]
    end: TopologicalState | None
    arranging: bool = False
    """Whether it was to arrange the rope for the action instead of doing it."""
    value: float = 0.0
    """Of the action before."""

    @property
    def success(self) -> bool:
        """Whether it ended in the action's state."""
        return self.end == self.query.state.apply(self.query.action)

    @property
    def state_kept(self) -> bool:
        return self.end == self.query.state


@dataclass(frozen=True)
class Sample:
    """A transition as a training sample of its action's primitive, or of the arranging one."""

    transition: Transition
    arranging: bool
    reward: float
    next_action: Action | None
    """Valued at the end shape; None where nothing follows."""


def samples(
    transition: Transition,
    curriculum: Curriculum,
    arranging_share: float,
    rng: np.random.Generator,
) -> Iterator[Sample]:
    """A transition's samples: of its action, whether it succeeded and what may follow; of
    arranging (also from a share of the failed actions), whether the state was kept."""
    success, arranging = transition.success, transition.arranging
    if not arranging:
        yield acting_sample(transition, curriculum, rng)
    if not success and (arranging or rng.random() < arranging_share):
        kept = transition.state_kept
        yield Sample(transition, True, float(kept), transition.query.action if kept else None)


def acting_sample(
    transition: Transition, curriculum: Curriculum, rng: np.random.Generator
) -> Sample:
    """What a transition teaches of its action."""
    if transition.success and transition.end is not None:
        return Sample(transition, False, 1.0, curriculum.next_action(transition.end, rng))
    return Sample(transition, False, 0.0, None)


def encode_samples(some: Sequence[Sample], value: Value) -> Iterator[tuple[int, TensorDict]]:
    """Primitives and their samples, as `TransitionBuffer.extend` takes them."""
    by_number: dict[int, list[Sample]] = {}
    for sample in some:
        number = ARRANGE if sample.arranging else sample.transition.query.rope.primitive
        by_number.setdefault(number, []).append(sample)
    for number, own in sorted(by_number.items()):
        transitions = [sample.transition for sample in own]
        ropes = encode_canonical([one.query.rope for one in transitions], number == ARRANGE)
        world = np.stack([one.spline for one in transitions])
        splines = ropes.frames.to_network(world[:, None])[:, 0]
        rows = np.flatnonzero(np.abs(splines[:, 0]) <= FARTHEST_GRASP)
        if not len(rows):
            continue
        own = [own[row] for row in rows]
        columns = {
            "states": ropes.states[torch.from_numpy(rows)],
            "spline": torch.from_numpy(splines[rows]).float(),
            "reward": torch.tensor([sample.reward for sample in own]),
            "baseline": torch.tensor(
                [float(one.transition.value) if one.arranging else 0.0 for one in own]
            ),
        }
        columns |= _next_steps(own, columns["states"], value)
        yield number, TensorDict(columns, batch_size=[len(own)])


def _next_steps(
    some: Sequence[Sample], states: TensorDict, value: Value
) -> dict[str, Tensor | TensorDict]:
    """The samples' end shapes as the next actions' primitives see them, and their values."""
    next_states = states.select("streams", "grasp").apply(torch.zeros_like)
    next_primitive = torch.full((len(some),), -1)
    next_value = torch.full((len(some),), torch.nan)
    by_number: dict[int, list[tuple[int, Canonical]]] = {}
    for row, sample in enumerate(some):
        if sample.next_action is None:
            continue
        rope = canonical_or_none(sample.transition.end_points, sample.next_action)
        if rope is not None:
            by_number.setdefault(rope.primitive, []).append((row, rope))
    for number, own in by_number.items():
        rows = torch.tensor([row for row, _ in own])
        encoded = encode_canonical([rope for _, rope in own]).states.select("streams", "grasp")
        next_states[rows], next_primitive[rows] = encoded, number
        next_value[rows] = value(number, encoded)
    return {"next_states": next_states, "next_primitive": next_primitive, "next_value": next_value}


def canonical_or_none(points: NDArray[np.float64], action: Action) -> Canonical | None:
    """`canonicalise`, or None for the rare rope whose image reads otherwise."""
    try:
        return canonicalise(points, action)
    except (DegenerateCurveError, IllegalActionError):
        return None
