"""Experiments one after the other: stages they share are made once, and a rerun goes on."""

from __future__ import annotations

import json
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from . import publish
from .definition import Workflow
from .metrics import DEFAULT_METRICS
from .provenance import CodeState
from .runner import run
from .workers import WorkersConfig


@dataclass(frozen=True)
class Experiment:
    """What differs between the experiments of a chain; see `runner.run`."""

    name: str
    workflow: Workflow
    results_dir: Path
    overwrite: bool = False


def run_all(
    experiments: Sequence[Experiment],
    *,
    code: CodeState,
    budget: str = "",
    metrics: str = DEFAULT_METRICS,
    workers: WorkersConfig | None = None,
) -> list[Path]:
    """Runs each in turn, prints what they took, and returns their results folders.

    One experiment alone is run as `runner.run` does it. The first failure ends the chain; called
    again it goes on there, since what is finished is never run again.

    Raises:
        ForeignResultsError: a results folder is of another configuration; before anything runs.
        Exception: what `runner.run` raises, with a note which experiment it was.
    """
    for one in experiments:
        folder = publish.experiment_folder(one.results_dir, one.name)
        if not one.overwrite:
            publish.refuse_foreign(folder, publish.resolved_config(one.workflow))
    took: dict[Path, float] = {}
    for number, one in enumerate(experiments, 1):
        begin, which = time.monotonic(), f"[{number} of {len(experiments)}]"
        if len(experiments) > 1:
            print(f"\n{which} ", end="")
        try:
            folder = run(
                one.workflow,
                experiment=one.name,
                results_dir=one.results_dir,
                code=code,
                budget=budget,
                overwrite=one.overwrite,
                metrics=metrics,
                workers=workers,
            )
        except BaseException as error:
            if len(experiments) > 1:
                error.add_note(f"Experiment {one.name!r} {which} is not finished.")
                print(overview(took))
            raise
        took[folder] = time.monotonic() - begin
    if len(experiments) > 1:
        print(overview(took))
    return list(took)


def overview(took: Mapping[Path, float]) -> str:
    """A table of finished experiments: the stages of each and their seconds, and those just taken.

    A stage that several share is counted for the first of them.

    Args:
        took: results folder -> seconds that it took this time.
    """
    lines = [f"{'experiment':<24} {'stages':>8} {'seconds':>10} {'this time':>10}"]
    known: dict[str, float] = {}
    for folder, seconds in took.items():
        stages = json.loads((folder / publish.RUN).read_text("utf-8"))["stages"].values()
        own = {one["signature"]: one["seconds"] for one in stages if one["signature"] not in known}
        lines.append(f"{folder.name:<24} {len(own):>8} {sum(own.values()):>10.1f} {seconds:>10.1f}")
        known |= own
    total, now = sum(known.values()), sum(took.values())
    lines.append(f"{'together':<24} {len(known):>8} {total:>10.1f} {now:>10.1f}")
    return "\n" + "\n".join(lines)
