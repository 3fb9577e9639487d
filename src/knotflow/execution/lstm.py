"""The learned dynamics of a rope: a bidirectional LSTM over its vertices, as in [15] (Sec. VI).

Where a vertex goes depends on the whole rope, and mostly along it: from the grasp to both ends. So
an LSTM reads the vertices in both directions, and each vertex's states say how far it moves in the
next step: a share of the gripper's displacement, a share of its own velocity, and a residual. All
is seen from the grasped link, along its direction, so that the prediction turns with the rope.
Predicted links are then brought back towards their length, which a long rollout would lose
otherwise.
"""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import torch
from torch import Tensor, nn

from knotflow.execution.dynamics import grasped_at_each_step
from knotflow.execution.rope_motions import FREE, STEP
from knotflow.execution.training_config import SHIPPED_DYNAMICS, LstmConfig
from knotflow.threads import one_thread


class LstmDynamics(nn.Module):
    """See `RopeDynamics`."""

    def __init__(self, config: LstmConfig | None = None) -> None:
        super().__init__()
        self.config = config = config or LstmConfig()
        self.read = nn.Sequential(nn.Linear(_FEATURES, config.hidden), nn.SiLU())
        self.lstm = nn.LSTM(
            config.hidden, config.hidden, config.layers, batch_first=True, bidirectional=True
        )
        self.out = nn.Linear(2 * config.hidden, 5)
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
        tangents = points.diff(dim=1)
        turn = _heading(tangents.gather(1, link[..., None].expand(-1, -1, 3))[:, 0])
        pull = ((gripper[:, None] - centre) * held[..., None]) @ turn
        velocities = velocities @ turn
        features = [
            (points - centre) @ turn / _POSITION,
            points[..., 2:] / _HEIGHT,
            nn.functional.pad(tangents @ turn, (0, 0, 0, 1)) * self.config.links,
            velocities * STEP / _DISPLACEMENT,
            (pull / _DISPLACEMENT).expand_as(points),
            (place - link)[..., None] / count,
            flag[..., None],
            held[..., None].expand(-1, count, 1),
        ]
        out = self.out(self.lstm(self.read(torch.cat(features, -1)))[0])
        moved = _DISPLACEMENT * out[..., :3] + out[..., 3:4] * pull
        moved = moved + out[..., 4:] * velocities * STEP
        return self._with_links(points + moved @ turn.transpose(1, 2))

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
            back = nn.functional.pad(excess, (0, 0, 0, 1)) - nn.functional.pad(excess, (0, 0, 1, 0))
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


def _heading(direction: Tensor) -> Tensor:
    """Rotations (B, 3, 3) about z; their columns are the axes of a frame whose x axis points along
    directions (B, 3) as seen from above."""
    across = direction[:, :2]
    x, y = (across / across.norm(dim=-1, keepdim=True).clamp(min=1e-6)).unbind(-1)
    zero = torch.zeros_like(x)
    return torch.stack([x, -y, zero, y, x, zero, zero, zero, zero + 1], -1).view(-1, 3, 3)


_FEATURES = 16
_POSITION = 0.2  # metres; features are of size 1 or so
_HEIGHT = 0.02
_DISPLACEMENT = 0.05
_RELAXATION = 0.25  # of a link's excess per pass, at each end
