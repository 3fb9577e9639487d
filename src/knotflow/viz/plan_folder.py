"""A plan's folder: pictures, animation, recording, waypoints, and the plan itself."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from knotflow.planning import KnotPlan, PlanStep, SolutionDag
from knotflow.recording import recorded, write_recording
from knotflow.simulation import Attempts, Rollouts, RopeConfig
from knotflow.topology import Undo

PLAN, REQUEST, OUTCOME = "plan.json", "request.json", "outcome.json"
PLAN_FILES = (
    *(PLAN, "plan.png", "plan.svg", "plan.gif", "plan.mcap", "waypoints.csv"),
    *("dag.png", "dag.svg", OUTCOME, REQUEST),
)
"""All that `write_plan_folder` may write."""
STRIDE = 5
"""One frame of so many is kept in plan.json and plan.gif: 10 of 50 per second."""
MAX_DRAWN_STATES = 40
"""A larger solution DAG is illegible: only the plan's own path through it is drawn."""


def write_plan_folder(
    folder: Path,
    plan: KnotPlan,
    source: str,
    rope: RopeConfig,
    *,
    last_tried: Attempts | None = None,
    signature: str = "",
    request: Mapping[str, Any] | None = None,
) -> None:
    """Write the files of a plan, see `PLAN_FILES`, into a folder that exists.

    The plan has trajectories at `planning.RECORD_RATE`, its splines were proposed by `source` for
    this rope. `last_tried` is the recording of a search that found no step, `signature` the key of
    the stage that made it, and `request`, what was asked for, goes into request.json.
    """
    # Here, as matplotlib is slow to import and most stages draw nothing.
    from PIL import Image

    from knotflow.viz.dag import draw_dag
    from knotflow.viz.plan import animate_plan, draw_plan

    coarse = subsample(plan)
    for suffix in ("png", "svg"):
        draw_plan(plan, folder / f"plan.{suffix}")
    if plan.steps:
        animate_plan(coarse, folder / "plan.gif")
    else:
        Image.open(folder / "plan.png").convert("P").save(folder / "plan.gif", format="GIF")
    (folder / PLAN).write_text(coarse.to_json(), "utf-8")
    coarse.waypoints().to_csv(folder / "waypoints.csv", plan.frame)
    attempts = [_attempts(step) for step in plan.steps]
    if not attempts and last_tried is not None:
        attempts = [last_tried]
    if attempts:
        rollouts = [
            rollout
            for number, one in enumerate(attempts)
            for rollout in recorded(one, rope, source, signature, number)
        ]
        facts = {"goal": plan.goal, "solved": str(plan.solved), "source": source}
        write_recording(folder / "plan.mcap", rollouts, facts)
    highlighted = plan.actions if plan.solved and not _jumps(plan) else ()
    pictures = [folder / "dag.png", folder / "dag.svg"]
    draw_dag(drawn_dag(plan), pictures, highlighted, plan.start_state)
    _write_json(folder / OUTCOME, {"success": plan.solved, "text": plan.summary()})
    if request is not None:
        _write_json(folder / REQUEST, request)


def subsample(plan: KnotPlan) -> KnotPlan:
    """The plan with every `STRIDE`-th frame, counted back from the last, and the first."""
    steps = []
    for step in plan.steps:
        kept = [*range(len(step.times) - 1, 0, -STRIDE), 0][::-1]
        frames = {name: getattr(step, name)[kept] for name in ("times", "trajectory", "gripper")}
        steps.append(replace(step, **frames))
    return replace(plan, steps=tuple(steps))


def drawn_dag(plan: KnotPlan) -> SolutionDag:
    """All paths from the rope's start state to the state that was tied, or to an untied goal.

    Only the plan's own path where these are too many to read, or where it undoes crossings; a
    shortest one where a step `jumps`.
    """
    undoes = any(isinstance(action, Undo) for action in plan.actions)
    goals = [plan.states[-1]] if plan.solved else plan.goal_states
    dags = (SolutionDag.to(goal) for goal in goals)
    dag = None if undoes else next((dag for dag in dags if plan.start_state in dag), None)
    jumps = _jumps(plan)
    if dag is None and (jumps or not plan.steps):  # the start's crossings have to be undone first
        dag = SolutionDag.to(*goals).with_undoings(plan.start_state)
    if dag is not None and len(reachable := dag.after(plan.start_state)) <= MAX_DRAWN_STATES:
        return reachable
    if plan.steps and not jumps:
        return SolutionDag.along(plan.actions, plan.start_state)
    assert dag is not None
    return SolutionDag.along(dag.shortest_path(plan.start_state), plan.start_state)


def _jumps(plan: KnotPlan) -> bool:
    return any(step.jumps for step in plan.steps)


def _attempts(step: PlanStep) -> Attempts:
    """A step as the batch of one attempt that a recording is made of."""
    rollouts = Rollouts(
        step.times,
        step.trajectory[None],
        step.gripper[None],
        frames=np.array([len(step.times)]),
        release_times=np.array([step.release_time]),
        end_points=step.end[None],
        diverged=np.zeros(1, bool),
    )
    start, spline = step.start[None], step.spline[None]
    return Attempts.of(step.action, step.start_state, start, spline, rollouts, [step.end_state])


def _write_json(path: Path, content: Mapping[str, Any]) -> None:
    path.write_text(json.dumps(content, indent=2, ensure_ascii=False) + "\n", "utf-8")
