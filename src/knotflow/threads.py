"""PyTorch on one thread, in stages and samplers: faster for networks this small, and repeatable.

Beside another busy process two threads wait for each other more than they compute: a search then
simulates a tenth of its branches. And on more threads PyTorch adds in another order, so a spline
differs in its last digits, and a rope that is simulated for long differs in its shape. A stage's
output must not depend on the machine's cores, nor on whether it is made in the command's own
process or in a worker.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def one_thread() -> Iterator[None]:
    """PyTorch on one thread in the block, if it was imported: stages do so with their module.

    The number of threads before is put back. `@one_thread()` decorates functions, too.
    """
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
