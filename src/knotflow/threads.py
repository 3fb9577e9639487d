"""CPUs to use, and PyTorch on one thread: faster for small networks, and the same everywhere."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from threading import Lock

_lock = Lock()
_open: list[int] = []
"""For each block that is open, the number of threads before the first of them."""


def cpus() -> int:
    """CPUs that this process may use: fewer than the machine has in a container, or a job of a
    cluster."""
    from joblib import cpu_count

    return int(cpu_count())


@contextmanager
def one_thread() -> Iterator[None]:
    """PyTorch on one thread in the block, if it was imported: stages do so with their module.

    The number of threads before is put back when the last of overlapping blocks ends.
    `@one_thread()` decorates functions, too.
    """
    torch = sys.modules.get("torch")
    if torch is None:
        yield
        return
    with _lock:
        _open.append(_open[0] if _open else torch.get_num_threads())
        torch.set_num_threads(1)
    try:
        yield
    finally:
        with _lock:
            before = _open.pop()
            if not _open:
                torch.set_num_threads(before)
