"""Execution of plans by robots and arms (Sec. VI, VII-D).

A lab implements `Robot`; `Twin` simulates one. `execute` runs a plan on either: open loop, tracked
with MPPI, or replanned after each action from the rope's estimated state. `export_plan` makes
trajectories for an arm.

Names are imported on first use, see `__init__.pyi`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
