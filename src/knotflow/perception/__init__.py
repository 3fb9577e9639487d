"""Perception: the rope's state from RGB-D images (paper Sec. VI).

A name is loaded when it is used, from the file that `__init__.pyi` gives.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
