"""Shards on two workers that never end by themselves, run as `python killable_workers.py FOLDER`.

Each leaves a file named after the process it is made in.
"""

from __future__ import annotations

import os
import sys
import time
from functools import partial
from pathlib import Path

from knotflow.workflow.workers import WorkersConfig, each


def work(folder: Path, shard: str) -> None:
    """Sleeps until it is killed."""
    (folder / f"{os.getpid()}").write_text(shard)
    time.sleep(600.0)


if __name__ == "__main__":
    list(each(partial(work, Path(sys.argv[1])), ["a", "b", "c", "d"], WorkersConfig("loky", 2)))
