"""Training of the primitives (Sec. V-B a to c): imitation, reinforcement, joint finetuning.

A name is loaded when it is used, from the file that `__init__.pyi` gives: PyTorch takes seconds.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
