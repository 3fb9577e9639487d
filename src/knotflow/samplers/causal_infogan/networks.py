"""The networks of Causal InfoGAN (Kurutach et al. 2018), for rope shapes instead of images.

1-D convolutions along the rope of the reference's kernel (4) and stride (2). The generator makes
directions of links and adds links of the right length to each other; discriminator and posterior
see points. Shapes are (N, V, 3), metres, start frame.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import torch
from torch import Tensor, nn
from torch.nn.utils.parametrizations import spectral_norm

from knotflow.samplers.causal_infogan.data import CODE_DIM, NOISE_DIM, CausalInfoGanConfig

HALVINGS = 3
MIN_VARIANCE = 1e-6
LEAST_SPREAD = 1e-4  # metres; ropes that never leave the table have no spread in z


class Scale(nn.Module):
    """Statistics of the training shapes, which normalise the networks' inputs."""

    mean: Tensor
    spread: Tensor
    motion: Tensor
    link: Tensor

    def __init__(self, mean: Tensor, spread: Tensor, motion: Tensor, link: Tensor) -> None:
        """Mean, deviation, and deviation of a pair's motion, (3,) each; length of a link, ()."""
        super().__init__()
        named = {"mean": mean, "spread": spread, "motion": motion, "link": link}
        for name, one in named.items():
            self.register_buffer(name, one)

    @classmethod
    def of(cls, firsts: Tensor, seconds: Tensor) -> Scale:
        """Measured on pairs of shapes, (N, V, 3) each."""
        axes = (0, 1)
        return cls(
            firsts.mean(dim=axes),
            firsts.std(dim=axes).clamp_min(LEAST_SPREAD),
            (seconds - firsts).std(dim=axes).clamp_min(LEAST_SPREAD),
            torch.diff(firsts, dim=1).norm(dim=-1).mean(),
        )

    def shape(self, points: Tensor) -> Tensor:
        """(N, 6, V): standardised positions, and link vectors in link lengths."""
        links = torch.diff(points, dim=1) / self.link
        links = torch.cat([links, links[:, -1:]], dim=1)
        return torch.cat([(points - self.mean) / self.spread, links], dim=2).transpose(1, 2)

    def pair(self, first: Tensor, second: Tensor) -> Tensor:
        """(N, 9, V): the first shape, and the standardised motion to the second."""
        motion = (second - first) / self.motion
        return torch.cat([self.shape(first), motion.transpose(1, 2)], dim=1)


class Generator(nn.Module):
    """G(z, c, c'): a pair of consecutive shapes from noise and two codes."""

    def __init__(self, config: CausalInfoGanConfig, scale: Scale, vertices: int) -> None:
        super().__init__()
        self.scale, self.links, self.width = scale, vertices - 1, config.width
        self.short = math.ceil(self.links / 2**HALVINGS)
        wide, half = self.width, self.width // 2
        self.enter = nn.Sequential(
            nn.Linear(NOISE_DIM + 2 * CODE_DIM, wide * self.short, bias=False),
            nn.BatchNorm1d(wide * self.short),
            nn.ReLU(),
        )
        self.grow = nn.Sequential(*_doubling(wide, wide), *_doubling(wide, half))
        self.turn = nn.ConvTranspose1d(half, 6, 4, 2, 1)  # directions of links, and their change
        self.place = nn.Linear(wide * self.short, 6)  # the centroid, and its motion

    def forward(self, noise: Tensor, code: Tensor, next_code: Tensor) -> tuple[Tensor, Tensor]:
        """Two shapes (N, V, 3) from (N, NOISE_DIM), (N, CODE_DIM), (N, CODE_DIM)."""
        seed = self.enter(torch.cat([noise, code, next_code], dim=1))
        turns = self.turn(self.grow(seed.view(-1, self.width, self.short)))
        turns = turns[:, :, : self.links].transpose(1, 2)  # (N, links, 6)
        place = self.place(seed)[:, None]  # (N, 1, 6)
        centre = self.scale.mean + self.scale.spread * place[..., :3]
        motion = self.scale.motion * place[..., 3:]
        first = self._rope(turns[..., :3], centre)
        second = self._rope(turns.unflatten(2, (2, 3)).sum(2), centre + motion)
        return first, second

    def _rope(self, turns: Tensor, centre: Tensor) -> Tensor:
        steps = self.scale.link * nn.functional.normalize(turns, dim=-1)
        points = nn.functional.pad(steps.cumsum(dim=1), (0, 0, 1, 0))
        return points - points.mean(dim=1, keepdim=True) + centre


