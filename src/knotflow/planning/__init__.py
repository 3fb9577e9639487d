"""Planning: a tree search from a rope as it lies to a tied knot (paper Sec. V-B d).

`parse_goal` and `parse_rope` read what to tie into what, `plan_knot` searches and returns a
`KnotPlan`, which gives timed gripper waypoints and JSON. `confirm` has an independent library tell
the tied rope's knot type. Pictures load matplotlib, so they are imported by file:
`planning.draw.draw_plan`, `planning.animate.animate_plan`, `planning.draw_dag.draw_dag`.
"""

from knotflow.planning.branches import SearchUpdate
from knotflow.planning.check import KnotMismatchError, confirm, expected_type, knot_type
from knotflow.planning.dag import SolutionDag, UnreachableGoalError
from knotflow.planning.goals import Goal, NoRoomError, most_crossings, parse_goal
from knotflow.planning.growth import PlannerConfig
from knotflow.planning.plan import KnotPlan, PlanStep, Tried
from knotflow.planning.plan_file import PlanFormatError
from knotflow.planning.ropes import ROPE_NAMES, RopeInputError, lay_down, parse_rope, read_rope
from knotflow.planning.tree import TreeSearch, plan_knot
from knotflow.planning.waypoints import GripperConfig, Waypoints

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
