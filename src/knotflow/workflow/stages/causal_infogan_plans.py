"""Stage `causal_infogan_plans`: Causal InfoGAN's plans, measured, and beside our samplers."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from knotflow.samplers.causal_infogan import CausalInfoGanBudget, measure
from knotflow.samplers.causal_infogan.comparison import compare, panel_rows
from knotflow.samplers.causal_infogan.ends import FOCUS, GOALS, OVERHAND
from knotflow.workflow.context import StageContext
from knotflow.workflow.stage import stage
from knotflow.workflow.stages.causal_infogan import load_rollouts
from knotflow.workflow.stages.causal_infogan_ends import load_ends


@dataclass
class CausalInfoGanPlansConfig:
    """What is planned."""

    models: list[str] = field(default_factory=lambda: ["single", "all"])
    """Inputs that are outputs of `causal_infogan` stages; the first one's plans make the panel."""
    training_rows: int = CausalInfoGanBudget.training_rows
    """Plans between shapes of the training data, for each model."""
    seed: int = CausalInfoGanBudget.seed
    """Of the planning."""


@dataclass(frozen=True)
class _Asked:
    """Given shapes of one goal: (N, V, 3) metres, world frame."""

    goal: str
    where: str  # "training" or "unseen"
    number: NDArray[np.intp]  # (N,) of the start, or of the demonstration
    starts: NDArray[np.float64]
    ends: NDArray[np.float64]
    actions: int


@stage("causal_infogan_plans")
def plan(
    config: CausalInfoGanPlansConfig, inputs: Mapping[str, Path], context: StageContext
) -> None:
    """Makes plans.csv, panel.csv (shapes of Fig. 8), comparison.csv, training.csv and seeds.csv.

    Inputs: `demonstrations`, `ends`, the models, and any number of evaluations of samplers on the
    same starts; their names are the methods of the comparison.
    """
    shards = [
        f"plans/{name}-{seed}"
        for name in config.models
        for seed in sorted(int(path.stem) for path in (inputs[name] / "models").glob("*.pt"))
    ]
    context.each(partial(_plan, config, dict(inputs)), context.pending(shards, ".csv"), "plans")
    tables = {
        "plans": pd.concat([pd.read_csv(context.out / f"{shard}.csv") for shard in shards]),
        "panel": pd.concat([_panel(name, inputs, context) for name in config.models]),
        **{
            table: pd.concat(
                [
                    pd.read_csv(inputs[name] / f"{table}.csv", keep_default_na=False).assign(
                        model=name
                    )
                    for name in config.models
                ]
            )
            for table in ("training", "seeds")
        },
    }
    methods = [name for name in inputs if name not in ("demonstrations", "ends", *config.models)]
    tables["comparison"] = compare(
        tables["plans"], {name: pd.read_csv(inputs[name] / "outcomes.csv") for name in methods}
    )
    tables["ends"] = pd.read_csv(inputs["ends"] / "ends.csv")
    for name, table in tables.items():
        with context.atomic(f"{name}.csv") as path:
            table.to_csv(path, index=False, float_format="%.6g")


def _plan(
    config: CausalInfoGanPlansConfig, inputs: Mapping[str, Path], context: StageContext, shard: str
) -> None:
    from knotflow.samplers.causal_infogan.networks import load_model
    from knotflow.samplers.causal_infogan.planning import Planner

    name, _, seed = Path(shard).name.rpartition("-")
    model, actions = load_model(inputs[name] / "models" / f"{seed}.pt")
    planner, rows, shapes = Planner(model, config.seed), [], []
    for asked in _asked(actions, model.config.frame_rate, config, inputs):
        steps = model.config.plan_steps * asked.actions
        plans = planner.plan(asked.starts, asked.ends, steps)
        for i, number in enumerate(asked.number):
            shown = (plans.projected_start[i], plans.way_points[i], plans.projected_end[i])
            measures = asdict(measure(asked.starts[i], *shown, asked.ends[i]))
            rows.append(
                {
                    "model": name,
                    "seed": int(seed),
                    "goal": asked.goal,
                    "shapes": asked.where,
                    "start": number,
                    **{key: int(v) if isinstance(v, bool) else v for key, v in measures.items()},
                }
            )
            if asked.goal in (FOCUS, OVERHAND) and i in (0, len(asked.number) // 2):
                shapes.append(panel_rows(rows[-1], asked.starts[i], *shown, asked.ends[i]))
    with context.atomic(f"panel/{name}-{seed}.csv") as path:
        pd.concat(shapes).to_csv(path, index=False, float_format="%.4f")
    with context.atomic(f"{shard}.csv") as path:
        pd.DataFrame(rows).to_csv(path, index=False, float_format="%.6g")


def _asked(
    actions: list[str],
    frame_rate: float,
    config: CausalInfoGanPlansConfig,
    inputs: Mapping[str, Path],
) -> Iterator[_Asked]:
    """The given shapes of every goal a model was trained for, seen ones first."""
    for action in actions:
        each = -(-config.training_rows // len(actions))
        seen = load_rollouts(inputs["demonstrations"], [action], frame_rate, each)
        starts, ends = seen.shapes[:, 0].astype(float), seen.shapes[:, -1].astype(float)
        yield _Asked(action, "training", seen.starts, starts, ends, 1)
    for goal in GOALS:
        if {str(action) for action in goal.actions} <= set(actions):
            number, starts, ends = load_ends(inputs["ends"], goal)
            if len(number):
                yield _Asked(goal.name, "unseen", number, starts, ends, len(goal.actions))


def _panel(model: str, inputs: Mapping[str, Path], context: StageContext) -> pd.DataFrame:
    """The shapes of the first seed that has not collapsed, of the first one where all have."""
    seeds = pd.read_csv(inputs[model] / "seeds.csv", keep_default_na=False)
    healthy = seeds[seeds["collapsed"] == ""]
    seed = int((healthy if len(healthy) else seeds)["seed"].iloc[0])
    return pd.read_csv(context.out / "panel" / f"{model}-{seed}.csv")
