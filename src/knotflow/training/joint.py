"""Joint finetuning: primitives learn to leave the rope as the next one likes it (Sec. V-B c).

Many shapes have the same topology, and some make the next action easier than others. So episodes
follow a topological path from an untangled rope on, every step taken by its own primitive. Only the
last step is rewarded; what an earlier one is worth is the best that the next step's critic expects
of the shape it led to. Critic and actor of the earlier primitive both learn from this value, as in
independent training from the binary success.

The values of all stored transitions are worked out anew once a round, with the critics as they are
then, and stay the same for the gradient steps of this round: QT-Opt's lagged target network.

A step that fails is tried again a few times, as a tree search would. Where the critic sees hardly
a way, the policy's splines are all alike and all wrong: there some tries are a demonstrator's
guesses instead, so that ropes on which nothing succeeds yet are learned from as well.

What the primitives knew before stays in the replay buffer: attempts of independent training, whose
end shapes are known, join the episodes; demonstrations are mixed in as before. Those of a step that
others follow are left out, for they do not tell where they led.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from tensordict import TensorDict

from knotflow.demonstrations import Task, Trials, aim
from knotflow.primitives.canonical import primitive_of
from knotflow.primitives.encoding import encode
from knotflow.primitives.library import PrimitiveLibrary
from knotflow.simulation import Attempts, RopeSimulator, StartsConfig, attempt, random_curve
from knotflow.topology import Action, TopologicalState, parse_action
from knotflow.training.buffer import TransitionBuffer
from knotflow.training.config import JointConfig
from knotflow.training.exploration import POLICY, explore
from knotflow.training.fitting import fit_each
from knotflow.training.learner import Learner, demonstration_buffer
from knotflow.training.resumable import Resumable
from knotflow.training.transitions import Transitions
from knotflow.training.values import best_values

GUESS = -1
"""A way in which a spline is proposed, beside those of `exploration`."""


@dataclass(frozen=True)
class JointRound:
    """One round: what it measured, and all that it simulated."""

    index: int
    """Counted from 0."""
    metrics: dict[int, dict[str, float]]
    """For each primitive that learns: losses; for each of its actions the success rate of the
    policy's own splines, and the mean value of the shapes that it starts from in the replay
    buffer. The last step's also has the share of episodes that tied the rope."""
    attempts: tuple[Attempts, ...]
    """One item a step and try, as far as any episode came."""


@dataclass(frozen=True)
class _Step:
    action: Action
    start: TopologicalState
    primitive: int


