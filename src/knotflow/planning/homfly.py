"""topoly's knot types, from a process of its own: line for line.

topoly 1.2 closes descriptor 0 whenever it works out a polynomial. In a process that does anything
else, that is a file which another thread has just opened, or the pipe of a pool of workers.
"""

from __future__ import annotations

import atexit
import json
import os
import subprocess
import sys
import threading
from importlib.util import find_spec
from itertools import chain
from math import isfinite

MOST_CROSSINGS = 40
"""Of the closed curve as topoly projects it; of more, its answer is "TMC", too many. Its default of
15 is too few for a pentagram at rest."""

_lock = threading.Lock()
_child: tuple[int, subprocess.Popen[str]] | None = None  # with the process that started it


def homfly_type(curve: list[list[float]]) -> str:
    """The knot type of a closed curve [[x, y, z], ...], the last point the first.

    Raises:
        ValueError: a coordinate is not finite; topoly would never answer.
        ModuleNotFoundError: topoly, of the extra `test`, is not installed.
        RuntimeError: topoly failed; says how.
    """
    if find_spec("topoly") is None:
        raise ModuleNotFoundError(
            "confirming a knot's type needs topoly: pip install 'knotflow[test]'"
        )
    if not all(map(isfinite, chain.from_iterable(curve))):
        raise ValueError("a knot's type is that of a curve of finite points")
    with _lock:
        child = _started()
        assert child.stdin is not None and child.stdout is not None
        try:
            child.stdin.write(json.dumps(curve) + "\n")
            child.stdin.flush()
            answer = child.stdout.readline()
        except OSError:
            answer = ""
        if not answer:
            raise RuntimeError(f"topoly's process ended with code {child.wait()}")
    found = json.loads(answer)
    if "error" in found:
        raise RuntimeError(f"topoly: {found['error']}")
    return str(found["type"])


def _started() -> subprocess.Popen[str]:
    global _child
    if _child is None or _child[0] != os.getpid() or _child[1].poll() is not None:
        child = subprocess.Popen(
            [sys.executable, "-P", __file__],  # not what lies beside this file
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        atexit.register(_end, child)
        _child = os.getpid(), child
    return _child[1]


def _end(child: subprocess.Popen[str]) -> None:
    """The child ends with its input."""
    if child.stdin is not None:
        child.stdin.close()
    child.wait()


def _answer() -> None:
    """Until the input ends, which it also does with the process that asks."""
    asked, answers = os.fdopen(os.dup(0)), os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # what topoly prints is no answer
    from topoly import homfly
    from topoly.params import Closure

    for line in asked:
        try:
            found = homfly(
                json.loads(line),
                closure=Closure.CLOSED,
                chiral=True,
                max_cross=MOST_CROSSINGS,
                # Its default forks a pool even for a single curve.
                run_parallel=False,
            )
            answer = {"type": str(found)}
        except Exception as error:  # whatever it is, the other process reports it
            answer = {"error": repr(error)}
        answers.write(json.dumps(answer) + "\n")
        answers.flush()


if __name__ == "__main__":
    _answer()
