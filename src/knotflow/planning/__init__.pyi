from .arranging import ArrangedAttempts, attempt_arranged
from .config import FAST_SEARCH, PlannerConfig, plan_name
from .dag import SearchGraph, SolutionDag, UnreachableGoalError
from .goals import Goal, NoRoomError, most_crossings, parse_goal
from .nodes import SearchUpdate
from .plan import ExpansionStats, KnotPlan, PlanFormatError, PlanStep
from .plan_rope import (
    RECORD_RATE,
    AlreadyTiedError,
    estimate_success,
    plan_rope,
    replay,
)
from .ropes import ROPE_NAMES, RopeInputError, lay_down, parse_rope, read_rope
from .tree import TreeSearch, plan_knot
from .validation import Penetration, StepCheck, check_steps, find_penetrations
from .waypoints import GripperConfig, Waypoints

__all__ = [
    "FAST_SEARCH",
    "RECORD_RATE",
    "ROPE_NAMES",
    "AlreadyTiedError",
    "ArrangedAttempts",
    "ExpansionStats",
    "Goal",
    "GripperConfig",
    "KnotPlan",
    "NoRoomError",
    "Penetration",
    "PlanFormatError",
    "PlanStep",
    "PlannerConfig",
    "RopeInputError",
    "SearchGraph",
    "SearchUpdate",
    "SolutionDag",
    "StepCheck",
    "TreeSearch",
    "UnreachableGoalError",
    "Waypoints",
    "attempt_arranged",
    "check_steps",
    "estimate_success",
    "find_penetrations",
    "lay_down",
    "most_crossings",
    "parse_goal",
    "parse_rope",
    "plan_knot",
    "plan_name",
    "plan_rope",
    "read_rope",
    "replay",
]
