"""Draw the ropes of the leaderboard's public tasks into public.npz (`knotflow.apps.tasks`).

    python benchmarks/draw_public_starts.py public.npz

Other versions of MuJoCo may draw others; the file in the package is authoritative.
"""

from __future__ import annotations

import sys

import numpy as np

from knotflow.samplers.demonstrations import TASKS, heuristic_splines
from knotflow.simulation import RopeSimulator, SimulationConfig, reach_starts

ACTION_STARTS, KNOT_STARTS = 6, 16
SEED = 20_201_025


def main(path: str) -> None:
    """Write the starts (N, V, 3) by the actions that lead to their state."""
    simulator = RopeSimulator(SimulationConfig())
    starts = {" ".join(map(str, task.start_actions)) or "trivial": task.start_actions
              for task in TASKS}  # fmt: skip
    fewest_first = sorted(starts, key=lambda key: len(starts[key]))
    drawn = {}
    for number, key in enumerate([*fewest_first[:2], "knots", *fewest_first[2:]]):
        rng = np.random.default_rng([SEED, number])  # the order counts: new ones come last
        actions, count = starts.get(key, ()), KNOT_STARTS if key == "knots" else ACTION_STARTS
        found = reach_starts(actions, count, simulator, heuristic_splines, rng)
        drawn[key] = found.points.astype(np.float32)
    np.savez_compressed(path, **drawn)  # type: ignore[arg-type]


if __name__ == "__main__":
    main(sys.argv[1])
