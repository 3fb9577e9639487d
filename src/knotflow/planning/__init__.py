"""Planning: a tree search from a rope as it lies to a tied knot (paper Sec. V-B d).

`plan_rope` returns a `KnotPlan` for a rope and a knot's name. A name is loaded when it is used,
from the file that `__init__.pyi` gives.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
