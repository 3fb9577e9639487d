"""Stage `causal_infogan_ends`: end shapes known to be reachable from unseen starts (Sec. VII-C)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from knotflow.recording import write_index
from knotflow.samplers.causal_infogan import CausalInfoGanBudget
from knotflow.samplers.causal_infogan.ends import (
    FOCUS,
    GOALS,
    OVERHAND,
    ActionSequence,
    guess,
    reachable_end,
)
from knotflow.samplers.demonstrations import task
from knotflow.simulation import RopeSimulator, SimulationConfig
from knotflow.workflow.context import StageContext
from knotflow.workflow.stage import stage
from knotflow.workflow.stages.recorder import Recorder
from knotflow.workflow.stages.starts import load_starts


@dataclass
class CausalInfoGanEndsConfig:
    """How hard end shapes are sought."""

    simulation: SimulationConfig = field(default_factory=SimulationConfig)
    """The simulator that executes the guesses."""
    starts: int = CausalInfoGanBudget.starts
    """Starts of C(0,1,1) at most."""
    starts_other: int = CausalInfoGanBudget.starts_other
    """Starts of each other action at most."""
    starts_overhand: int = CausalInfoGanBudget.starts_overhand
    """Starts of the overhand at most."""
    guesses: int = 16
    """Guesses executed at a time."""
    rounds: int = 6
    """Times that so many guesses are executed for each action before a start is left out."""
    seed: int = CausalInfoGanBudget.seed
    """Of the guesses."""

    def starts_of(self, goal: ActionSequence) -> int:
        """How many starts of a goal are tried at most."""
        special = {FOCUS: self.starts, OVERHAND: self.starts_overhand}
        return special.get(goal.name, self.starts_other)

    def guesses_of(self, goal: ActionSequence) -> int:
        """How many guesses are executed from one start of a goal at most."""
        return self.guesses * self.rounds * len(goal.actions)


@stage("causal_infogan_ends", inputs=("starts",))
def seek(
    config: CausalInfoGanEndsConfig, inputs: Mapping[str, Path], context: StageContext
) -> None:
    """Makes <goal>.npz with start (N,), points and ends (N, V, 3); ends.csv and recordings."""
    names = [goal.file for goal in GOALS]
    work = partial(_seek, config, dict(inputs))
    context.each(work, context.pending(names, ".npz"), "reachable ends")
    rows = []
    for goal in GOALS:
        with np.load(context.out / f"{goal.file}.npz") as file:
            rows.append((goal.name, int(file["tried"]), len(file["start"])))
    with context.atomic("ends.csv") as path:
        pd.DataFrame(rows, columns=["goal", "starts", "reached"]).to_csv(path, index=False)
    write_index(context.out / "recordings")


def _seek(
    config: CausalInfoGanEndsConfig, inputs: Mapping[str, Path], context: StageContext, name: str
) -> None:
    number = [goal.file for goal in GOALS].index(name)
    goal, rng = GOALS[number], np.random.default_rng([config.seed, number])
    starts = load_starts(inputs["starts"], task(goal.first))[: config.starts_of(goal)]
    # Numbers are unique in the stage: leave room for all guesses of the goals before.
    first = sum(config.starts_of(one) * config.guesses_of(one) for one in GOALS[:number])
    recorder = Recorder(context, "aim", config.simulation.rope, first)
    propose = guess(RopeSimulator(config.simulation), config.guesses, rng, recorder)
    found = {}
    for start, points in enumerate(starts):
        recorder.extra = {"start": str(start), "goal": goal.name}
        end = reachable_end(points, goal, propose, config.rounds)
        if end is not None:
            found[start] = (points, end)
    recorder.save(f"recordings/{name}.mcap")
    shape = (len(found), *starts.shape[1:])
    with context.atomic(f"{name}.npz") as path:
        np.savez_compressed(
            path,
            tried=len(starts),
            start=np.array(list(found), dtype=np.intp),
            points=np.array([one for one, _ in found.values()]).reshape(shape),
            ends=np.array([end for _, end in found.values()]).reshape(shape),
        )


def load_ends(folder: Path, goal: ActionSequence) -> tuple[NDArray, NDArray, NDArray]:
    """Numbers (N,) of the starts that have an end, these starts and ends (N, V, 3), metres."""
    with np.load(folder / f"{goal.file}.npz") as file:
        return file["start"], file["points"], file["ends"]
