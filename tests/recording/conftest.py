"""A rope whose middle is dragged along a spline: smooth, cheap, and good enough to record."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from knotflow.recording import RecordedRollout
from knotflow.simulation import spline_path


def dragged_rope(number: int, frames: int = 26, vertices: int = 41, **changes: Any):
    """Rollout `number`: every number of it differs from that of any other."""
    rng = np.random.default_rng(number)
    along = np.linspace(0.0, 1.0, vertices)
    rest = np.stack([along - 0.5, 0.1 * np.sin(6 * along + number), np.full(vertices, 0.008)], 1)
    grasp = rng.uniform(0.1, 0.9)
    first = np.array([np.interp(grasp, along, rest[:, axis]) for axis in range(3)])
    middle = rng.uniform([-0.2, -0.2, 0.1], [0.2, 0.2, 0.3])
    end = np.array([*rng.uniform(-0.4, 0.4, 2), 0.008])
    controls = np.stack([first, middle, end])
    gripper = spline_path(controls, np.linspace(0.0, 1.0, frames))
    near = np.exp(-(((along - grasp) / 0.15) ** 2))
    points = rest + near[None, :, None] * (gripper - first)[:, None, :]
    points += rng.normal(size=points.shape) * 1e-6  # a simulator's last bits are never alike
    rollout = RecordedRollout(
        times=0.25 + np.linspace(0.0, 2.5, frames),
        points=points,
        gripper=gripper,
        control_points=controls,
        spline=np.array([grasp, *middle, *end[:2]]),
        action="C(0,1,1)",
        start_state="[(2,1,+1)]",
        goal_state="[(1,3,+1),(4,2,+1)]",
        end_state="[(1,3,+1),(4,2,+1)]" if number % 2 else "",
        outcome="success" if number % 2 else "failure",
        signature="0123abcd",
        source="scripted",
        number=number,
        extra={"demonstration": str(number)},
    )
    return replace(rollout, **changes)


@pytest.fixture
def make_rollout() -> Callable[..., RecordedRollout]:
    return dragged_rope


@pytest.fixture
def assert_same() -> Callable[[RecordedRollout, RecordedRollout], None]:
    """Bit for bit, in every field."""

    def check(first: RecordedRollout, second: RecordedRollout) -> None:
        for name in ("times", "points", "gripper", "control_points", "spline"):
            one, other = getattr(first, name), getattr(second, name)
            assert one.dtype == other.dtype
            np.testing.assert_array_equal(one, other, err_msg=name)
        texts = ("action", "start_state", "goal_state", "end_state", "outcome", "signature")
        for name in (*texts, "source", "number", "extra"):
            assert getattr(first, name) == getattr(second, name)

    return check
