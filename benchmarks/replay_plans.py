"""How plans of the shipped primitives fare when they are replayed in another world than planned.

    python benchmarks/replay_plans.py

Prints, for overhand, figure eight and pentagram, how many of twelve random ropes are tied and how
long planning took, then the share of thirty overhand plans that ties again.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from knotflow.planning import KnotPlan, PlannerConfig, plan_rope
from knotflow.samplers.primitives import SHIPPED_PRIMITIVES, PrimitiveLibrary
from knotflow.simulation import RopeSimulator, SimulationConfig, random_curve, state_or_none

NOMINAL = SimulationConfig(threads=2)
WORLDS = {
    "the same": NOMINAL,
    "10 % slower": replace(NOMINAL, pace=0.9 * NOMINAL.pace),
    "half the pace": replace(NOMINAL, pace=0.5 * NOMINAL.pace),
    "twice the pace": replace(NOMINAL, pace=2 * NOMINAL.pace),
    "half the time step": replace(NOMINAL, timestep=NOMINAL.timestep / 2),
    "other friction": replace(
        NOMINAL, rope=replace(NOMINAL.rope, table_friction=0.35, rope_friction=0.4)
    ),
    "twice the stiffness": replace(
        NOMINAL, rope=replace(NOMINAL.rope, joint_stiffness=2 * NOMINAL.rope.joint_stiffness)
    ),
}


def main() -> None:
    """Plan and replay; takes a few minutes."""
    library = PrimitiveLibrary.load(SHIPPED_PRIMITIVES)

    def planned(goal: str, seed: int, margin: float = 0.0) -> KnotPlan:
        rng = np.random.default_rng(seed)
        rope = random_curve(NOMINAL.rope, rng)
        config = PlannerConfig(max_branches=600, margin=margin)
        return plan_rope(rope, goal, rng, sampler=library, config=config)

    for goal in ("overhand", "figure_eight", "pentagram"):
        plans = [planned(goal, 1000 + seed) for seed in range(12)]
        tied = [plan for plan in plans if plan.solved]
        seconds = np.median([plan.seconds for plan in tied])
        print(f"{goal}: {len(tied)} of {len(plans)} tied, median {seconds:.1f} s", flush=True)
    simulators = {name: RopeSimulator(world) for name, world in WORLDS.items()}
    for margin in (0.0, 0.05):
        plans = [planned("overhand", 500 + seed, margin) for seed in range(30)]
        for name, simulator in simulators.items():
            again = []
            for plan in plans:
                points = plan.start
                for step in plan.steps:
                    points = simulator.execute(points[None], step.spline[None]).end_points[0]
                again.append(plan.solved and state_or_none(points) == plan.states[-1])
            print(f"margin {margin}: {name}: {np.mean(again):.0%}", flush=True)


if __name__ == "__main__":
    main()
