"""How far predictions of a dragged rope are off (Sec. VI)."""

from __future__ import annotations

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
    }


SECTION = Section(
    EXPERIMENT,
    "Learned dynamics of a rope",
    "Sec. VI",
    "Where the vertices of a rope are after so many steps of 0.1 s, predicted from its first shape "
    "and the gripper's path alone.",
    values,
)
