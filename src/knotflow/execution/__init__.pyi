from .arm import Arm, ArmError, Base, load_arm
from .export import Export, export_plan
from .franka import panda
from .reach import Reached, follow_waypoints
from .timing import JointTrajectory, time_joints

__all__ = [
    "Arm",
    "ArmError",
    "Base",
    "Export",
    "JointTrajectory",
    "Reached",
    "export_plan",
    "load_arm",
    "panda",
    "follow_waypoints",
    "time_joints",
]
