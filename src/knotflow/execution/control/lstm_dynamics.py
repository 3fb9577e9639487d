"""The learned dynamics of a rope: a bidirectional LSTM over its vertices, as in [15] (Sec. VI).

A vertex moves by a share of the gripper's displacement, a share of its own velocity and a residual,
in a frame whose x axis is the vertex's heading.
"""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import torch
from torch import Tensor, nn
from torch.nn.functional import pad

from knotflow.execution.control.dynamics import SHIPPED_DYNAMICS, LstmConfig, grasped_at_each_step
from knotflow.execution.control.motions import FREE, STEP
from knotflow.threads import one_thread

FEATURES, OUTPUTS = 22, 5  # of a vertex
POSITION_SCALE, HEIGHT_SCALE, DISPLACEMENT_SCALE = 0.2, 0.02, 0.05  # metres; features are about 1
RELAXATION = 0.25  # of a link's excess length per pass, at each end


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
        out = self._read_vertices(torch.cat(features, -1))
        residual = DISPLACEMENT_SCALE * out[..., :3]
        moved = residual + out[..., 3:4] * pull + out[..., 4:] * speed * STEP
        return self._restore_lengths(points + _rotate(moved, heading, 1))

    def _read_vertices(self, features: Tensor) -> Tensor:
        """(B, V, features) -> (B, V, outputs)."""
        rows, count, size = features.shape
        group = self.config.group
        grouped = pad(features, (0, 0, 0, -count % group)).reshape(rows, -1, group * size)
        out: Tensor = self.out(self.lstm(self.read(grouped))[0])
        return out.reshape(rows, -1, OUTPUTS)[:, :count]

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
        from safetensors.torch import save_file

        config = {name: str(value) for name, value in asdict(self.config).items()}
        save_file({k: v.half().contiguous() for k, v in self.state_dict().items()}, path, config)

    @classmethod
    def load(cls, path: Path = SHIPPED_DYNAMICS) -> LstmDynamics:
        """Read what `save` wrote."""
        from safetensors import safe_open

        with safe_open(path, "pt") as file:
            written = file.metadata()
            weights = {name: file.get_tensor(name).float() for name in file.keys()}
        config = LstmConfig(
            **{name: type(default)(written[name]) for name, default in asdict(LstmConfig()).items()}
        )
        model = cls(config)
        model.load_state_dict(weights)
        return model.eval().requires_grad_(False)


def _rotate(vectors: Tensor, heading: Tensor, sign: int) -> Tensor:
    """Vectors (..., 3) turned about z by a heading (..., 2), its cosine and sine, or back (-1)."""
    x, y, z = vectors.unbind(-1)
    cos, sin = heading[..., 0], sign * heading[..., 1]
    return torch.stack([cos * x - sin * y, sin * x + cos * y, z], -1)
