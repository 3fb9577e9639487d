"""A stage of slow little shards on two workers, run as `python killable.py RESULTS_DIR SHARDS`."""

from __future__ import annotations

import sys
import time
from pathlib import Path

from knotflow.workflow import StageRun, WorkersConfig, read_workflow, run_workflow, stage


@stage
def toy_slow(run: StageRun, *, shards: int) -> None:
    """Each shard takes a few milliseconds, half of them with half a file on the disk."""
    names = [f"{index:03d}" for index in range(shards)]

    def write_slowly(name: str) -> None:
        with run.atomic(f"{name}.txt") as path, path.open("w") as file:
            for half in ("begin", "end"):
                file.write(f"{half} {name}\n")
                file.flush()
                time.sleep(0.002)

    run.each(write_slowly, run.pending(names, ".txt"), "shards")


if __name__ == "__main__":
    workflow = {
        "name": "killable",
        "stages": {"toy_slow": {"shards": int(sys.argv[2])}},
        "results": {"first.txt": "toy_slow/000.txt"},
    }
    run_workflow(
        read_workflow({"workflow": workflow}, Path()),
        Path(sys.argv[1]),
        workers=WorkersConfig(jobs=1),
    )
