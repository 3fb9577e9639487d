"""The learned dynamics of a rope: a bidirectional LSTM over its vertices, as in [15] (Sec. VI).

Where a vertex goes depends on the whole rope, and mostly along it: from the grasp to both ends. So
an LSTM reads the vertices in both directions, a few neighbours at a time, and its states say how
far each moves in the next step: a share of the gripper's displacement, a share of its own velocity,
and a residual. A dragged rope follows itself, so each vertex sees all of this, and moves, in a
frame whose x axis is its own heading; and the prediction turns with the rope. After 7 minutes of
training on one core that was off by 14.6 mm after a second; all vertices in the frame of the
grasped link, one at a time, by 18.6. Predicted links are then brought back towards their
length, which a long rollout would lose otherwise.
"""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import torch
from torch import Tensor, nn
from torch.nn.functional import pad

from knotflow.execution.dynamics import grasped_at_each_step
from knotflow.execution.rope_motions import FREE, STEP
from knotflow.execution.training_config import SHIPPED_DYNAMICS, LstmConfig
from knotflow.threads import one_thread


class LstmDynamics(nn.Module):
    """See `RopeDynamics`."""

    def __init__(self, config: LstmConfig | None = None) -> None:
        super().__init__()
        self.config = config = config or LstmConfig()
        self.read = nn.Sequential(nn.Linear(_FEATURES * config.group, config.hidden), nn.SiLU())
        self.lstm = nn.LSTM(
            config.hidden, config.hidden, config.layers, batch_first=True, bidirectional=True
        )
        self.out = nn.Linear(2 * config.hidden, _OUTPUTS * config.group)
        nn.init.zeros_(self.out.weight)
        nn.init.zeros_(self.out.bias)

    def forward(
        self, points: Tensor, velocities: Tensor, grasped: Tensor, gripper: Tensor
    ) -> Tensor:
        """Vertices (B, V, 3) after one step, at whose end the gripper is at `gripper` (B, 3)."""
        held = (grasped != FREE).float()[:, None]  # (B, 1)
        count = points.shape[1]
        link = torch.where(grasped == FREE, (count - 1) // 2, grasped)[:, None]
        place = torch.arange(count, device=points.device)
        flag = ((place == link) | (place == link + 1)).float()  # (B, V)
        centre = (flag[..., None] * points).sum(1, keepdim=True) / 2  # (B, 1, 3)
        links = points.diff(dim=1)
        onward, behind = torch.cat([links, links[:, -1:]], 1), torch.cat([links[:, :1], links], 1)
        heading = _heading(onward + behind)
        pull = ((gripper[:, None] - centre) * held[..., None]).expand_as(points)
        pull, speed = _turned(pull, heading, -1), _turned(velocities, heading, -1)
        away = ((place - link) / count)[..., None]
        features = [
            _turned(points - centre, heading, -1) / _POSITION,
            points[..., 2:] / _HEIGHT,
            _turned(onward, heading, -1) * self.config.links,
            _turned(behind, heading, -1) * self.config.links,
            speed * STEP / _DISPLACEMENT,
            pull / _DISPLACEMENT,
            away,
            away.abs(),
            flag[..., None],
            held[..., None].expand(-1, count, 1),
            pull.norm(dim=-1, keepdim=True) / _DISPLACEMENT,
            speed.norm(dim=-1, keepdim=True) * STEP / _DISPLACEMENT,
        ]
        out = self._read_along(torch.cat(features, -1))
        moved = _DISPLACEMENT * out[..., :3] + out[..., 3:4] * pull + out[..., 4:] * speed * STEP
        return self._with_links(points + _turned(moved, heading, 1))

    def _read_along(self, features: Tensor) -> Tensor:
        """(B, V, outputs) of features (B, V, features), a group of neighbours at a time."""
        rows, count, size = features.shape
        group = self.config.group
        grouped = pad(features, (0, 0, 0, -count % group)).reshape(rows, -1, group * size)
        out: Tensor = self.out(self.lstm(self.read(grouped))[0])
        return out.reshape(rows, -1, _OUTPUTS)[:, :count]

    @one_thread()
    def predict(
        self, points: Tensor, velocities: Tensor, grasped: Tensor, gripper: Tensor
    ) -> Tensor:
        """See `RopeDynamics`."""
        points, velocities, gripper = points.float(), velocities.float(), gripper.float()
        grasped = grasped_at_each_step(grasped, gripper.shape[1])
        ahead = []
        for step in range(gripper.shape[1]):
            moved = self(points, velocities, grasped[:, step], gripper[:, step])
            points, velocities = moved, (moved - points) / STEP
            ahead.append(points)
        return torch.stack(ahead, 1)

    def _with_links(self, points: Tensor) -> Tensor:
        """Vertices (B, V, 3) whose links are closer to their length; both ends give way alike."""
        length = self.config.length / self.config.links
        for _ in range(self.config.straightening):
            link = points.diff(dim=1)
            size = link.norm(dim=-1, keepdim=True).clamp(min=1e-6)
            excess = link * (1 - length / size)
            back = pad(excess, (0, 0, 0, 1)) - pad(excess, (0, 0, 1, 0))
            points = points + _RELAXATION * back
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


def _heading(directions: Tensor) -> Tensor:
    """Cosine and sine (..., 2) of the angle about z of directions (..., 3), as seen from above."""
    across = directions[..., :2]
    return across / across.norm(dim=-1, keepdim=True).clamp(min=1e-6)


def _turned(vectors: Tensor, heading: Tensor, way: int) -> Tensor:
    """Vectors (..., 3) turned about z by a heading (..., 2), or back from it where `way` is -1."""
    x, y, z = vectors.unbind(-1)
    cos, sin = heading[..., 0], way * heading[..., 1]
    return torch.stack([cos * x - sin * y, sin * x + cos * y, z], -1)


_FEATURES, _OUTPUTS = 22, 5  # of a vertex
_POSITION = 0.2  # metres; features are of size 1 or so
_HEIGHT = 0.02
_DISPLACEMENT = 0.05
_RELAXATION = 0.25  # of a link's excess per pass, at each end
