"""Self-play: the primitives learn all actions together, from ropes that they themselves made.

Joint finetuning (Sec. V-B c), over all paths of all solution DAGs instead of along one. Rope shapes
are remembered by their topological state, beginning with random untangled ones. A trial takes a
shape and an action that its state allows (`curriculum`), and either does the action or arranges
the rope for it: a spline that keeps the state and shall raise the action's value. The shape it
leaves is remembered, and so the states fill up, towards more crossings by actions and back by
undoing them.

What a trial teaches, of the action that was meant and of others, is drawn from it by
`training.lessons`.

Where the critic sees hardly a way, the policy's splines are all alike and all wrong: there a share
of the splines are a demonstrator's guesses, those that a follow-the-leader rope and the critic
think best of many. What the primitives knew before stays in the replay buffers: demonstrations, and
the attempts of independent training.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from tensordict import TensorDict
from torch import Tensor

from knotflow.samplers.demonstrations import Task, Trials, aim_predicted, rearrange_predicted
from knotflow.samplers.primitives.canonical import ALL_PRIMITIVES, ARRANGE, Canonical, canonicalise
from knotflow.samplers.primitives.config import PrimitiveConfig
from knotflow.samplers.primitives.encoding import KINDS, encode_canonical
from knotflow.samplers.primitives.library import PrimitiveLibrary
from knotflow.samplers.primitives.primitive import Primitive
from knotflow.simulation import (
    RopeSimulator,
    StartsConfig,
    end_states,
    random_curve,
    state_or_none,
)
from knotflow.threads import one_thread
from knotflow.topology import Action, TopologicalState
from knotflow.topology.symmetry import representative
from knotflow.training.buffer import TransitionBuffer
from knotflow.training.config import SelfPlayConfig
from knotflow.training.curriculum import Curriculum, need
from knotflow.training.exploration import POLICY, explore
from knotflow.training.fitting import fit_each, settles
from knotflow.training.learner import Learner, demonstration_buffer
from knotflow.training.lessons import Lesson, Lessons, Trial, canonical_or_none, encoded
from knotflow.training.resumable import Resumable
from knotflow.training.shapes import ShapeMemory, transformed
from knotflow.training.transitions import Transitions
from knotflow.training.values import best_values

GUESS = -1
"""A way in which a spline is proposed, beside those of `exploration`."""


@dataclass(frozen=True)
class _Situation:
    """A rope, and what shall be done with it."""

    points: NDArray[np.float64]
    state: TopologicalState
    action: Action
    rope: Canonical
    """The rope as the action sees it."""


@dataclass(frozen=True)
class _Play:
    """The trials of one round."""

    situations: list[_Situation]
    values: NDArray[np.float64]
    arranging: NDArray[np.bool_]
    splines: NDArray[np.float64]
    ways: NDArray[np.intp]

    @property
    def points(self) -> NDArray[np.float64]:
        """The ropes (N, V, 3)."""
        return np.stack([situation.points for situation in self.situations])


@dataclass(frozen=True)
class SelfPlayRound:
    """One round: what it measured."""

    index: int
    """Counted from 0."""
    metrics: dict[int, dict[str, float]]
    """For each primitive: losses; of the policy's own splines the success rate, and of arranging
    ones the mean gain in value. Primitive 1's also say how many states and pairs are known."""


