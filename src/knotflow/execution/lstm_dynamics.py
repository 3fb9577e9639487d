"""The learned dynamics of a rope: a bidirectional LSTM over its vertices, as in [15] (Sec. VI).

A vertex moves by a share of the gripper's displacement, a share of its own velocity and a residual,
in a frame whose x axis is the vertex's heading. Training is on rollouts of several steps.
"""

from __future__ import annotations

import math
from dataclasses import asdict
from pathlib import Path

import torch
from torch import Tensor, nn
from torch.nn.functional import pad

from knotflow.arrays import read_weights, save_weights
from knotflow.execution.dynamics import (
    JUDGED_STEPS,
    SHIPPED_DYNAMICS,
    DynamicsTrainingConfig,
    LstmConfig,
    grasped_at_each_step,
    motion_errors,
)
from knotflow.execution.motions import FREE, STEP, Motions
from knotflow.threads import one_thread
from knotflow.training.trainer import Metrics, SupervisedTrainer

FEATURES, OUTPUTS = 22, 5  # of a vertex
POSITION_SCALE, HEIGHT_SCALE, DISPLACEMENT_SCALE = 0.2, 0.02, 0.05  # metres; features are about 1
RELAXATION = 0.25  # of a link's excess length per pass, at each end
MAX_VALIDATED = 256  # held-out motions