class Discriminator(nn.Module):
    """D(x, x'): log-odds that a pair of shapes is from the data."""

    def __init__(self, config: CausalInfoGanConfig, scale: Scale, vertices: int) -> None:
        super().__init__()
        self.scale = scale
        self.read = _halving(9, config.width // 2, 1, vertices, spectral=True)

    def forward(self, first: Tensor, second: Tensor) -> Tensor:
        """(N,) from two shapes (N, V, 3)."""
        log_odds: Tensor = self.read(self.scale.pair(first, second))
        return log_odds[:, 0]


class Posterior(nn.Module):
    """Q(c | x): which code a shape was made from, Gaussian."""

    def __init__(self, config: CausalInfoGanConfig, scale: Scale, vertices: int) -> None:
        super().__init__()
        self.scale = scale
        self.read = _halving(6, config.width // 2, 2 * CODE_DIM, vertices, spectral=False)

    def forward(self, points: Tensor) -> tuple[Tensor, Tensor]:
        """Mean and variance (N, code_dim) for shapes (N, V, 3)."""
        mean, log_variance = self.read(self.scale.shape(points)).chunk(2, dim=1)
        return mean, log_variance.exp() + MIN_VARIANCE


class Transition(nn.Module):
    """T(c' | c): Gaussian about c with a learned variance."""

    def __init__(self) -> None:
        super().__init__()
        self.log_variance = nn.Sequential(
            nn.Linear(CODE_DIM, 64),
            nn.ReLU(),
            nn.Linear(64, 64),
            nn.ReLU(),
            nn.Linear(64, CODE_DIM),
        )

    def forward(self, code: Tensor, noise: Tensor) -> tuple[Tensor, Tensor]:
        """Next codes and their variance, (N, code_dim) each, for standard normal noise."""
        variance = self.log_variance(code).exp() + MIN_VARIANCE
        return code + variance.sqrt() * noise, variance


class CausalInfoGan(nn.Module):
    """The four networks."""

    def __init__(self, config: CausalInfoGanConfig, scale: Scale, vertices: int) -> None:
        super().__init__()
        self.config, self.vertices = config, vertices
        self.scale = scale
        self.generator = Generator(config, scale, vertices)
        self.discriminator = Discriminator(config, scale, vertices)
        self.posterior = Posterior(config, scale, vertices)
        self.transition = Transition()

    def draw(self, count: int, rng: torch.Generator) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Noise, codes, next codes and the variance of these, from the prior."""
        code = 2 * torch.rand(count, CODE_DIM, generator=rng) - 1
        noise = torch.randn(count, NOISE_DIM, generator=rng)
        step = torch.randn(count, CODE_DIM, generator=rng)
        return noise, code, *self.transition(code, step)


def gaussian_log_density(value: Tensor, mean: Tensor, variance: Tensor) -> Tensor:
    """(N,) log density of a diagonal Gaussian at (N, D)."""
    return -0.5 * ((2 * math.pi * variance).log() + (value - mean) ** 2 / variance).sum(dim=1)


def _doubling(before: int, after: int) -> Sequence[nn.Module]:
    return (
        nn.ConvTranspose1d(before, after, 4, 2, 1, bias=False),
        nn.BatchNorm1d(after),
        nn.ReLU(),
    )


def _halving(channels: int, width: int, out: int, vertices: int, *, spectral: bool) -> nn.Module:
    """Convolutions down to an eighth of the rope, then one number for each of `out`."""
    layers: list[nn.Module] = []
    length = vertices
    for before, after in ((channels, width), (width, 2 * width), (2 * width, 2 * width)):
        layers += [nn.Conv1d(before, after, 4, 2, 1), nn.LeakyReLU(0.2)]
        length //= 2
    layers += [nn.Flatten(), nn.Linear(2 * width * length, out)]
    if spectral:  # keeps the discriminator smooth; the reference's batch normalisation does not
        layers = [spectral_norm(one) if list(one.parameters()) else one for one in layers]
    return nn.Sequential(*layers)


def save_model(path: Path, model: CausalInfoGan, actions: Sequence[str]) -> None:
    """Write a model that was trained on rollouts of the given actions, such as "C(0,1,1)"."""
    content = {"config": asdict(model.config), "vertices": model.vertices}
    torch.save(content | {"actions": list(actions), "weights": model.state_dict()}, path)


def load_model(path: Path) -> tuple[CausalInfoGan, list[str]]:
    """What `save_model` wrote: the model, in evaluation mode, and its actions."""
    content = torch.load(path, weights_only=True)
    # The real scale is among the weights; each buffer needs a memory of its own.
    scale = Scale(torch.ones(3), torch.ones(3), torch.ones(3), torch.ones(()))
    model = CausalInfoGan(CausalInfoGanConfig(**content["config"]), scale, content["vertices"])
    model.load_state_dict(content["weights"])
    return model.eval(), content["actions"]


LEAST = {"spread": 0.5, "starts_covered": 0.5, "code_used": 0.25}
"""A training whose numbers end below one of these has collapsed."""
SAMPLES = 1000


@dataclass(frozen=True)
class Health:
    """What the generator makes, compared with the data; distances are root mean squares, metres.

    The first three are near 1 for a healthy model, and each near 0 for one of the ways to collapse.
    """

    spread: float
    """Mean distance between two generated shapes, over that between two of the data."""
    starts_covered: float
    """Effective number (exponential of the entropy) of the demonstrated starts whose shapes are
    the nearest to generated ones, over that of the data."""
    code_used: float
    """Share of the codes' variance that the posterior reads back off generated shapes."""
    distance_to_data: float
    """From a generated shape to the nearest of the data, mean: how plausible shapes are."""
    distance_from_data: float
    """From a shape of the data to the nearest generated, mean: what is left out."""
    motion: float
    """Mean motion from the first to the second shape of a pair, over that of the data."""

    @property
    def collapsed(self) -> list[str]:
        """The numbers that indicate a collapse; none for a healthy model."""
        numbers = asdict(self)
        return [name for name, least in LEAST.items() if not numbers[name] >= least]


class Checkup:
    """Compares a generator with a fixed sample of the data, the same for all models.

    Shapes (N, F, V, 3) are in start frames, metres; starts (N,) are numbers of demonstrations.
    """

    def __init__(self, shapes: Tensor, starts: Tensor) -> None:
        rng = torch.Generator().manual_seed(0)
        rollout = torch.randint(len(shapes), (SAMPLES,), generator=rng)
        frame = torch.randint(shapes.shape[1] - 1, (SAMPLES,), generator=rng)
        self._data = shapes[rollout, frame]
        self._starts = torch.unique(starts, return_inverse=True)[1][rollout]
        self._motion = _rms(shapes[rollout, frame + 1] - self._data).mean()
        self._spread = _between(self._data)
        self._effective = _effective(self._starts)

    @torch.no_grad()
    def __call__(self, model: CausalInfoGan) -> Health:
        """The model's health, on samples of the prior."""
        was_training = model.training
        model.eval()
        noise, code, next_code, _ = model.draw(SAMPLES, torch.Generator().manual_seed(0))
        made, next_made = model.generator(noise, code, next_code)
        read, _ = model.posterior(made)
        model.train(was_training)
        distance = _distances(made, self._data)
        nearest = self._starts[distance.argmin(dim=1)]
        unread = (read - code).square().mean() / code.var()
        return Health(
            spread=float(_between(made) / self._spread),
            starts_covered=_effective(nearest) / self._effective,
            code_used=float(1 - unread),
            distance_to_data=float(distance.amin(dim=1).mean()),
            distance_from_data=float(distance.amin(dim=0).mean()),
            motion=float(_rms(next_made - made).mean() / self._motion),
        )


def _rms(difference: Tensor) -> Tensor:
    return difference.square().sum(dim=-1).mean(dim=-1).sqrt()


def _distances(one: Tensor, other: Tensor) -> Tensor:
    return torch.cdist(one.flatten(1), other.flatten(1)) / math.sqrt(one.shape[1])


def _between(shapes: Tensor) -> Tensor:
    half = len(shapes) // 2
    return _distances(shapes[:half], shapes[half:]).mean()


def _effective(labels: Tensor) -> float:
    share = torch.bincount(labels) / len(labels)
    return float(torch.special.entr(share).sum().exp())
