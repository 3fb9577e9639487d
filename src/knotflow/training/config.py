"""Configuration of the trainings; loads no PyTorch."""

from __future__ import annotations

from dataclasses import dataclass, field

from knotflow.simulation import ProportionsConfig, WorldsConfig
from knotflow.topology import TopologicalState, knot


def _check_tied(name: str) -> None:
    """Raises ValueError where there is no knot of this name, or nothing to tie in it."""
    if TopologicalState.trivial() in knot(name):
        raise ValueError(f"there is nothing to tie in the {name}")


@dataclass
class AugmentationConfig:
    """Standard deviations of the random motions."""

    turn: float = 0.2
    """Of the rotation, radians."""
    shift: float = 0.1
    """Of each coordinate of the displacement, network units."""


@dataclass
class LearnerConfig:
    """The optimiser and the batches."""

    learning_rate: float = 2e-3
    """Of AdamW."""
    weight_decay: float = 1e-3
    """Of AdamW."""
    critic_reset_boost: float = 1.0
    """Factor on the learning rate of a critic that was reset."""
    gradient_norm: float = 5.0
    """Gradients are clipped to this norm."""
    failure_weight: float = 0.0
    """Factor on the baseline in the actor's advantage; see `ActorLoss`."""
    gains_only: bool = False
    """Whether trials below the baseline are left out of the actor's loss."""
    success_share: float = 0.5
    """Share of the actor's return that is for success; the rest is for the next action's value."""
    demonstration_ropes: int = 24
    """Demonstrated ropes in a batch."""
    demonstration_trials: int = 24
    """Trials of each demonstrated rope in a batch."""
    rollout_ropes: int = 128
    """Ropes of the reinforcement stage in a batch."""
    rollout_trials: int = 2
    """Trials of each of these ropes in a batch."""
    demonstration_share: float = 0.25
    """Weight of the demonstrations in a batch that has both."""
    random_share: float = 0.0
    """Weight, in what the critic learns from, of uniformly random splines taken to fail, one
    beside each trial; 0.5 in the authors' code."""
    augmentation: AugmentationConfig = field(default_factory=AugmentationConfig)
    """Deformed copies of the trials in a batch."""


@dataclass
class ExplorationConfig:
    """Shares of the three ways to propose a spline, and the width of the widened Gaussian."""

    search: float = 0.4
    """Share of ropes whose splines a search from the widened Gaussian finds; 0 without critic."""
    spread: float = 0.3
    """Share of ropes whose splines are drawn from the widened Gaussian; the rest: the policy's."""
    last: float = 0.3
    """Both shares fall linearly to this fraction of themselves in the last round."""
    widening: float = 1.5
    """Factor on the actor's spread."""
    floor: float = 0.25
    """Standard deviation added to it in every direction, normalised units."""
    iterations: int = 3
    """Cross-entropy iterations of the search."""
    population: int = 256
    """Splines scored in each iteration of every search in training."""

    def __post_init__(self) -> None:
        if min(self.search, self.spread) < 0 or self.search + self.spread > 1:
            raise ValueError(
                "search and spread of an exploration are shares of at most 1 together, got "
                f"{self.search:g} and {self.spread:g}"
            )


@dataclass
class ImitationConfig:
    """How long a primitive imitates, and of what."""

    learner: LearnerConfig = field(default_factory=LearnerConfig)
    """Optimiser and batches."""
    steps: int = 25
    """Gradient steps between two validations."""
    validations: int = 40
    """How many there are, the last one at the end."""
    held_out: float = 0.125
    """Share of each action's trials, of all its start shapes, that is held out for validation."""


@dataclass
class ReinforcementConfig:
    """How long a primitive is reinforced, and how."""

    learner: LearnerConfig = field(default_factory=lambda: LearnerConfig(demonstration_trials=8))
    """Optimiser and batches."""
    exploration: ExplorationConfig = field(default_factory=ExplorationConfig)
    """How the behaviour policy differs from the policy."""
    rounds: list[int] = field(default_factory=lambda: [20, 10, 15, 60])
    """Rounds of attempts and gradient steps of primitives 1 to 4; the last has hard tasks."""
    room: list[float] = field(default_factory=lambda: [0.2, 0.0, 0.06, 0.0])
    """Least segment, fraction of the rope's length, of an end shape that is rewarded, of primitives
    1 to 4. The end must go through primitive 1's loop; primitive 3 lays an end over the rope, of
    which little may be left to go on with."""
    ropes: int = 48
    """Start shapes of each task in a round."""
    splines: int = 2
    """Splines tried on each."""
    steps: int = 80
    """Gradient steps in a round."""
    recycled_share: float = 0.3
    """Share of the start shapes that earlier attempts left behind."""
    recycled_capacity: int = 1000
    """How many of those are kept for each start state."""
    critic_reset_every: int = 20
    """Rounds between two resets of the critic; there is one after the last round, too."""
    critic_reset_steps: int = 1000
    """Gradient steps after a reset, over which the learning rate falls to 0."""

    def __post_init__(self) -> None:
        for name, values in (("rounds", self.rounds), ("room", self.room)):
            if len(values) != 4:
                raise ValueError(
                    f"{name} of a reinforcement training are of primitives 1 to 4, got {values}"
                )


