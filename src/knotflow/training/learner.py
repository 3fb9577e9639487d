"""Adapted QT-Opt (Sec. V-B b, Fig. 5): behaviour policy, losses and gradient steps.

The losses read a batch of S ropes and N trials; many splines may share a rope:

* states, TensorDict [S]: encoded ropes, see `primitives.encoding`;
* owner, (N,) int64: the rope of each trial;
* spline, (N, 6): in network space;
* reward, (N,): 1 where the trial succeeded, else 0;
* baseline, (N,): mean return of the trials known from the same rope;
* weight, (N,): of the trial in the batch, of mean 1;
* next_value, (N,): max Q of a next action at the end shape, NaN where none was valued.

Beyond the paper, critics are reset now and then (Nikishin et al., "The Primacy Bias in Deep
Reinforcement Learning", ICML 2022).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from threading import Event, Lock
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from tensordict import TensorDict
from torch import Tensor
from torch.nn.functional import binary_cross_entropy_with_logits

from knotflow.samplers.primitives.distribution import SPLINE, SplineDistribution
from knotflow.samplers.primitives.encoding import Encoded, encode
from knotflow.samplers.primitives.primitive import Actor, Critic, Primitive, States, standard_normal
from knotflow.simulation import RopeConfig, Trials
from knotflow.threads import cpus, one_thread
from knotflow.training.buffers import (
    TransitionBuffer,
    TrialBuffer,
    add_random_splines,
    augment,
    mix,
)
from knotflow.training.config import ExplorationConfig, LearnerConfig

REACH = 3.0
"""How far below an actor's typical log density failures still count, nats."""
_GLOBAL_GENERATOR = Lock()
"""Held while new weights are drawn from PyTorch's one global generator."""

POLICY, SEARCH, SPREAD = 0, 1, 2
"""Ways in which a spline is proposed."""


@torch.no_grad()
def explore(
    primitive: Primitive,
    encoded: Encoded,
    count: int,
    config: ExplorationConfig,
    progress: float,
    rng: np.random.Generator,
    use_next_value: bool = False,
) -> tuple[Tensor, NDArray[np.int64]]:
    """Splines (S, count, 6) in network space to try on S ropes, and the way (S,) of each rope's.

    They are the policy's, the critic's best from a widened Gaussian of the actor, or drawn from it.
    `progress` is 0 in the first round and 1 in the last.
    """
    left = 1 + progress * (config.last - 1)
    searched = left * config.search if primitive.critic is not None else 0.0
    spread = left * config.spread
    ways = rng.choice(3, len(encoded.frames), p=[max(0.0, 1 - searched - spread), searched, spread])
    splines = torch.empty(len(ways), count, SPLINE)

    def search(
        some: Encoded, first: SplineDistribution | None = None, iterations: int | None = None
    ) -> Tensor:
        population = config.population
        return primitive.search(some, count, rng, use_next_value, first, iterations, population)

    states = encoded.states
    for way in (POLICY, SEARCH, SPREAD):
        if not len(rows := np.flatnonzero(ways == way)):
            continue
        some = Encoded(states[torch.from_numpy(rows)], encoded.frames[rows])
        if way == POLICY:
            found = search(some)
        elif way == SEARCH:
            found = search(some, _widened(primitive, some.inputs, config), config.iterations)
        else:
            noise = standard_normal(rng, (len(rows), count, SPLINE))
            if primitive.actor is None:
                # A critic's wide Gaussian hardly ever succeeds: stay near its choice.
                found = search(some) + config.floor * noise
            else:
                found = _widened(primitive, some.inputs, config).draw(noise)
        splines[torch.from_numpy(rows)] = found
    return splines, ways


def _widened(primitive: Primitive, states: States, config: ExplorationConfig) -> SplineDistribution:
    """The actor's distribution, widened; that of a critic-only policy is wide enough."""
    own = primitive.distribution(states)
    return own if primitive.actor is None else own.widened(config.widening, config.floor)


