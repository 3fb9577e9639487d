"""Model predictive path integral control of the gripper that drags a rope (Sec. VI).

MPPI (Williams et al., 2017) by pytorch-mppi, on learned dynamics. An action is added to the planned
displacement of a tick, so that the planned spline is the zero action; sequences are drawn at a few
knots. The reference is the model's prediction of the planned rope under the planned motion, so that
the model's own error is not corrected for.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from pytorch_mppi.mppi import KMPPI, RBFKernel
from torch import Tensor

from knotflow.execution.dynamics import RopeDynamics
from knotflow.execution.motions import STEP
from knotflow.threads import one_thread

CM2 = 1e4  # square centimetres of a square metre
BOUNDARY_COST = 100.0


@dataclass(frozen=True)
class MppiConfig:
    """Sampling and costs."""

    samples: int = 64  # action sequences of a tick
    horizon: int = 6  # ticks looked ahead
    knots: int = 2  # ticks among them at which actions are drawn
    spread: tuple[float, float, float] = (0.003, 0.003, 0.001)
    """Standard deviation of the actions in x, y and z, metres a tick."""
    bound: float = 0.015  # of an action along each axis, metres a tick
    temperature: float = 1.0  # of the weights; costs in square centimetres sum over the horizon
    effort: float = 0.02  # cost of an action, relative to the same deviation of the rope
    terminal: float = 2.0  # relative cost of the last tick's deviation
    reach: float = 0.65  # of the gripper from the middle along x and y, metres
    table: float = 0.005  # least height of the gripper, metres
    seed: int = 0  # of the sampled actions


class Mppi:
    """A `Controller`: keeps the rope near the planned one, with a weight for each vertex."""

    def __init__(self, dynamics: RopeDynamics, config: MppiConfig | None = None) -> None:
        self.dynamics, self.config = dynamics, config or MppiConfig()

    def begin(self, reference: NDArray, path: NDArray, weights: NDArray, grasped: int) -> None:
        config = self.config
        self._path = np.asarray(path, np.float64)
        planned = torch.from_numpy(self._path.astype(np.float32))
        self._steps = torch.diff(planned, dim=0, append=planned[-1:])  # at its end it stays
        self._weights = torch.from_numpy(np.asarray(weights, np.float32))
        self._grasped, self._tick = grasped, 0
        self._vertices = len(weights)
        self._expected = self._predict_plan(torch.from_numpy(np.asarray(reference, np.float32)))
        bound = torch.full((3,), config.bound)
        self._planner = KMPPI(
            self._next,
            self._cost,
            nx=6 * self._vertices + 3,
            noise_sigma=torch.diag(torch.tensor(config.spread) ** 2),
            num_samples=config.samples,
            horizon=config.horizon,
            terminal_state_cost=self._terminal,
            lambda_=config.temperature,
            u_min=-bound,
            u_max=bound,
            U_init=torch.zeros(config.horizon, 3),
            step_dependent_dynamics=True,
            num_support_pts=config.knots,
            kernel=RBFKernel(config.horizon / config.knots),
        )

    @one_thread()
    def act(self, points: NDArray, velocities: NDArray, gripper: NDArray) -> NDArray:
        # The rope hangs where it was caught: what is dragged is the link, not the fingertips.
        centre = (points[self._grasped] + points[self._grasped + 1]) / 2
        state = torch.from_numpy(np.concatenate([points.ravel(), velocities.ravel(), centre]))
        with torch.no_grad(), torch.random.fork_rng(devices=[]):
            torch.manual_seed(self.config.seed + self._tick)
            action = self._planner.command(state.float(), self._tick > 0)
        action = action.clamp(-self.config.bound, self.config.bound)  # knots overshoot
        if self._tick == 0:
            self._aside = gripper - self._path[0]
        self._tick += 1
        # Not from where the gripper is measured in each tick: its errors would add up.
        self._aside = self._aside + action.numpy().astype(np.float64)
        place = self._path[min(self._tick, len(self._path) - 1)] + self._aside
        reach = self.config.reach
        low, high = [-reach, -reach, self.config.table], [reach, reach, np.inf]
        return np.clip(place, low, high)

    @one_thread()
    def _predict_plan(self, points: Tensor) -> Tensor:
        """Predictions (T, horizon + 1, V, 3) from each frame of the planned rope (T, V, 3)."""
        with torch.no_grad():
            velocities = torch.diff(points, dim=0, prepend=points[:1]) / STEP
            gripper = (points[:, self._grasped] + points[:, self._grasped + 1]) / 2
            frames, shapes = torch.arange(len(points)), [points]
            for ahead in range(self.config.horizon):
                gripper = gripper + self._steps[(frames + ahead).clamp(max=len(self._steps) - 1)]
                points, velocities = self._predict(points, velocities, gripper)
                shapes.append(points)
        return torch.stack(shapes, 1)

    def _predict(
        self, points: Tensor, velocities: Tensor, gripper: Tensor
    ) -> tuple[Tensor, Tensor]:
        """The rope's vertices and velocities (K, V, 3) when the gripper is at (K, 3), a tick on."""
        held = torch.full((len(points),), self._grasped)
        moved = self.dynamics.predict(points, velocities, held, gripper[:, None])[:, 0]
        return moved, (moved - points) / STEP

    def _frame(self, ahead: int) -> int:
        """Index of the planned frame that many ticks ahead."""
        return min(self._tick + ahead, len(self._steps) - 1)

    def _next(self, states: Tensor, actions: Tensor, step: int) -> Tensor:
        points, velocities, gripper = self._split(states)
        gripper = gripper + self._steps[self._frame(step)] + actions
        points, velocities = self._predict(points, velocities, gripper)
        return torch.cat([points.flatten(1), velocities.flatten(1), gripper], 1)

    def _cost(self, states: Tensor, actions: Tensor, step: int) -> Tensor:
        config = self.config
        points, _, gripper = self._split(states)
        outside = (gripper[:, :2].abs() - config.reach).clamp(min=0).sum(1)
        below = (config.table - gripper[:, 2]).clamp(min=0)
        return (
            self._deviation(points, step + 1)
            + config.effort * actions.square().sum(1) * CM2
            + (outside + below).square() * CM2 * BOUNDARY_COST
        )

    def _terminal(self, states: Tensor, actions: Tensor) -> Tensor:
        """States (1, K, H, nx) -> (K,)."""
        points, _, _ = self._split(states[0, :, -1])
        return self.config.terminal * self._deviation(points, self.config.horizon)

    def _deviation(self, points: Tensor, ahead: int) -> Tensor:
        """Weighted mean square distance (K,) from the reference, square centimetres."""
        square = (points - self._expected[self._frame(0), ahead]).square().sum(-1)
        return (square * self._weights).mean(1) * CM2

    def _split(self, states: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Vertices and velocities (K, V, 3), and the dragged link's centre (K, 3)."""
        size = 3 * self._vertices
        points, velocities, gripper = states.split([size, size, 3], dim=1)
        return points.unflatten(1, (-1, 3)), velocities.unflatten(1, (-1, 3)), gripper
