"""Settings of Causal InfoGAN, with the values of its authors' public code where it has them."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass
class CausalInfoGanConfig:
    """Networks, training and planning of one model."""

    code_dim: int = 7
    """Dimensions of the latent code, each uniform on [-1, 1]."""
    noise_dim: int = 2
    """Dimensions of the generator's further noise, standard normal."""
    transition_hidden: list[int] = field(default_factory=lambda: [64, 64])
    """Widths of the transition network's hidden layers."""
    width: int = 64
    """Channels of the generator's first layer; the others' layers are as wide or half of it."""
    learning_rate: float = 2e-4
    """Adam's, for all networks."""
    beta1: float = 0.5
    """Adam's first moment."""
    beta2: float = 0.999
    """Adam's second moment."""
    information_weight: float = 0.1
    """Weight of the mutual information between codes and shapes."""
    variance_weight: float = 0.1
    """Weight of the transition's squared variance, which keeps steps of a plan small."""
    batch: int = 100
    """Pairs of a gradient step."""
    steps: int = 9000
    """Gradient steps."""
    check_every: int = 500
    """Steps between two points of the training curves."""
    frame_rate: float = 5.0
    """Frames per second of the training trajectories; a pair is two neighbouring frames."""
    plan_steps: int = 10
    """Steps of a plan through the latent space for each topological action."""
    candidates: int = 100
    """Noises tried for a plan; the one the discriminator believes most is kept."""
    prior_samples: int = 4000
    """Generated shapes among which a projection looks for its first guesses."""
    restarts: int = 8
    """First guesses that a projection refines."""
    projection_steps: int = 300
    """Adam steps of a projection."""
    projection_rate: float = 0.02
    """Adam's rate in a projection."""
