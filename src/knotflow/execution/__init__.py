"""Execution: from a plan to a robot's hands (Sec. VI, VII-D).

A lab implements `Robot`; `Twin` is one in simulation. `execute` runs a plan on either: open loop,
tracked with MPPI, or replanned after each action from what is seen of the rope; `export_plan` makes
trajectories for an arm.

A name is loaded when it is used, from the file that `__init__.pyi` gives: PyTorch, MuJoCo and mink
take seconds.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
