"""The rope in MuJoCo: its model, the 6-D spline, batched execution, and start shapes."""

from knotflow.simulation.attempt import Attempts, Observer, attempt, state_or_none
from knotflow.simulation.rope import (
    ROOTS,
    RopeConfig,
    ShapeError,
    build_model,
    check_points,
    pose,
)
from knotflow.simulation.simulator import Rollouts, RopeSimulator, SimulationConfig
from knotflow.simulation.spline import (
    SPLINE_HIGH,
    SPLINE_LOW,
    SPLINE_NAMES,
    SplineError,
    check_splines,
    clip_splines,
    control_points,
    grasped_link,
    spline_path,
)
from knotflow.simulation.starts import (
    Starts,
    StartsConfig,
    arc,
    is_roomy,
    random_curve,
    reached,
    resample,
    straight,
)

__all__ = [
    "ROOTS",
    "SPLINE_HIGH",
    "SPLINE_LOW",
    "SPLINE_NAMES",
    "Attempts",
    "Observer",
    "Rollouts",
    "RopeConfig",
    "RopeSimulator",
    "ShapeError",
    "SimulationConfig",
    "SplineError",
    "Starts",
    "StartsConfig",
    "arc",
    "attempt",
    "build_model",
    "check_points",
    "check_splines",
    "clip_splines",
    "control_points",
    "grasped_link",
    "is_roomy",
    "pose",
    "random_curve",
    "reached",
    "resample",
    "spline_path",
    "state_or_none",
    "straight",
]
