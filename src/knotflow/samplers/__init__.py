"""What proposes splines for an action: one interface, and every method of the paper.

`random`, `icp` and `causal_infogan` are the baselines of Sec. VII, `primitives` the learned motion
primitives of Sec. V, `aimed` a scripted guess, `demonstrations` what they learn from.

A name is loaded when it is used, from the file that `__init__.pyi` gives.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
