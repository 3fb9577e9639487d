"""What each training takes from the configuration: efforts, batches, exploration.

They are here, beside no code, so that the command's configuration is read without PyTorch.
"""

from __future__ import annotations

from dataclasses import dataclass, field


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
    settling_boost: float = 1.0
    """Factor on the learning rate of a critic that begins anew."""
    gradient_norm: float = 5.0
    """Gradients are clipped to this norm."""
    failure_weight: float = 0.0
    """Share of a rope's mean reward that the actor's advantage takes off; see `ActorLoss`."""
    gains_only: bool = False
    """Whether trials that were worse than the baseline are left out of the actor's loss."""
    success_share: float = 0.5
    """Share of the actor's return that success brings alone; the rest is for what it leaves."""
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
    augmentation: AugmentationConfig = field(default_factory=AugmentationConfig)
    """Deformed copies of the trials in a batch."""


@dataclass
class ExplorationConfig:
    """Shares of the three ways, and how wide the wider neighbourhood is."""

    search: float = 0.4
    """Share of ropes whose splines a search in the wider neighbourhood finds; the policy does,
    without critic."""
    spread: float = 0.3
    """Share of ropes whose splines are drawn from the wider neighbourhood; the rest are the
    policy's."""
    last: float = 0.3
    """Both shares fall to this part of themselves, evenly over the rounds."""
    widening: float = 1.5
    """Factor on the actor's spread."""
    floor: float = 0.25
    """Standard deviation added to it in every direction, normalised units."""
    iterations: int = 3
    """Iterations of the wide search."""


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
    """Share of the start shapes that is held out, to see how the losses are there; of the trials,
    where start shapes are few."""


@dataclass
class ReinforcementConfig:
    """How long a primitive is reinforced, and how."""

    learner: LearnerConfig = field(default_factory=LearnerConfig)
    """Optimiser and batches."""
    exploration: ExplorationConfig = field(default_factory=ExplorationConfig)
    """How the behaviour policy differs from the policy."""
    rounds: int = 24
    """Rounds of attempts and gradient steps."""
    ropes: int = 48
    """Start shapes of each task in a round; few splines on many shapes teach more than many on
    few."""
    splines: int = 2
    """Splines tried on each."""
    steps: int = 40
    """Gradient steps in a round."""
    recycled_share: float = 0.3
    """Share of the start shapes that earlier attempts left behind, see `shapes`."""
    recycled_capacity: int = 1000
    """How many of those are kept for each start state."""
    settle_every: int = 20
    """Rounds after which the critic begins anew and the learning rate falls to 0, as both do after
    the last,"""
    settle_steps: int = 1000
    """over so many gradient steps: what the attempts teach is more than the few steps of a round
    take in."""


def _gentle() -> LearnerConfig:
    # Large steps would unlearn what took long to learn; every trial is one of its own rope.
    return LearnerConfig(
        learning_rate=5e-4, settling_boost=4.0, rollout_ropes=256, rollout_trials=1
    )


@dataclass
class SelfPlayConfig:
    """How long primitives play together, and how."""

    learner: LearnerConfig = field(default_factory=_gentle)
    """Optimiser and batches of each primitive."""
    exploration: ExplorationConfig = field(
        default_factory=lambda: ExplorationConfig(search=0.2, spread=0.15, last=1.0)
    )
    """How the behaviour policy differs from the policy: no less in the end, so that fewer rounds
    are the first ones of more."""
    most_crossings: int = 4
    """Of the states that are played from and to."""
    rounds: int = 100
    """Rounds of trials and gradient steps."""
    ropes: int = 384
    """Trials in a round, each on a rope of its own."""
    crossings_shares: list[float] = field(default_factory=lambda: [0.5, 1.5, 7.0, 2.0, 0.2])
    """How often trials begin with 0, 1, 2, ... crossings, relative to each other."""
    candidates: int = 4
    """Ropes and actions that are drawn for each trial; tried are rather those of which the critic
    thinks that they sometimes succeed."""
    undo_share: float = 0.15
    """Share of the trials that undo an action."""
    arranging_share: float = 0.35
    """Share of the trials that arrange the rope instead,"""
    arrange_below_value: float = 0.7
    """where the critic gives the wanted action less than this."""
    guess_below_value: float = 0.3
    """Where the best value that the critic sees is below this, or the rope is to be arranged,"""
    guess_fraction: float = 0.5
    """this share of the splines are guesses, the best of many that are cheaply predicted."""
    hindsight: bool = True
    """Whether trials count for other actions than the one that was meant."""
    hindsight_pull: float = 0.2
    """Weight of such trials on the actor: they are mostly unlike what it should propose."""
    shapes: int = 128
    """Rope shapes that are remembered of each state."""
    capacity: int = 30000
    """Trials that stay in each primitive's replay buffer, the newest."""
    memory: int = 4000
    """Attempts of independent training that it begins with, the newest, for each action."""
    refreshed: int = 256
    """Stored trials of each primitive whose next value is worked out anew in a round."""
    steps: int = 8
    """Gradient steps of each primitive in a round,"""
    new_steps: int = 16
    """and of one without demonstrations, which has everything to learn,"""
    successes_per_step: int = 4
    """but at most one for so many successes in its replay buffer, lest it learn a few by heart."""
    settle_every: int = 50
    """Rounds after which the critics begin anew and the learning rates fall to 0, as both do after
    the last,"""
    settle_steps: int = 1000
    """over so many gradient steps."""