@dataclass
class TransitionConfig:
    """What joint finetuning and self-play share."""

    learner: LearnerConfig = field(
        default_factory=lambda: LearnerConfig(
            learning_rate=5e-4, critic_reset_boost=4.0, rollout_ropes=256, rollout_trials=1
        )
    )
    """Optimiser and batches of each primitive. Large steps would unlearn what took long to learn;
    every trial is one of its own rope."""
    exploration: ExplorationConfig = field(
        default_factory=lambda: ExplorationConfig(search=0.2, spread=0.15, last=1.0)
    )
    """How the behaviour policy differs from the policy, constant over the rounds."""
    rounds: int = 250
    """Rounds of trials and gradient steps."""
    capacity: int = 60000
    """Trials in each primitive's replay buffer, the newest."""
    memory: int = 4000
    """Attempts of independent training that it begins with, the newest, for each action."""
    refreshed: int = 256
    """Stored trials of each primitive whose next value is recomputed in a round."""
    steps: int = 8
    """Gradient steps of each primitive in a round,"""
    new_steps: int = 16
    """and of one without demonstrations, which has everything to learn,"""
    successes_per_step: int = 4
    """but at most one for so many successes in its replay buffer, lest it overfit to a few."""
    critic_reset_every: int = 125
    """Rounds between two resets of the critics; there is one after the last round, too. 0: none."""
    critic_reset_steps: int = 1500
    """Gradient steps after a reset, over which the learning rates fall to 0."""


@dataclass
class EpisodesConfig(TransitionConfig):
    """How long the primitives train on tasks of several steps, and how."""

    learner: LearnerConfig = field(
        default_factory=lambda: LearnerConfig(
            learning_rate=7e-4, rollout_ropes=32, rollout_trials=1
        )
    )
    """Optimiser and batches of each primitive; learning rate and batch are the authors'."""
    environments: int = 64
    """Episodes in a round, side by side; 8 in the authors' code."""
    splines: int = 5
    """Most splines in an episode."""
    shortest_segment: float = 2 / 64
    """An episode ends where a segment is shorter, fraction of the rope's length."""
    rounds: int = 30
    """Rounds of episodes and gradient steps."""
    memory: int = 2000
    steps: int = 40
    new_steps: int = 40
    critic_reset_steps: int = 500
    """Gradient steps after the critics' reset at the end."""


@dataclass
class JointConfig(EpisodesConfig):
    """How long the primitives train on a knot, and how."""

    goal: str = "overhand"
    """The knot that episodes tie."""

    def __post_init__(self) -> None:
        _check_tied(self.goal)


@dataclass
class RopesConfig:
    """The ropes and worlds that trials are in."""

    ropes: int = 64
    """Ropes that trials are on: the nominal one, and others drawn from"""
    proportions: ProportionsConfig = field(default_factory=ProportionsConfig)
    """these proportions."""
    nominal_share: float = 0.25
    """Share of the nominal rope in the trials that begin without crossings."""
    worlds: WorldsConfig = field(default_factory=lambda: WorldsConfig(error=0.005))
    """What the world of each trial is drawn from, so that critics learn how sure a spline is."""


@dataclass
class KnotsConfig(RopesConfig, EpisodesConfig):
    """How long the primitives train on knots, and how."""

    knots: dict[str, float] = field(default_factory=lambda: {"overhand": 6.0, "figure_eight": 3.0})
    """Relative frequencies of the knots that episodes tie,"""
    crossings_shares: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0, 3.0, 3.0])
    """and of goals drawn among all states of 0, 1, 2, ... crossings, lest others be unlearned."""
    nominal_share: float = 0.4
    worlds: WorldsConfig = field(default_factory=lambda: WorldsConfig(level=2, error=0.005))
    environments: int = 128
    splines: int = 8
    rounds: int = 60
    critic_reset_every: int = 0
    """Never: critics go on from self-play, whose trials are more than these."""

    def __post_init__(self) -> None:
        for name in self.knots:
            _check_tied(name)
        if any(self.crossings_shares[:1]):
            raise ValueError(
                "the share of goals without crossings is 0, for there is nothing to tie, got "
                f"{self.crossings_shares[0]:g}"
            )


@dataclass
class SelfPlayConfig(RopesConfig, TransitionConfig):
    """How long the primitives train on all actions, and how."""

    rounds: int = 375
    memory: int = 1000
    most_crossings: int = 4
    """Of the states that trials begin in and lead to."""
    trials: int = 384
    """Trials in a round, each from a shape of its own."""
    crossings_shares: list[float] = field(default_factory=lambda: [0.5, 3.0, 7.0, 2.0, 0.2])
    """Relative frequencies of 0, 1, 2, ... crossings at the start of a trial."""
    candidates: int = 4
    """Ropes and actions that are drawn for each trial; see `curriculum.sampling_priority`."""
    undo_share: float = 0.15
    """Share of the trials that undo an action."""
    arranging_share: float = 0.35
    """Share of the trials that arrange the rope instead of acting,"""
    arrange_below_value: float = 0.7
    """where the action's value is below this."""
    guess_below_value: float = 0.3
    """Where the action's value is below this, or the rope is arranged,"""
    guess_fraction: float = 0.5
    """this share of the splines are heuristic, the best of many by a cheap prediction."""
    shapes: int = 128
    """Rope shapes that are kept of each state."""
