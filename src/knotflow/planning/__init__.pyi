from .config import FAST_SEARCH, PlannerConfig, plan_name
from .goals import (
    Goal,
    SearchGraph,
    SolutionDag,
    UnreachableGoalError,
    most_crossings,
    parse_goal,
)
from .plan import KnotPlan, PlanFormatError, PlanStep
from .proposals import attempt_arranged
from .ropes import ROPE_NAMES, RopeInputError, lay_down, parse_rope, read_rope
from .tree import SearchUpdate, TreeSearch, plan_knot, plan_rope
from .validation import (
    check_steps,
    estimate_success,
    find_penetrations,
    replay,
)
from .waypoints import GripperConfig, Waypoints

__all__ = [
    "FAST_SEARCH", "ROPE_NAMES", "Goal", "GripperConfig", "KnotPlan", "PlanFormatError", "PlanStep",
    "PlannerConfig", "RopeInputError", "SearchGraph", "SearchUpdate", "SolutionDag", "TreeSearch",
    "UnreachableGoalError", "Waypoints", "attempt_arranged", "check_steps", "estimate_success",
    "find_penetrations", "lay_down", "most_crossings", "parse_goal", "parse_rope", "plan_knot",
    "plan_name", "plan_rope", "read_rope", "replay",
]  # fmt: skip
