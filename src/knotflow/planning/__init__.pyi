from .arranging import ArrangedAttempts, attempt_arranged
from .branches import SearchUpdate
from .check import KnotMismatchError, confirm, expected_type, knot_type
from .config import FAST_SEARCH, PlannerConfig
from .dag import SolutionDag, UnreachableGoalError
from .goals import Goal, NoRoomError, most_crossings, parse_goal
from .passing import StrandPassage, find_passages
from .plan import KnotPlan, PlanStep, Tried
from .plan_file import PlanFormatError
from .plan_rope import (
    RECORD_RATE,
    AlreadyTiedError,
    plan_name,
    plan_rope,
    replay,
    shipped_sampler,
    success_probability,
)
from .rope_file import RopeInputError
from .ropes import ROPE_NAMES, lay_down, parse_rope, read_rope
from .search_graph import SearchGraph
from .soundness import StepCheck, check_steps
from .tree import TreeSearch, plan_knot
from .waypoints import GripperConfig, Waypoints

__all__ = [
    "FAST_SEARCH",
    "RECORD_RATE",
    "ROPE_NAMES",
    "AlreadyTiedError",
    "ArrangedAttempts",
    "Goal",
    "GripperConfig",
    "KnotMismatchError",
    "KnotPlan",
    "NoRoomError",
    "StrandPassage",
    "PlanFormatError",
    "PlanStep",
    "PlannerConfig",
    "RopeInputError",
    "SearchGraph",
    "SearchUpdate",
    "SolutionDag",
    "StepCheck",
    "TreeSearch",
    "Tried",
    "UnreachableGoalError",
    "Waypoints",
    "attempt_arranged",
    "check_steps",
    "confirm",
    "expected_type",
    "find_passages",
    "knot_type",
    "lay_down",
    "most_crossings",
    "parse_goal",
    "parse_rope",
    "plan_knot",
    "plan_name",
    "plan_rope",
    "read_rope",
    "replay",
    "shipped_sampler",
    "success_probability",
]