class SelfPlay(Resumable):
    """Training on all actions; iterating over it trains, and gives a `SelfPlayRound` at a time.

    The same arguments give the same weights on one machine. It may be interrupted after any round,
    and goes on from what was saved.
    """

    def __init__(
        self,
        library: PrimitiveLibrary,
        trials: Mapping[Task, Trials],
        earlier: Sequence[Transitions],
        simulator: RopeSimulator,
        config: SelfPlayConfig,
        seed: int,
        starts: StartsConfig | None = None,
    ) -> None:
        """Trains a copy of the library's primitives, and those that it lacks from scratch.

        Args:
            library: after independent training, with actor and critic.
            trials: the demonstrations; may be empty.
            earlier: attempts of independent training; may be empty.
            simulator: executes the trials.
            config: the effort to spend.
            seed: everything random comes from it.
            starts: what an untangled rope looks like.

        Raises:
            ValueError: a primitive of the library lacks actor or critic.
        """
        self.simulator, self.config = simulator, config
        self.library = _completed(library, seed)
        self._starts = starts or StartsConfig()
        self._rng = np.random.default_rng([seed, 0])
        self._curriculum = Curriculum(
            config.most_crossings, config.crossings_shares, config.undo_share
        )
        self._shapes = ShapeMemory(config.shapes)
        self._lessons = Lessons(self._curriculum, config, self._rng)
        self._learners = {
            number: self._learner(number, trials, seed) for number in self.library.primitives
        }
        self._done = 0
        for transitions in earlier:
            self._remember_earlier(transitions)

    def __iter__(self) -> Iterator[SelfPlayRound]:
        config = self.config
        while self._done < config.rounds:
            metrics = self._play()
            for buffer in self._buffers.values():
                buffer.refresh(self._value, config.refreshed)
            for number, losses in self._fit(config.steps, config.new_steps).items():
                metrics[number] |= losses
            self._done += 1
            if settles(self._done, config.settle_every, config.rounds):
                self._fit(config.settle_steps, config.settle_steps, settling=True)
            yield SelfPlayRound(self._done - 1, metrics)

    @property
    def rounds_done(self) -> int:
        """Rounds that are over."""
        return self._done

    @property
    def curriculum(self) -> Curriculum:
        """What was tried, and how often it succeeded."""
        return self._curriculum

    def state_dict(self) -> dict[str, Any]:
        return {
            "learners": {str(n): learner.state_dict() for n, learner in self._learners.items()},
            "shapes": self._shapes.state_dict(),
            "curriculum": self._curriculum.state_dict(),
            "hindsight": self._lessons.state_dict(),
            "rng": self._rng.bit_generator.state,
            "done": self._done,
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        for number, learner in self._learners.items():
            learner.load_state_dict(state["learners"][str(number)])
        self._shapes.load_state_dict(state["shapes"])
        self._curriculum.load_state_dict(state["curriculum"])
        self._lessons.load_state_dict(state["hindsight"])
        self._rng.bit_generator.state = state["rng"]
        self._done = state["done"]

    @property
    def _buffers(self) -> dict[int, TransitionBuffer]:
        return {
            number: learner.rollouts
            for number, learner in self._learners.items()
            if isinstance(learner.rollouts, TransitionBuffer)
        }

    def _learner(self, number: int, trials: Mapping[Task, Trials], seed: int) -> Learner:
        config = self.config.learner
        if number == ARRANGE:  # what counts is what is gained
            config = replace(config, success_share=0.0, failure_weight=1.0, gains_only=True)
        learner = Learner(self.library.primitives[number], config, seed + number)
        own = [
            (some, np.ones(len(some), bool))
            for task, some in trials.items()
            if canonicalise(some.starts[0], task.action).primitive == number
        ]
        if own:
            learner.demonstrations = demonstration_buffer(own, learner.generator)
        learner.rollouts = TransitionBuffer(self.config.capacity, learner.generator)
        return learner

    @one_thread()
    def _play(self) -> dict[int, dict[str, float]]:
        """One batch of trials, and what they teach."""
        play = self._propose(*self._draw())
        rollouts = self.simulator.execute(play.points, play.splines)
        ends = end_states(rollouts)
        trials = [
            Trial(one.points, one.state, one.action, *came)
            for one, *came in zip(
                play.situations, play.splines, rollouts.end_points, ends, strict=True
            )
        ]
        self._remember(trials, play.arranging, play.values)
        return self._measure(play, trials)

    def _draw(self) -> tuple[list[_Situation], NDArray[np.float64]]:
        """What to try, and what it is worth."""
        count = self.config.ropes * self.config.candidates
        rope, rng = self.simulator.config.rope, self._rng
        trivial = TopologicalState.trivial()
        known = self._curriculum.by_crossings(
            [trivial, *(state for state in self._shapes if state != trivial)]
        )
        drawn: list[_Situation] = []
        while len(drawn) < count:
            state, action = self._curriculum.draw(known, rng)
            if state == trivial and (state not in self._shapes or rng.random() < 0.5):
                shape = random_curve(rope, rng, self._starts)
            else:
                shape = self._shapes.draw(state, rng)
            if (canonical := canonical_or_none(shape, action)) is not None:
                drawn.append(_Situation(shape, state, action, canonical))
        values = self._values([situation.rope for situation in drawn])
        # The least weight lets the critic's errors be found out.
        weight = need(values) + 0.05
        rows = rng.choice(count, self.config.ropes, replace=False, p=weight / weight.sum())
        return [drawn[row] for row in rows], values[rows]

    def _propose(self, situations: list[_Situation], values: NDArray[np.float64]) -> _Play:
        """A spline for each rope: by policy, exploration or guess; to act or to arrange."""
        config, rng = self.config, self._rng
        progress = self._done / max(1, config.rounds - 1)
        arranging = (values < config.arrange_below_value) & (
            rng.random(len(situations)) < config.arranging_share
        )
        splines = np.empty((len(situations), 6))
        ways = np.empty(len(situations), np.intp)
        guessed = rng.random(len(situations)) < np.where(
            arranging | (values < config.guess_below_value), config.guess_fraction, 0.0
        )
        numbers = np.where(arranging, ARRANGE, [one.rope.primitive for one in situations])
        for number in sorted(set(numbers.tolist())):
            rows = np.flatnonzero((numbers == number) & ~guessed)
            if not len(rows):
                continue
            encoded = encode_canonical([situations[row].rope for row in rows], number == ARRANGE)
            onward = number == ARRANGE or bool(rng.random() < 0.5)
            network, ways[rows] = explore(
                self.library.primitives[number], encoded, 1, config.exploration, progress, rng,
                onward,
            )  # fmt: skip
            splines[rows] = encoded.frames.to_world(network.numpy())[:, 0]
        for row in np.flatnonzero(guessed):
            splines[row], ways[row] = self._guess(situations[row], bool(arranging[row])), GUESS
        return _Play(situations, values, arranging, splines, ways)

    def _guess(self, situation: _Situation, arranging: bool) -> NDArray[np.float64]:
        """A spline (6,) that nobody learned, the best of many by prediction."""
        points, action = situation.points, situation.action
        if arranging:
            worth = partial(self._worth, action)
            return rearrange_predicted(points, action, 1, self._rng, worth)[0]
        judged = partial(self.library.judged, points, action)
        return aim_predicted(points, action, 1, self._rng, judged)[0]

    def _worth(self, action: Action, shapes: NDArray) -> NDArray[np.float64]:
        """Value (N,) of shapes (N, V, 3) for an action."""
        return self._values([canonicalise(shape, action) for shape in shapes])

    def _remember(self, trials: Sequence[Trial], arranging: NDArray, values: NDArray) -> None:
        """Keep the shapes that trials left, and store what they teach; see `Lessons.of`."""
        lessons: list[Lesson] = []
        for trial, arranges, value in zip(trials, arranging, values, strict=True):
            if not arranges:
                self._curriculum.record(trial.state, trial.action).add(trial.success)
            lessons += self._lessons.of(trial, bool(arranges), value)
            if trial.end is not None and trial.end.num_crossings <= self.config.most_crossings:
                self._keep(trial.after, trial.end)
        self._store(lessons)

    def _keep(self, points: NDArray, state: TopologicalState) -> None:
        """Remember a shape, if its image reads as the representative state does."""
        first, symmetry = representative(state)
        if state_or_none(transformed(points, symmetry)) == first:
            self._shapes.add(points, state, self._rng)

    def _store(self, lessons: Sequence[Lesson]) -> None:
        """Put lessons into their primitives' replay buffers, with the value of what follows."""
        for number, trials in encoded(lessons, self._value):
            self._buffers[number].extend(trials)

    def _remember_earlier(self, transitions: Transitions) -> None:
        """Store attempts of independent training."""
        start, symmetry = representative(transitions.start)
        action = transitions.action
        goal = transitions.start.apply(action)
        lessons = []
        for points, spline, success, after in zip(
            transitions.points, transitions.splines, transitions.success, transitions.ends,
            strict=True,
        ):  # fmt: skip
            end = goal if success else None
            trial = Trial(points, transitions.start, action, spline, after, end)
            lessons.append(self._lessons.at(trial, action, bool(success)))
            self._keep(points, transitions.start)
            if success:
                self._keep(after, goal)
        record = self._curriculum.record(
            start, symmetry.of_action(action, transitions.start.num_segments)
        )
        for success in transitions.success:
            record.add(bool(success))
        self._store(lessons)

    def _values(self, ropes: Sequence[Canonical]) -> NDArray[np.float64]:
        """Value (S,) of each rope for its action."""
        values = np.empty(len(ropes))
        numbers = np.array([rope.primitive for rope in ropes])
        for number in sorted(set(numbers.tolist())):
            rows = np.flatnonzero(numbers == number)
            states = encode_canonical([ropes[row] for row in rows.tolist()]).states
            values[rows] = self._value(number, states).numpy()
        return values

    def _value(self, number: int, states: TensorDict) -> Tensor:
        primitive = self.library.primitives[number]
        return best_values(primitive, states, self._rng)

    def _fit(
        self, steps: int, new_steps: int, settling: bool = False
    ) -> dict[int, dict[str, float]]:
        """Gradient steps of all primitives; without demonstrations, as many as successes allow."""
        buffers, each = self._buffers, self.config.successes_per_step
        most = {
            number: min(new_steps, buffers[number].successes // each)
            if learner.demonstrations is None
            else steps
            for number, learner in self._learners.items()
        }
        ready = {number: learner for number, learner in self._learners.items() if most[number]}
        return fit_each(ready, most, settling)

    def _measure(self, play: _Play, trials: Sequence[Trial]) -> dict[int, dict[str, float]]:
        """What the policy's own splines achieved."""
        metrics: dict[int, dict[str, float]] = {number: {} for number in self.library.primitives}
        by_number: dict[int, list[float]] = {}
        kept: dict[int, Canonical] = {}
        for row, trial in enumerate(trials):
            if play.ways[row] != POLICY:
                continue
            if play.arranging[row]:
                stays = trial.end == trial.state
                by_number.setdefault(ARRANGE, []).append(stays)
                if stays and (rope := canonical_or_none(trial.after, trial.action)) is not None:
                    kept[row] = rope
            else:
                number = play.situations[row].rope.primitive
                by_number.setdefault(number, []).append(trial.success)
        for number, rates in by_number.items():
            metrics[number]["policy_success"] = float(np.mean(rates))
        if kept:
            raised = self._values([*kept.values()])
            metrics[ARRANGE]["gain"] = float((raised - play.values[[*kept]]).mean())
        records = self._curriculum.records.values()
        metrics[1] |= {
            "states": len(self._shapes),
            "pairs_tried": sum(record.trials > 0 for record in records),
            "pairs_solved": sum(record.successes > 0 for record in records),
        }
        return metrics


def _completed(library: PrimitiveLibrary, seed: int) -> PrimitiveLibrary:
    """The library with new primitives for what it lacks."""
    primitives, actions = dict(library.primitives), dict(library.trained_on)
    for number, primitive in primitives.items():
        if primitive.actor is None or primitive.critic is None:
            raise ValueError(
                f"self-play needs primitives with actor and critic, but primitive {number} is "
                f"{primitive.config.variant}"
            )
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        for number in set(ALL_PRIMITIVES) - set(primitives):
            config = PrimitiveConfig()
            if number == ARRANGE:
                config.network.kinds = KINDS
            primitives[number], actions[number] = Primitive(config), ()
    return PrimitiveLibrary(primitives, actions, library.rope)
