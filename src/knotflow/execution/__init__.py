"""Execution: a plan tied by a robot, open loop or tracked with MPPI (Sec. VI), and its stand-in.

A lab implements `Robot`; `Twin` is one in simulation. `execute` runs a plan on either.

A name is loaded when it is used, from the file that `__init__.pyi` gives: PyTorch takes seconds.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