class LstmDynamics(nn.Module):
    """See `RopeDynamics`."""

    def __init__(self, config: LstmConfig | None = None) -> None:
        super().__init__()
        self.config = config = config or LstmConfig()
        self.read = nn.Sequential(nn.Linear(FEATURES * config.group, config.hidden), nn.SiLU())
        self.lstm = nn.LSTM(
            config.hidden, config.hidden, config.layers, batch_first=True, bidirectional=True
        )
        self.out = nn.Linear(2 * config.hidden, OUTPUTS * config.group)
        nn.init.zeros_(self.out.weight)
        nn.init.zeros_(self.out.bias)

    def forward(
        self, points: Tensor, velocities: Tensor, grasped: Tensor, gripper: Tensor
    ) -> Tensor:
        """Vertices (B, V, 3) after one step, at whose end the gripper is at `gripper` (B, 3)."""
        held = (grasped != FREE).float()[:, None]  # (B, 1)
        count = points.shape[1]
        link = torch.where(grasped == FREE, (count - 1) // 2, grasped)[:, None]
        vertex = torch.arange(count, device=points.device)
        flag = ((vertex == link) | (vertex == link + 1)).float()  # (B, V)
        centre = (flag[..., None] * points).sum(1, keepdim=True) / 2  # (B, 1, 3)
        links = points.diff(dim=1)
        ahead, behind = torch.cat([links, links[:, -1:]], 1), torch.cat([links[:, :1], links], 1)
        across = (ahead + behind)[..., :2]
        heading = across / across.norm(dim=-1, keepdim=True).clamp(min=1e-6)
        pull = ((gripper[:, None] - centre) * held[..., None]).expand_as(points)
        pull, speed = _rotate(pull, heading, -1), _rotate(velocities, heading, -1)
        away = ((vertex - link) / count)[..., None]
        features = [
            _rotate(points - centre, heading, -1) / POSITION_SCALE,
            points[..., 2:] / HEIGHT_SCALE,
            _rotate(ahead, heading, -1) * self.config.links,
            _rotate(behind, heading, -1) * self.config.links,
            speed * STEP / DISPLACEMENT_SCALE,
            pull / DISPLACEMENT_SCALE,
            away,
            away.abs(),
            flag[..., None],
            held[..., None].expand(-1, count, 1),
            pull.norm(dim=-1, keepdim=True) / DISPLACEMENT_SCALE,
            speed.norm(dim=-1, keepdim=True) * STEP / DISPLACEMENT_SCALE,
        ]
        rows, group = len(points), self.config.group
        read = pad(torch.cat(features, -1), (0, 0, 0, -count % group))  # (B, V', FEATURES)
        read = self.read(read.reshape(rows, -1, group * FEATURES))
        out: Tensor = self.out(self.lstm(read)[0]).reshape(rows, -1, OUTPUTS)[:, :count]
        residual = DISPLACEMENT_SCALE * out[..., :3]
        moved = residual + out[..., 3:4] * pull + out[..., 4:] * speed * STEP
        return self._restore_lengths(points + _rotate(moved, heading, 1))

    @one_thread()
    def predict(
        self, points: Tensor, velocities: Tensor, grasped: Tensor, gripper: Tensor
    ) -> Tensor:
        points, velocities, gripper = points.float(), velocities.float(), gripper.float()
        grasped = grasped_at_each_step(grasped, gripper.shape[1])
        ahead = []
        for step in range(gripper.shape[1]):
            moved = self(points, velocities, grasped[:, step], gripper[:, step])
            points, velocities = moved, (moved - points) / STEP
            ahead.append(points)
        return torch.stack(ahead, 1)

    def _restore_lengths(self, points: Tensor) -> Tensor:
        """Vertices (B, V, 3) whose links are closer to their length."""
        length = self.config.length / self.config.links
        for _ in range(self.config.straightening):
            link = points.diff(dim=1)
            size = link.norm(dim=-1, keepdim=True).clamp(min=1e-6)
            excess = link * (1 - length / size)
            back = pad(excess, (0, 0, 0, 1)) - pad(excess, (0, 0, 1, 0))
            points = points + RELAXATION * back
        return points

    def save(self, path: Path) -> None:
        """Write weights and configuration as safetensors, in half precision."""
        config = {name: str(value) for name, value in asdict(self.config).items()}
        save_weights(path, self.state_dict(), config)

    @classmethod
    def load(cls, path: Path = SHIPPED_DYNAMICS) -> LstmDynamics:
        """Read what `save` wrote.

        Raises:
            ValueError: naming the file; not one that `save` wrote.
        """
        written, weights = read_weights(path)
        names = asdict(LstmConfig())
        try:
            model = cls(LstmConfig(**{name: type(names[name])(written[name]) for name in names}))
            model.load_state_dict({name: one.float() for name, one in weights.items()})
        except (KeyError, RuntimeError) as error:
            raise ValueError(f"{path}: holds no LSTM dynamics: {error}") from None
        return model.eval().requires_grad_(False)


def _rotate(vectors: Tensor, heading: Tensor, sign: int) -> Tensor:
    """Vectors (..., 3) turned about z by a heading (..., 2), its cosine and sine, or back (-1)."""
    x, y, z = vectors.unbind(-1)
    cos, sin = heading[..., 0], sign * heading[..., 1]
    return torch.stack([cos * x - sin * y, sin * x + cos * y, z], -1)


class DynamicsTrainer(SupervisedTrainer):
    """Trains `model` on parts of motions."""

    measure = "error_mm"
    model: LstmDynamics

    def __init__(self, motions: Motions, config: DynamicsTrainingConfig, seed: int) -> None:
        """Motions of the same rope stand side by side; they are two or more.

        Raises:
            ValueError: fewer than two motions, or of another number of vertices.
        """
        vertices = config.network.links + 1
        if len(motions) < 2 or motions.points.shape[2] != vertices:
            raise ValueError(
                f"training needs two or more motions of ropes of {vertices} vertices, got points "
                f"of shape {motions.points.shape}"
            )
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            model = LstmDynamics(config.network)
        super().__init__(model, config, seed)
        self.config = config
        held = max(1, round(config.held_out * len(motions)))
        self._held_out = motions[-held:][:MAX_VALIDATED]
        learned = motions[:-held]
        self._points = torch.from_numpy(learned.points)
        self._gripper = torch.from_numpy(learned.gripper)
        self._grasped = torch.from_numpy(learned.grasped)

    def validate(self) -> Metrics:
        """Mean error (mm) of held-out motions after each number of `JUDGED_STEPS`, from rest."""
        errors = 1e3 * motion_errors(self.model, self._held_out).mean(axis=(0, 2))  # (T - 1,)
        return {f"validation_{steps}_mm": float(errors[steps - 1]) for steps in JUDGED_STEPS}

    def update(self, step: int) -> float:
        """Mean error of a batch, millimetres."""
        done = self.fraction(step)
        horizon = min(self.config.horizon, 2 + 2 * int(8 * done))
        points, velocities, grasped, gripper, truth = self._batch(horizon)
        ahead = self.model.predict(points, velocities, grasped, gripper)
        error = (ahead - truth).norm(dim=-1)  # (B, H, V)
        # Far steps are wrong by more, and must not drown the near ones.
        scale = torch.arange(1, horizon + 1).sqrt()[:, None]
        cosine = 0.5 * (1 + math.cos(math.pi * done))
        rate = self.config.learning_rate * (0.01 + 0.99 * cosine)
        self.descend((error / scale).mean(), rate)
        return 1e3 * float(error.detach().mean())

    def _batch(self, horizon: int) -> tuple[Tensor, ...]:
        """Parts of motions, mirrored and reversed at random."""
        count, frames = self.config.batch, self._points.shape[1]
        row = self._draw(len(self._points), count)
        first = self._draw(frames - horizon, count)
        frame = first[:, None] + torch.arange(horizon + 1)
        points, gripper = self._points[row[:, None], frame], self._gripper[row[:, None], frame]
        grasped = self._grasped[row[:, None], frame]
        before = self._points[row, (first - 1).clamp(min=0)]
        mirror = torch.ones(count, 3)
        mirror[:, 1] -= 2 * self._draw(2, count)
        points, before = points * mirror[:, None, None], before * mirror[:, None]
        gripper = gripper * mirror[:, None]
        reverse = self._draw(2, count).bool()
        points = torch.where(reverse[:, None, None, None], points.flip(2), points)
        before = torch.where(reverse[:, None, None], before.flip(1), before)
        other = torch.where(grasped >= 0, points.shape[2] - 2 - grasped, grasped)
        grasped = torch.where(reverse[:, None], other, grasped)
        now = points[:, 0]
        velocities = (now - before) / STEP
        noise = torch.randn(now.shape, generator=self.generator) * self.config.noise
        return now + noise, velocities, grasped[:, :-1], gripper[:, 1:], points[:, 1:]

    def _draw(self, high: int, count: int) -> Tensor:
        return torch.randint(high, (count,), generator=self.generator)
