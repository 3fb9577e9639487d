"""PyTorch on one thread while a stage runs: faster for networks this small, and repeatable.

On more threads PyTorch adds in another order, so a spline differs in its last digits, and a rope
that is simulated for long differs in its shape. A stage's output must not depend on the machine's
cores, nor on whether it is made in the command's own process or in a worker.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def one_thread() -> Iterator[None]:
    """PyTorch on one thread in the block, if it was imported: stages do so with their module."""
    torch = sys.modules.get("torch")
    if torch is None:
        yield
        return
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)