def returns(batch: TensorDict, success_share: float) -> Tensor:
    """Returns (N,) in 0..1: the reward, in part times the next value where that is known."""
    reward: Tensor = batch["reward"]
    next_value = batch["next_value"]
    worth = torch.where(next_value.isnan(), 1.0, success_share + (1 - success_share) * next_value)
    return reward * worth


def critic_loss(critic: Critic, batch: TensorDict) -> dict[str, Tensor]:
    """Cross-entropy between the critic and the outcomes of trials, and `critic_accuracy`.

    QT-Opt's r + gamma max Q (Sec. V-B c) in two factors: success, and the next value of success.
    """
    reward, weight = batch["reward"], batch["weight"]
    logits = critic(batch["states"], batch["spline"], batch["owner"])
    success, value = logits.unbind(-1)
    known = (reward > 0.5) & ~batch["next_value"].isnan()
    next_value, known_weight = (
        torch.where(known, one, 0.0) for one in (batch["next_value"], weight)
    )
    loss = binary_cross_entropy_with_logits(success, reward, weight=weight)
    loss = loss + binary_cross_entropy_with_logits(value, next_value, weight=known_weight)
    accuracy = ((success.detach() > 0) == (reward > 0.5)).float().mean()
    return {"loss_critic": loss, "critic_accuracy": accuracy}


def actor_loss(actor: Actor, batch: TensorDict, config: LearnerConfig) -> dict[str, Tensor]:
    """Off-policy REINFORCE, -(R - b) log pi(a | s), and `actor_spread`, the normalised deviation.

    b is `failure_weight` times the baseline. As -log pi has no upper bound, a failure counts only
    where its log density is within `REACH` of the typical one.
    """
    policy: SplineDistribution = actor(batch["states"])
    owner = batch["owner"]
    log_prob = policy.log_prob(batch["spline"], owner)
    advantage = returns(batch, config.success_share) - config.failure_weight * batch["baseline"]
    if config.gains_only:
        advantage = advantage.clamp(min=0)
    typical = -policy.entropy.detach()[owner]  # the mean of log pi under pi
    counts = (advantage > 0) | (log_prob.detach() > typical - REACH)
    pull = batch["weight"] * advantage * counts
    # Per unit of pull, so that the step does not depend on how often the batch succeeds.
    loss = -(pull * log_prob).sum() / pull.abs().sum().clamp(min=1.0)
    return {"loss_actor": loss, "actor_spread": policy.spread.detach().mean()}


