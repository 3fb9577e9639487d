"""Progress bars: alive on a terminal, a plain line now and then in a log file."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from typing import Any, TextIO

from tqdm import tqdm

LINE_EVERY = 10.0  # seconds between two lines where there is no terminal
LINE = "{desc}: {n_fmt}/{total_fmt} [{elapsed}<{remaining}, {rate_fmt}]"


class LineWriter:
    """A file for tqdm that makes each redrawing of the bar a line of its own."""

    def __init__(self, stream: TextIO) -> None:
        self.stream = stream

    def write(self, text: str) -> None:
        """Writes `text` as one line, without the bar's cursor movements."""
        if line := text.strip("\r\n "):
            self.stream.write(f"{line}\n")

    def flush(self) -> None:
        """Passes on."""
        self.stream.flush()


def progress(
    iterable: Iterable[Any] | None = None,
    *,
    total: int | None = None,
    desc: str | None = None,
    initial: int = 0,
    stream: TextIO | None = None,
    every: float = LINE_EVERY,
) -> tqdm:
    """A tqdm bar with the rate; without a terminal, a line at most every `every` seconds.

    Iterate over it, or call its `.update(n)`. `initial` counts what earlier attempts have done: it
    is shown but does not enter the rate.
    """
    stream = stream or sys.stderr
    if stream.isatty():
        return tqdm(iterable, total=total, desc=desc, initial=initial, file=stream)
    return tqdm(
        iterable,
        total=total,
        desc=desc or "progress",
        initial=initial,
        file=LineWriter(stream),
        mininterval=every,
        maxinterval=every,
        bar_format=LINE,
        position=0,  # nested bars would move a cursor that a log file does not have
    )
