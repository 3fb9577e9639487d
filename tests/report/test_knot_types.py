"""The committed plans tie the knot they name, as an independent library (topoly) finds."""

import json
import os
from pathlib import Path

import numpy as np
import pytest

RESULTS = Path(__file__).parents[2] / "results"
PLANS = sorted(
    path.relative_to(RESULTS).as_posix()
    for experiment in RESULTS.iterdir()
    if experiment.name not in ("stages", "smoke")
    for path in experiment.rglob("plan.json")
)
TYPES = {"overhand": "3_1", "pentagram": "5_1", "bowline": "6_3"}
"""Of the knots that the committed plans tie, by experiment."""


@pytest.fixture(autouse=True)
def descriptor_0():
    """topoly closes it."""
    kept = os.dup(0)
    yield
    os.dup2(kept, 0)
    os.close(kept)


def knot_type(points):
    """Of a rope (V, 3) whose ends are joined high above everything."""
    topoly = pytest.importorskip("topoly")
    top = points[:, 2].max() + np.ptp(points, axis=0).max()
    above = np.column_stack([points[[-1, 0], :2], [top, top]])
    curve = np.concatenate([points, above, points[:1]]).tolist()
    # topoly forks a process pool unless told not to, and a fork beside threads may hang.
    return topoly.homfly(
        curve, closure=topoly.Closure.CLOSED, max_cross=40, run_parallel=False, translate=True
    )


@pytest.mark.slow
@pytest.mark.parametrize("name", PLANS)
def test_tied_rope_is_the_knot_of_its_plan(name):
    plan = json.loads((RESULTS / name).read_text())
    found = knot_type(np.array(plan["steps"][-1]["end_m"]))
    assert plan["solved"] and str(found).lstrip("+-") == TYPES[name.split("/")[0]]