class Learner:
    """A primitive, its losses and optimiser, and the two replay buffers it learns from."""

    def __init__(self, primitive: Primitive, config: LearnerConfig, seed: int) -> None:
        self.primitive, self.config = primitive, config
        self.generator = torch.Generator().manual_seed(seed)
        self.demonstrations: TrialBuffer | None = None
        self.rollouts: TrialBuffer | TransitionBuffer | None = None
        networks = ((primitive.actor, 1.0), (primitive.critic, config.critic_reset_boost))
        groups = [
            {"params": list(network.parameters()), "boost": boost}
            for network, boost in networks
            if network is not None
        ]
        self.optimizer = torch.optim.AdamW(
            groups, config.learning_rate, weight_decay=config.weight_decay
        )

    def reset_critic(self) -> None:
        """Give the critic, if there is one, new weights."""
        critic = self.primitive.critic
        if critic is None:
            return
        seed = int(torch.randint(2**31, (), generator=self.generator))
        with _GLOBAL_GENERATOR, torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            fresh = Critic(self.primitive.config.network)
        critic.load_state_dict(fresh.state_dict())
        for parameter in critic.parameters():
            self.optimizer.state.pop(parameter, None)

    def update(self, rate: float = 1.0, after_reset: bool = False) -> dict[str, float]:
        """One gradient step at a fraction of the learning rate; what `measure` gives.

        Raises:
            ValueError: there is nothing to learn from.
        """
        config, parts, shares = self.config, [], []
        if self.demonstrations:
            ropes, trials = config.demonstration_ropes, config.demonstration_trials
            parts.append(self.demonstrations.sample(ropes, trials))
            shares.append(config.demonstration_share)
        if self.rollouts:
            parts.append(self.rollouts.sample(config.rollout_ropes, config.rollout_trials))
            shares.append(1 - config.demonstration_share)
        if not parts:
            raise ValueError("a learner needs demonstrations or rollouts before it can update")
        batch = augment(mix(parts, shares), config.augmentation, self.generator)
        for_critic = batch
        if config.random_share and self.primitive.critic is not None:
            for_critic = add_random_splines(batch, config.random_share, self.generator)
        measured = self.measure(batch, for_critic)
        self.optimizer.zero_grad(set_to_none=True)
        losses = [value for key, value in measured.items() if key.startswith("loss_")]
        torch.autograd.backward(torch.stack(losses).sum())
        torch.nn.utils.clip_grad_norm_(self.primitive.parameters(), config.gradient_norm)
        for group in self.optimizer.param_groups:
            boost = group["boost"] if after_reset else 1.0
            group["lr"] = rate * boost * config.learning_rate
        self.optimizer.step()
        return {key: float(value.detach()) for key, value in measured.items()}

    def measure(self, batch: TensorDict, for_critic: TensorDict) -> dict[str, Tensor]:
        """Losses and other metrics of a batch, and of what the critic learns from."""
        actor, critic = self.primitive.actor, self.primitive.critic
        out = {} if critic is None else critic_loss(critic, for_critic)
        return out if actor is None else out | actor_loss(actor, batch, self.config)

    def fit(self, steps: int, reset: bool = False, stop: Event | None = None) -> dict[str, float]:
        """Gradient steps, until `stop` is set; the means of what `update` gives.

        With `reset` the critic is reset, and the learning rate falls linearly to 0.
        """
        means: dict[str, float] = {}
        if reset and steps:
            self.reset_critic()
        for step in range(steps):
            if stop is not None and stop.is_set():
                break
            for key, value in self.update(1 - step / steps if reset else 1.0, reset).items():
                means[key] = means.get(key, 0.0) + value / steps
        return means

    @property
    def parts(self) -> dict[str, Any]:
        """As of a `Trainer`: all that `update` depends on but the demonstrations."""
        parts = {"primitive": self.primitive, "optimizer": self.optimizer}
        rollouts = {} if self.rollouts is None else {"rollouts": self.rollouts}
        return parts | {"generator": self.generator} | rollouts


def fit_each(
    learners: Mapping[int, Learner], steps: Mapping[int, int], reset: bool = False
) -> dict[int, dict[str, float]]:
    """`Learner.fit` of several learners in threads, with the same result."""
    stop = Event()
    with one_thread(), ThreadPoolExecutor(cpus()) as pool:
        running = {
            number: pool.submit(learner.fit, steps[number], reset, stop)
            for number, learner in learners.items()
        }
        try:
            return {number: future.result() for number, future in running.items()}
        except BaseException:
            stop.set()
            raise


def is_reset_round(done: int, every: int, rounds: int) -> bool:
    """Whether critics are reset after round `done`, from 1: regularly and after the last, or never,
    if `every` is 0."""
    return every > 0 and (done == rounds or (done % every == 0 and rounds - done >= every))


def demonstration_buffer(
    trials: Sequence[Trials], generator: torch.Generator, rope: RopeConfig | None = None
) -> TrialBuffer:
    """A buffer of trials, each on one shape of a rope, by default the nominal one.

    Raises:
        ValueError: there are no trials.
    """
    trials = [some for some in trials if len(some)]
    if not trials:
        raise ValueError("there are no demonstrated trials to learn from")
    shapes, actions = zip(*((some.points[0], some.action) for some in trials), strict=True)
    encoded = encode(shapes, actions, rope=rope)
    splines = [
        torch.from_numpy(encoded.frames[row : row + 1].to_network(some.splines[None])[0])
        for row, some in enumerate(trials)
    ]
    buffer = TrialBuffer(len(trials), max(map(len, trials)), generator)
    buffer.extend(encoded.states, splines, [torch.from_numpy(some.success) for some in trials])
    return buffer