class JointFinetuning(Resumable):
    """Training on episodes; iterating over it trains, and gives a `JointRound` at a time.

    The same arguments give the same weights on one machine. It may be interrupted after any round,
    and goes on from what was saved.
    """

    def __init__(
        self,
        library: PrimitiveLibrary,
        path: Sequence[Action],
        trials: Mapping[Task, Trials],
        earlier: Sequence[Transitions],
        simulator: RopeSimulator,
        config: JointConfig,
        seed: int,
        starts: StartsConfig | None = None,
    ) -> None:
        """Takes over `library` and trains those of its primitives that take a step.

        Args:
            library: after independent training, with actor and critic.
            path: actions from the trivial state to the goal, one a step.
            trials: the demonstrations; may be empty.
            earlier: attempts of independent training; may be empty.
            simulator: executes the episodes.
            config: the effort to spend.
            seed: everything random comes from it.
            starts: what an untangled rope looks like.

        Raises:
            ValueError: the path is empty, or the library lacks a primitive, actor or critic.
            IllegalActionError: a step's state does not allow its action.
        """
        self.library, self.simulator, self.config = library, simulator, config
        self._steps = _steps(path)
        self._starts = starts or StartsConfig()
        self._rng = np.random.default_rng([seed, 0])
        self._learners: dict[int, Learner] = {}
        self._buffers: dict[int, TransitionBuffer] = {}
        for number in sorted({step.primitive for step in self._steps}):
            self._prepare(number, trials, earlier, seed)
        for transitions in earlier:
            self._remember(transitions)
        self._done = 0

    def __iter__(self) -> Iterator[JointRound]:
        config = self.config
        while self._done < config.rounds:
            attempts, metrics = self._episodes()
            self._refresh(metrics)
            for number, losses in self._fit(config.steps).items():
                metrics[number] |= losses
            self._done += 1
            if self._done == config.rounds:
                self._refresh({number: {} for number in self._learners})
                self._fit(config.decay_steps, decaying=True)
            yield JointRound(self._done - 1, metrics, attempts)

    @property
    def rounds_done(self) -> int:
        """Rounds that are over."""
        return self._done

    def state_dict(self) -> dict[str, Any]:
        return {
            "learners": {
                str(number): learner.state_dict() for number, learner in self._learners.items()
            },
            "rng": self._rng.bit_generator.state,
            "done": self._done,
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        for number, learner in self._learners.items():
            learner.load_state_dict(state["learners"][str(number)])
        self._rng.bit_generator.state = state["rng"]
        self._done = state["done"]

    def _prepare(
        self, number: int, trials: Mapping[Task, Trials], earlier: Sequence[Transitions], seed: int
    ) -> None:
        """The learner of a primitive, with its demonstrations and room for its transitions."""
        if number not in self.library.primitives:
            actions = [str(step.action) for step in self._steps if step.primitive == number]
            raise ValueError(
                f"the library has no primitive {number}, which takes the step {actions[0]}"
            )
        primitive = self.library.primitives[number]
        if primitive.actor is None or primitive.critic is None:
            raise ValueError(
                "joint finetuning needs primitives with actor and critic, but primitive "
                f"{number} is {primitive.config.variant}"
            )
        learner = Learner(primitive, self.config.learner, seed + number)
        own = [
            (some, np.ones(len(some), bool))
            for task, some in trials.items()
            if _number(task.action, task.start_state) == number
            and self._next(task.action, task.start_state) is None
        ]
        if own:
            learner.demonstrations = demonstration_buffer(own, learner.generator)
        room = sum(len(some) for some in earlier if _number(some.action, some.start) == number)
        taken = sum(step.primitive == number for step in self._steps)
        room += taken * self.config.rounds * self.config.episodes * self.config.tries
        self._buffers[number] = TransitionBuffer(room, learner.generator)
        learner.rollouts = self._buffers[number]
        self._learners[number] = learner

    def _next(self, action: Action, start: TopologicalState) -> int | None:
        """The number of the step that follows an action, None where the episode ends there."""
        for number, step in enumerate(self._steps[:-1]):
            if (action, start) == (step.action, step.start):
                return number + 1
        return None

    def _episodes(self) -> tuple[tuple[Attempts, ...], dict[int, dict[str, float]]]:
        """Play episodes, all of them step by step together, and remember their transitions."""
        config, rng = self.config, self._rng
        rope = self.simulator.config.rope
        progress = self._done / max(1, config.rounds - 1)
        metrics: dict[int, dict[str, float]] = {number: {} for number in self._learners}
        points = np.stack([random_curve(rope, rng, self._starts) for _ in range(config.episodes)])
        played: list[Attempts] = []
        for step in self._steps:
            reached = []
            for number in range(config.tries):
                if not len(points):
                    break
                tried, ways = self._try(step, points, progress)
                if number == 0 and (ways == POLICY).any():
                    rate = float(tried.success[ways == POLICY].mean())
                    metrics[step.primitive][f"policy_success/{step.action}"] = rate
                played.append(tried)
                reached.append(tried.rollouts.end_points[tried.success])
                points = points[~tried.success]
            points = np.concatenate(reached) if reached else points
        tied = len(points) / config.episodes
        metrics[self._steps[-1].primitive]["episode_success"] = tied
        return tuple(played), metrics

    def _try(
        self, step: _Step, points: NDArray, progress: float
    ) -> tuple[Attempts, NDArray[np.intp]]:
        """One spline on each rope, remembered, and the way (S,) in which it was proposed."""
        config, rng, action = self.config, self._rng, step.action
        primitive = self.library.primitives[step.primitive]
        encoded = encode(points, [action] * len(points))
        network, ways = explore(primitive, encoded, 1, config.exploration, progress, rng)
        splines = encoded.frames.to_world(network.numpy())[:, 0]
        value = best_values(primitive, encoded.states, config.population, rng).numpy()
        guessed = (value < config.guess_below_value) & (
            rng.random(len(points)) < config.guess_fraction
        )
        for row in np.flatnonzero(guessed):
            splines[row] = aim(points[row], action, 1, rng)[0]
        ways[guessed] = GUESS
        tried = attempt(self.simulator, points, splines, action, step.start)
        self._remember(Transitions.of(tried))
        return tried, ways

    def _remember(self, transitions: Transitions) -> None:
        """Put transitions into their primitive's replay buffer, if it learns here."""
        action, success = transitions.action, transitions.success
        number = _number(action, transitions.start)
        if number not in self._buffers or not len(transitions):
            return
        encoded = encode(transitions.points, [action] * len(transitions))
        tried = encoded.frames.to_network(transitions.splines[:, None])[:, 0]
        following = encoded.states.apply(torch.zeros_like)
        leads_to = torch.full((len(transitions),), -1)
        reward = success.astype(np.float32)
        if (step := self._next(action, transitions.start)) is not None:
            # Only the last step is rewarded: what comes next tells what this one is worth.
            reward = np.zeros_like(reward)
            rows = np.flatnonzero(success)
            leads_to[torch.from_numpy(rows)] = step
            if len(rows):
                onward = [self._steps[step].action] * len(rows)
                following[torch.from_numpy(rows)] = encode(transitions.ends[rows], onward).states
        self._buffers[number].add(
            encoded.states,
            torch.from_numpy(tried).float(),
            torch.from_numpy(reward),
            following,
            leads_to,
        )

    def _fit(self, steps: int, decaying: bool = False) -> dict[int, dict[str, float]]:
        """Gradient steps of all primitives that any episode gave something to learn from."""
        ready = {
            number: learner
            for number, learner in self._learners.items()
            if learner.demonstrations is not None or len(self._buffers[number])
        }
        return fit_each(ready, steps, decaying)

    def _refresh(self, metrics: Mapping[int, dict[str, float]]) -> None:
        """Value the shapes that stored steps led to, with the critics as they are now."""

        def value(number: int, states: TensorDict) -> torch.Tensor:
            primitive = self.library.primitives[self._steps[number].primitive]
            found = best_values(primitive, states, self.config.population, self._rng)
            return self.config.gamma * found

        for buffer in self._buffers.values():
            for number, mean in buffer.refresh(value).items():
                step = self._steps[number]
                metrics[step.primitive][f"start_value/{step.action}"] = mean


def parse_path(text: str) -> tuple[Action, ...]:
    """The actions of a topological path such as "R1(0,1,1) C(0,1,1) C(2,0,1)".

    Raises:
        ValueError: a word that is no action.
    """
    return tuple(parse_action(word) for word in text.split())


def _steps(path: Sequence[Action]) -> list[_Step]:
    """Each action with the state it starts from and the primitive that takes it."""
    if not path:
        raise ValueError("joint finetuning needs a path of at least one action")
    steps, state = [], TopologicalState.trivial()
    for action in path:
        steps.append(_Step(action, state, _number(action, state)))
        state = state.apply(action)
    return steps


def _number(action: Action, start: TopologicalState) -> int:
    return primitive_of(action, start.num_segments)
