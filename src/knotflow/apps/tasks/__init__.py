"""Tying as a task for others' methods: environments, a public set of ropes, a leaderboard.

`TieEnv` is the Gymnasium environment "knotflow/Tie-v0", `BatchedTieEnv` the same for many ropes at
once in TorchRL; both are thin around `Episodes`. `public_tasks` are the ropes and goals on which
methods are compared, and `leaderboard` measures them. The two environments need the extra `gym` and
TorchRL respectively; a name is loaded when it is used, from the file that `__init__.pyi` gives.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
