"""A workflow of slow little shards, run as `python killable.py RESULTS_DIR SHARDS`."""

from __future__ import annotations

import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from knotflow.workflow import CodeState, StageContext, StageNode, Workflow, run, stage


@dataclass
class Config:
    """Config of `toy_slow`."""

    shards: int = 1


@stage("toy_slow", version=1)
def slow(config: Config, inputs: Mapping[str, Path], context: StageContext) -> None:
    """Each shard takes a few milliseconds, half of them with half a file on the disk."""
    names = [f"{index:03d}" for index in range(config.shards)]
    for name in context.progress(context.pending(names, ".txt"), desc="shards"):
        with context.atomic(f"{name}.txt") as path, path.open("w") as file:
            for half in ("begin", "end"):
                file.write(f"{half} {name}\n")
                file.flush()
                time.sleep(0.002)


if __name__ == "__main__":
    run(
        Workflow(
            name="killable",
            caption="",
            stages={"slow": StageNode("toy_slow", config={"shards": int(sys.argv[2])})},
            results={"first.txt": "slow/000.txt"},
        ),
        experiment="killable",
        results_dir=Path(sys.argv[1]),
        code=CodeState("abc"),
        metrics="none",
    )
