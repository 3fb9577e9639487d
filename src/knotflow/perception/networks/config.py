"""Configuration of the networks and their trainings; loads no PyTorch."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

SHIPPED_NETWORK = Path(__file__).parents[1] / "data" / "network.safetensors"
"""The weights that come with the package."""
SELF_SUPERVISION_STEPS = 200
"""Gradient steps of the training on images alone."""


@dataclass
class CoarseToFineConfig:
    """Sizes of the network."""

    size: int = 96
    """Pixels of the patch's side."""
    channels: tuple[int, ...] = (16, 32, 64, 96)
    """Features of the encoder, each at half the resolution of the one before."""
    nodes: tuple[int, ...] = (9, 17, 41)
    """Nodes of each level."""
    width: int = 64
    """Features of a node."""
    layers: int = 2
    """Attention layers of each level."""

    def __post_init__(self) -> None:
        if self.size % 2 ** len(self.channels):
            raise ValueError(
                f"a patch's side is a multiple of {2 ** len(self.channels)} pixels, as it is "
                f"halved {len(self.channels)} times; got {self.size}"
            )
        if sorted(self.nodes) != list(self.nodes) or min(self.nodes) < 2:
            raise ValueError(f"levels have two nodes or more, growing; got {self.nodes}")


@dataclass
class StrandNetworkConfig:
    """Sizes of the network that follows strands."""

    channels: tuple[int, ...] = (16, 32, 64)
    """Features of the encoder, each at half the resolution of the one before."""
    width: int = 96
    """Features of what is predicted from them."""


@dataclass
class ExamplesConfig:
    """How much examples differ from the shapes they are drawn from; uniform unless said."""

    scale: float = 0.1
    """Largest relative change of the rope's thickness against its length."""
    distance: tuple[float, float] = (0.8, 1.6)
    """Camera's height above the table, rope lengths."""
    aside: float = 0.5
    """Farthest that the rope lies from below the camera, in x and y, rope lengths."""
    turn: float = 0.25
    """Standard deviation of the patch's direction, radians."""
    shift: float = 0.03
    """Standard deviation of the patch's middle and size, half patches."""
    noise: float = 0.6
    """Largest standard deviation of a height, radii."""
    blur: float = 0.7
    """Largest blur of the rope's share: how much of a pixel's is that of the 3 x 3 around it."""
    sharpen: float = 1.5
    """Largest steepening of the rope's share, which a segmentation of yes or no has."""
    lost: float = 0.1
    """Largest share of pixels without depth."""
    hidden: float = 0.3
    """Probability that something hides a piece of the patch."""


@dataclass
class LossConfig:
    """Weights of the losses."""

    place: float = 10.0
    """Of the distance in the patch, half patches."""
    height: float = 0.2
    """Of the error in height, radii."""
    crossing: float = 1.0
    """Of a crossing's gap that is missing, radii."""
    scale: float = 0.05
    """Of the predicted distance to the truth (a Laplace distribution's likelihood)."""
    gap: float = 1.5
    """Gap in height between strands at a crossing that is enough, radii; 2 is touching."""


@dataclass
class EffortConfig:
    """The effort of a training, and what is learned from."""

    examples: ExamplesConfig = field(default_factory=ExamplesConfig)
    """How the ropes are seen."""
    validations: int = 100
    """Validations, and checkpoints, until the end."""
    steps: int = 200
    """Gradient steps between two of them."""
    batch: int = 48
    """Examples of a step."""
    learning_rate: float = 1e-3
    """Largest one; it rises over the first validation and falls to nothing as a cosine."""
    weight_decay: float = 1e-3
    """AdamW's."""
    gradient_norm: float = 5.0
    """Gradients are cut to this length."""
    held_out: float = 0.05
    """Share of the shapes, the last ones, that are for validation."""


@dataclass
class TrainingConfig(EffortConfig):
    """How the network learns that sees a whole rope."""

    network: CoarseToFineConfig = field(default_factory=CoarseToFineConfig)
    """Its sizes."""
    loss: LossConfig = field(default_factory=LossConfig)
    """What counts."""


@dataclass
class StrandTrainingConfig(EffortConfig):
    """How the network learns that follows strands."""

    network: StrandNetworkConfig = field(default_factory=StrandNetworkConfig)
    """Its sizes."""
    validations: int = 25
    batch: int = 192
    learning_rate: float = 1.5e-3
