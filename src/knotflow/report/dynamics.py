"""How far predictions of a dragged rope are off (Sec. VI)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from knotflow.report.results import AMOUNT, AT_LEAST_ONE, COUNT, TEXT, Results
from knotflow.report.section import Pictures, Section
from knotflow.report.tables import NOTHING, markdown_table, tenths

EXPERIMENT = "dynamics"
#: Models in the order shown, and what they are called.
MODELS = {
    "still": "standing still",
    "lstm": "bidirectional LSTM",
    "mujoco": "MuJoCo, the planner's rope",
}
#: After so many steps models are compared in words; one second.
STEPS = 10
KEY = {"model": TEXT, "level": COUNT, "steps": AT_LEAST_ONE}


def values(results: Results, _: Pictures) -> dict[str, Any] | None:
    """A line a model and level, a column a number of steps."""
    errors = results.table(
        EXPERIMENT, "errors.csv", KEY | {"motions": COUNT, "mean_error_mm": AMOUNT}, key=tuple(KEY)
    )
    if errors is None:
        return None
    steps = sorted(errors["steps"].unique())
    cells = errors.set_index([*KEY])["mean_error_mm"].to_dict()
    names = [*MODELS, *sorted({*errors["model"]} - MODELS.keys())]
    lines = [
        [str(level), MODELS.get(name, name)]
        + [
            f"{tenths(cells[name, level, step])} mm" if (name, level, step) in cells else NOTHING
            for step in steps
        ]
        for level in sorted(errors["level"].unique())
        for name in names
    ]
    header = ["level", "model", *(f"after {0.1 * step:g} s" for step in steps)]
    return {
        "table": markdown_table(header, lines, "rl" + "r" * len(steps)),
        "motions": int(errors.groupby("level")["motions"].max().sum()),
        "why": _why(cells),
    }


def _why(cells: Mapping[tuple[str, int, int], float]) -> dict[str, str] | None:
    """Where the LSTM errs by more than MuJoCo on the ropes least like the planner's: the errors of
    both (mm) there and on the planner's own rope, which MuJoCo knows, after `STEPS` steps."""
    last = max(level for _, level, _ in cells)
    keys = {
        f"{name}_{which}": (name, level, STEPS)
        for name in ("lstm", "mujoco")
        for which, level in (("own", 0), ("last", last))
    }
    if not last or not set(keys.values()) <= cells.keys():
        return None
    found = {name: cells[key] for name, key in keys.items()}
    if found["lstm_last"] <= found["mujoco_last"]:
        return None
    grown = {
        f"{name}_grown": found[f"{name}_last"] - found[f"{name}_own"] for name in ("lstm", "mujoco")
    }
    return {"level": str(last)} | {name: tenths(value) for name, value in (found | grown).items()}


SECTION = Section(
    EXPERIMENT,
    "Learned dynamics of a rope",
    "Sec. VI",
    "Where the vertices of a rope are after so many steps of 0.1 s, predicted from its first shape "
    "and the gripper's path alone.",
    values,
)
