"""Configuration of the learned dynamics and their training; loads no PyTorch."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

SHIPPED_DYNAMICS = Path(__file__).parent / "data" / "dynamics.safetensors"
"""The weights that come with the package."""


@dataclass
class LstmConfig:
    """The network, and the rope it is for."""

    hidden: int = 128
    """Size of each direction's state."""
    layers: int = 1
    """LSTMs on top of each other."""
    group: int = 4
    """Neighbouring vertices that are read at a time: a rope read in a quarter of the steps may have
    twice the states for the same time."""
    links: int = 40
    """Of the rope."""
    length: float = 1.0
    """Of the rope, metres."""
    straightening: int = 4
    """Passes over the links that bring them back towards their length."""


@dataclass
class DynamicsTrainingConfig:
    """The effort, and what is learned from."""

    network: LstmConfig = field(default_factory=LstmConfig)
    """What is trained."""
    validations: int = 120
    """Validations, and checkpoints, until the end."""
    steps: int = 200
    """Gradient steps between two of them."""
    batch: int = 48
    """Parts of motions in a gradient step."""
    horizon: int = 10
    """Longest rollout that is learned from, in steps of 0.1 s; training begins with one of 2."""
    learning_rate: float = 3e-3
    """At first; it falls to a hundredth along a cosine."""
    weight_decay: float = 1e-4
    """AdamW's."""
    gradient_norm: float = 0.1
    """Gradients are cut to this length."""
    noise: float = 0.0003
    """Standard deviation of the error of the first vertices, metres: estimates have some."""
    held_out: float = 0.05
    """Share of the motions, those of the last ropes, that are for validation."""
