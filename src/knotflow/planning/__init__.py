"""Planning: a tree search from a rope as it lies to a tied knot (paper Sec. V-B d).

`plan_rope` returns a `KnotPlan` for a rope and a knot's name. Names are imported on first use, see
`__init__.pyi`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
