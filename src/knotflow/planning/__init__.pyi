from .branches import SearchUpdate
from .check import KnotMismatchError, confirm, expected_type, knot_type
from .config import PlannerConfig
from .dag import SolutionDag, UnreachableGoalError
from .goals import Goal, NoRoomError, most_crossings, parse_goal
from .plan import KnotPlan, PlanStep, Tried
from .plan_file import PlanFormatError
from .rope_file import RopeInputError
from .ropes import ROPE_NAMES, lay_down, parse_rope, read_rope
from .tree import TreeSearch, plan_knot
from .waypoints import GripperConfig, Waypoints

__all__ = [
    "ROPE_NAMES",
    "Goal",
    "GripperConfig",
    "KnotMismatchError",
    "KnotPlan",
    "NoRoomError",
    "PlanFormatError",
    "PlanStep",
    "PlannerConfig",
    "RopeInputError",
    "SearchUpdate",
    "SolutionDag",
    "TreeSearch",
    "Tried",
    "UnreachableGoalError",
    "Waypoints",
    "confirm",
    "expected_type",
    "knot_type",
    "lay_down",
    "most_crossings",
    "parse_goal",
    "parse_rope",
    "plan_knot",
    "read_rope",
]
