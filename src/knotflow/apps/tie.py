"""A knot for a person with a rope: from what is asked to a plan's folder, and to the next step.

`prepare` reads what is asked and refuses what cannot be done, before anything slow is loaded;
`search` plans; `write` leaves a folder that says what it was asked for, so that no plan takes the
place of another.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from knotflow.planning import Goal, parse_goal, parse_rope
from knotflow.simulation import SimulationConfig

if TYPE_CHECKING:
    from knotflow.planning import KnotPlan, PlanStep
    from knotflow.simulation import Attempts

REQUEST = "request.json"
"""What a plan's folder was asked for; a folder without it is not ours to replace."""
OUTCOME = "outcome.json"
SOURCE = "primitives"
"""Who proposes the splines: the sampler of the shipped library."""
REPEATS = 32
"""Disturbed repetitions of a step that say how sure it is."""


@dataclass(frozen=True)
class Request:
    """What is tied into which rope."""

    knot: str
    """A name, crossings, or a path of actions, see `planning.parse_goal`."""
    rope: str = "random"
    """straight, arc, random, or a file, see `planning.read_rope`."""
    rope_unit: str | None = None
    """Of the file's numbers; None takes the header's, else metres."""
    seed: int = 0
    """Of a random rope and of the search."""
    max_seconds: float = 60.0
    """After which the search is given up."""
    margin: float = 0.0
    """See `planning.PlannerConfig`."""

    def __post_init__(self) -> None:
        if self.seed < 0:
            raise ValueError(f"--seed must be 0 or more, got {self.seed}")
        if not self.max_seconds > 0:
            raise ValueError(f"--max-seconds must be above 0, got {self.max_seconds:g}")
        if not self.margin >= 0:
            raise ValueError(f"--margin must be 0 or more, got {self.margin:g}")


@dataclass(frozen=True, eq=False)
class Tying:
    """A request that was read.

    Attributes:
        request: as it was asked.
        goal: what is tied.
        points: (V, 3) the rope, metres.
        simulation: what it is planned in.
    """

    request: Request
    goal: Goal
    points: NDArray[np.float64]
    simulation: SimulationConfig


def prepare(request: Request) -> Tying:
    """Read a request.

    Raises:
        ValueError: an unknown knot; a rope that cannot be used or is tied already. See
            `planning.parse_goal`, `parse_rope`.
    """
    from knotflow.topology import TopologicalState

    simulation = SimulationConfig()
    goal = parse_goal(request.knot, simulation.rope)
    rng = np.random.default_rng([request.seed, 0])
    points = parse_rope(request.rope, simulation.rope, rng, unit=request.rope_unit)
    state = TopologicalState.from_curve(points)
    if state in goal.states:
        raise ValueError(
            f"there is nothing to plan: the rope {request.rope!r} lies in the state {state}, "
            f"which is {request.knot} already"
        )
    return Tying(request, goal, points, simulation)


def search(task: Tying) -> tuple[KnotPlan, Attempts | None]:
    """Plan with the shipped primitives, and show how far the search is.

    Returns:
        The plan, solved or not, and the last attempts, of which there are none if time was up.
    """
    from knotflow.config import PlanRequest, shipped_primitives
    from knotflow.planning import SearchUpdate, plan_knot
    from knotflow.samplers.primitives import PrimitiveLibrary
    from knotflow.simulation import RopeSimulator
    from knotflow.threads import one_thread
    from knotflow.workflow.progress import progress

    asked = task.request
    config = replace(PlanRequest().planner, max_seconds=asked.max_seconds, margin=asked.margin)
    library = PrimitiveLibrary.load(Path(shipped_primitives()), task.simulation.rope)
    simulator = RopeSimulator(task.simulation)
    rng = np.random.default_rng([asked.seed, 1])
    last: list[Attempts] = []
    with one_thread(), progress(total=config.max_branches, desc="branches") as bar:

        def report(update: SearchUpdate) -> None:
            bar.update(update.branches - bar.n)

        plan = plan_knot(
            task.points,
            task.goal,
            library,
            simulator,
            rng,
            config,
            report,
            lambda attempts: last.__setitem__(slice(None), [attempts]),
        )
    return plan, last[0] if last else None


def recall(folder: Path, request: Request, overwrite: bool) -> dict[str, Any] | None:
    """The outcome of the same request if it was planned before; None if it is to be planned.

    Raises:
        ValueError: the folder holds something else, and `overwrite` is not set or it is no plan's.
    """
    if folder.is_file():
        raise ValueError(f"--out {folder} is a file; a plan is a folder")
    if not folder.exists() or not any(folder.iterdir()):
        return None
    if not (folder / REQUEST).is_file():
        raise ValueError(f"{folder} holds files that are no plan; name another folder with --out")
    if overwrite:
        return None
    before = json.loads((folder / REQUEST).read_text("utf-8"))["request"]
    now = _identity(request)
    if before == now:
        return dict(json.loads((folder / OUTCOME).read_text("utf-8")))
    differing = ", ".join(
        f"{key} {before.get(key)!r} there and {now.get(key)!r} here"
        for key in sorted({*before, *now})
        if before.get(key) != now.get(key)
    )
    raise ValueError(
        f"{folder} holds another plan ({differing}); --overwrite replaces it, "
        "--out DIR writes elsewhere"
    )


def write(folder: Path, task: Tying, plan: KnotPlan, last: Attempts | None) -> None:
    """Write a plan's folder, whole or not at all; its files are those of `write_plan`.

    Beside them are request.json, what was asked for and the code that made it, and outcome.json.
    """
    from knotflow.workflow import StageContext, code_state, durable
    from knotflow.workflow.plan_folder import write_plan

    made = {"request": _identity(task.request), **asdict(code_state(Path(__file__).parent))}
    outcome = {"success": plan.solved, "text": plan.summary()}
    with durable.atomic(folder) as temporary:
        temporary.mkdir()
        write_plan(StageContext(temporary), ".", plan, task.simulation, SOURCE, last)
        durable.write_json(temporary / OUTCOME, outcome)
        durable.write_json(temporary / REQUEST, made)


def certainty(task: Tying, step: PlanStep) -> float:
    """The share of disturbed repetitions of a step that reach its state.

    The gripper misses the grasp by 5 mm along the rope and each control point by 5 mm an axis
    (standard deviations), about what a calibrated arm does.
    """
    from knotflow.samplers.demonstrations import NoiseConfig, noisy_copies
    from knotflow.simulation import RopeSimulator, attempt

    noise = NoiseConfig(grasp=0.005 / task.simulation.rope.length, middle=0.005, end=0.005)
    rng = np.random.default_rng([task.request.seed, 2])
    splines = noisy_copies(step.spline, REPEATS, rng, noise)
    simulator = RopeSimulator(task.simulation)
    tried = attempt(simulator, step.start, splines, step.action, step.start_state)
    return float(tried.success.mean())


def _identity(request: Request) -> dict[str, Any]:
    """What decides a plan: of a rope's file not its name, but what is in it."""
    from knotflow.config import contents

    return asdict(request) | {"rope": contents(request.rope)}
