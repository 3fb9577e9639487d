from .certainty import SurvivalConfig
from .config import FAST_SEARCH, PlannerConfig, RopeOptions, plan_name
from .fingers import HandConfig
from .frame import Frame, Placement
from .goals import Goal, SolutionDag, UnreachableGoalError, parse_goal
from .hand import Hand, Reach
from .plan import KnotPlan, PlanFormatError, PlanStep
from .planner import plan_rope
from .proposals import attempt_arranged
from .rope.files import ROPE_NAMES, RopeInputError, RopeTable
from .rope.measured import MeasuredRope, lay_down, measured_rope, parse_rope, read_rope
from .survival import SurvivalSearch, surviving
from .tree import SearchStoppedError, SearchUpdate, TreeSearch, plan_knot
from .validation import check_steps, find_penetrations, replay
from .waypoints import GripperConfig, Waypoints

__all__ = [
    "FAST_SEARCH", "ROPE_NAMES", "Frame", "Goal", "GripperConfig", "Hand", "HandConfig",
    "KnotPlan", "MeasuredRope", "Placement", "PlanFormatError", "PlanStep", "PlannerConfig",
    "Reach", "RopeInputError", "RopeOptions", "RopeTable", "SearchStoppedError", "SearchUpdate",
    "SolutionDag", "SurvivalConfig", "SurvivalSearch", "TreeSearch", "UnreachableGoalError",
    "Waypoints",
    "attempt_arranged", "check_steps", "find_penetrations", "lay_down", "measured_rope",
    "parse_goal", "parse_rope", "plan_knot", "plan_name", "plan_rope", "read_rope", "replay",
    "surviving",
]  # fmt: skip
