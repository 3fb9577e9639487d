"""Perception: the rope's state from RGB-D images and photographs (paper Sec. VI).

Names are imported on first use, see `__init__.pyi`.
"""

from pathlib import Path

import lazy_loader

SHIPPED_NETWORK = Path(__file__).parent / "data" / "network.safetensors"
"""The weights that come with the package."""

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
