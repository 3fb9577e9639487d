"""Perception: the rope's state from RGB-D images (paper Sec. VI).

A name is loaded when it is used, from the file that `__init__.pyi` gives.
"""

from pathlib import Path

import lazy_loader

SHIPPED_NETWORK = Path(__file__).parent / "data" / "network.safetensors"
"""The weights that come with the package."""

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
