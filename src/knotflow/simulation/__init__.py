"""The rope in MuJoCo: its model, the 6-D spline, batched execution, and start shapes."""

from knotflow.simulation.attempt import (
    Attempts,
    Observer,
    Trials,
    attempt,
    end_states,
    state_or_none,
)
from knotflow.simulation.proportions import (
    NOMINAL,
    ProportionsConfig,
    draw_ropes,
    rope_of,
    usual_links,
)
from knotflow.simulation.rope import RopeConfig, ShapeError, build_model, check_points, pose
from knotflow.simulation.simulator import Motion, Rollouts, RopeSimulator, SimulationConfig
from knotflow.simulation.spline import (
    SPLINE_HIGH,
    SPLINE_LOW,
    SplineError,
    check_splines,
    clip_splines,
    control_points,
    grasped_link,
    spline_basis,
    spline_path,
)
from knotflow.simulation.starts import (
    StartsConfig,
    arc,
    is_roomy,
    random_curve,
    random_tangle,
    random_trials,
    reach_starts,
    resample,
    straight,
)
from knotflow.simulation.worlds import (
    EXPONENTS,
    GRASP_REACH,
    GRIPPER_ERROR_STD,
    LEVELS,
    World,
    WorldsConfig,
    draw_worlds,
    nearest_link,
    perturb_rope,
)
