"""How much memory a stage takes at its peak, its workers included."""

from __future__ import annotations

import threading
from contextlib import suppress
from typing import Any

EVERY = 0.5  # seconds between two looks; what is shorter may be missed


class PeakMemory:
    """The most resident memory that this process and those it started held at once, in MB.

    Within `with` it looks every now and then, from a thread of its own. Pages that processes share
    count for each; workers on other machines are not seen.
    """

    def __init__(self) -> None:
        self.megabytes = 0.0
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._watch, daemon=True)

    def __enter__(self) -> PeakMemory:
        self._thread.start()
        return self

    def __exit__(self, *exception: Any) -> None:
        self._over.set()
        self._thread.join()
        self._look()

    def _watch(self) -> None:
        self._look()
        while not self._over.wait(EVERY):
            self._look()

    def _look(self) -> None:
        import psutil

        own = psutil.Process()
        held = 0
        for process in (own, *own.children(recursive=True)):
            with suppress(psutil.Error):  # it has ended meanwhile
                held += process.memory_info().rss
        self.megabytes = max(self.megabytes, held / 1e6)
