"""Samplers propose splines for an action: one interface, and every method of the paper.

`random`, `icp` and `causal_infogan` are the baselines of Sec. VII, `primitives` the learned motion
primitives of Sec. V, "aimed" a scripted heuristic, `demonstrations` the data to learn from.

Names are imported when they are used, from the modules that `__init__.pyi` gives.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
