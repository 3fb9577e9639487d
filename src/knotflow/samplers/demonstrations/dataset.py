"""Tasks, the eight actions of Fig. 6, and their demonstrations: a start shape and a chosen spline.

A file has a demonstration a line (JSON). `start`, the actions that lead from the trivial state to
the start state, is left out for the eight tasks, and `who` and `when` where unknown.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from knotflow.simulation import Trials, check_splines, clip_splines
from knotflow.topology import Action, TopologicalState, parse_action, solution_graph
from knotflow.topology.curve import as_rope
from knotflow.topology.polyline import Floats


@dataclass(frozen=True)
class Task:
    """One topological action from one start state."""

    action: Action
    start_actions: tuple[Action, ...]  # actions that lead from the trivial state to the start state

    @property
    def name(self) -> str:
        """The action as a file name: C(2,0,-1) is "C_2_0_m1"."""
        return re.sub(r"\W+", "_", str(self.action).replace("-", "m")).strip("_")

    @property
    def start_state(self) -> TopologicalState:
        state = TopologicalState.trivial()
        for action in self.start_actions:
            state = state.apply(action)
        return state

    @property
    def goal_state(self) -> TopologicalState:
        return self.start_state.apply(self.action)


def _task(action: str, *start: str) -> Task:
    return Task(parse_action(action), tuple(parse_action(one) for one in start))


TASKS: tuple[Task, ...] = (
    _task("R1(0,1,1)"),
    _task("R2(0,0,1,1)"),
    _task("C(0,1,1)", "R1(0,1,1)"),
    _task("C(0,2,1)", "R1(0,1,1)"),
    _task("C(2,1,-1)", "R1(0,1,1)"),
    _task("C(2,0,-1)", "R1(0,1,1)"),
    _task("C(2,0,1)", "R1(0,1,1)", "C(0,1,1)"),
    _task("C(2,4,1)", "R1(0,1,1)", "C(0,1,1)"),
)
"""The actions that the authors' code demonstrates."""


def task(action: str) -> Task:
    """The task of an action written like "C(2,0,1)".

    Raises:
        ValueError: not one of the eight.
    """
    tasks = {str(one.action): one for one in TASKS}
    if action not in tasks:
        names = ", ".join(tasks)
        raise ValueError(f"no demonstrated action is called {action!r}; the eight are {names}")
    return tasks[action]


def task_at(state: TopologicalState, action: Action) -> Task:
    """The task of an action in a state: one of the eight, or one with a shortest way to its start.

    Raises:
        IllegalActionError: the state does not allow the action.
    """
    import networkx as nx  # slow to import

    state.apply(action)
    for candidate in TASKS:
        if candidate.action == action and candidate.start_state == state:
            return candidate
    graph = solution_graph(state)
    path = nx.shortest_path(graph, TopologicalState.trivial(), state)
    steps = [next(iter(graph[a][b].values()))["action"] for a, b in nx.utils.pairwise(path)]
    return Task(action, tuple(steps))


SHIPPED = Path(__file__).parent / "data" / "scripted.jsonl"
"""The demonstrations that come with the package."""


class DemonstrationError(ValueError):
    """A demonstration file that cannot be used as it is."""


@dataclass(frozen=True)
class Demonstration:
    """One demonstrated spline."""

    task: Task  # the action, and the state it starts from
    points: Floats  # (V, 3) start shape, metres
    spline: Floats  # (6,), see `simulation.spline`
    source: str  # who demonstrated it: "scripted", "human", or a study's name
    who: str = ""  # the person, as they call themselves
    when: str = ""  # ISO 8601, with the offset from UTC


@dataclass
class NoiseConfig:
    """Standard deviations of the Gaussian noise added to a demonstrated spline (Sec. V-B a)."""

    grasp: float = 0.02  # of the grasp position, fraction of the rope's length
    middle: float = 0.03  # of the middle control point's x, y and z, metres
    end: float = 0.03  # of the end point's x and y, metres

    @property
    def scale(self) -> Floats:
        """(6,) standard deviations in the order of a spline's numbers."""
        return np.array([self.grasp, *[self.middle] * 3, *[self.end] * 2])


def noisy_copies(
    spline: Floats, count: int, rng: np.random.Generator, config: NoiseConfig
) -> Floats:
    """(count, 6) splines about a demonstrated one (6,), clipped into range."""
    return clip_splines(spline + rng.normal(size=(count, 6)) * config.scale)


def save_demonstrations(path: Path, demonstrations: Iterable[Demonstration]) -> None:
    """Write demonstrations as JSON lines, positions to a micrometre."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("".join(f"{_line(one)}\n" for one in demonstrations), encoding="utf-8")


def add_demonstration(path: Path, demonstration: Demonstration) -> None:
    """Append one demonstration to a file, which is made if there is none."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("a+b") as file:
        if file.tell() and path.read_bytes()[-1:] != b"\n":  # as some editors leave it
            file.write(b"\n")
        file.write(f"{_line(demonstration)}\n".encode())


def merge_demonstrations(paths: Sequence[Path]) -> list[Demonstration]:
    """The demonstrations of several files, such as two people's, in the order given.

    Raises:
        DemonstrationError: two are the same, or a file is of no use; names files and lines.
    """
    lines: dict[str, str] = {}
    merged = []
    for path in paths:
        if not (found := load_demonstrations(path)):
            raise DemonstrationError(f"{path} has no demonstrations")
        for number, one in enumerate(found, 1):
            key = _line(replace(one, source="", who="", when=""))
            line = f"{path}, line {number}"
            if key in lines:
                raise DemonstrationError(
                    f"{line} is the same demonstration as {lines[key]}; delete one of the lines"
                )
            lines[key] = line
            merged.append(one)
    return merged


def load_demonstrations(path: Path = SHIPPED) -> list[Demonstration]:
    """The demonstrations of a file, or of the output of a `demonstrator` stage.

    Raises:
        DemonstrationError: a line cannot be used; names it, and says why.
    """
    demonstrations, path = [], Path(path)
    if path.is_dir():
        path /= SHIPPED.name
    try:
        lines = path.read_text(encoding="utf-8").rstrip().splitlines()
    except UnicodeDecodeError as error:
        raise DemonstrationError(f"{path}: not UTF-8 text: {error}") from None
    for number, line in enumerate(lines, 1):
        try:
            demonstrations.append(_demonstration(json.loads(line)))
        except json.JSONDecodeError as error:
            raise DemonstrationError(
                f"{path}, line {number}: not JSON, of which a demonstration file has an object a "
                f"line, as the studio writes them: {error}"
            ) from None
        except KeyError as error:
            raise DemonstrationError(f"{path}, line {number}: {error} is missing") from None
        except (ValueError, TypeError) as error:
            raise DemonstrationError(f"{path}, line {number}: {error}") from None
    return demonstrations


def _demonstration(row: Any) -> Demonstration:
    if not isinstance(row, dict) or not isinstance(row.get("source", ""), str):
        raise ValueError("a demonstration is a JSON object with a source in words")
    points = as_rope(row["points"])
    if "start" in row:
        shown = Task(parse_action(row["action"]), tuple(map(parse_action, row["start"])))
        shown.goal_state  # noqa: B018  raises where an action is illegal
    else:
        shown = task(row["action"])
    if (state := TopologicalState.from_curve(points)) != shown.start_state:
        raise ValueError(
            f"the points, head first, are in state {state}, but {shown.action} is demonstrated "
            f"from {shown.start_state}"
        )
    who, when = row.get("who", ""), row.get("when", "")
    if not isinstance(who, str):
        raise ValueError(f"who must be a name, got {who!r}")
    if when:
        datetime.fromisoformat(when)
    spline = check_splines(row["spline"])
    if spline.ndim != 1:
        raise ValueError(f"a demonstration has one spline, of 6 numbers, not {spline.shape}")
    return Demonstration(shown, points, spline, row["source"], who, when)


def _line(one: Demonstration) -> str:
    start = None if one.task in TASKS else [str(action) for action in one.task.start_actions]
    row = {
        "action": str(one.task.action),
        "start": start,
        "source": one.source,
        "who": one.who,
        "when": one.when,
        "spline": np.round(one.spline, 6).tolist(),
        "points": np.round(one.points, 6).tolist(),
    }
    return json.dumps({key: value for key, value in row.items() if value not in (None, "")})


class _TrialsByAction(dict[Action, list[Trials]]):
    def __missing__(self, action: Action) -> list[Trials]:
        raise DemonstrationError(
            f"there is no demonstration of {action}, only of {', '.join(map(str, self))}; "
            "demonstrate it, or merge the file with the shipped demonstrations: "
            f"knotflow merge FILE {SHIPPED}"
        )


def load_trials(folder: Path) -> dict[Action, list[Trials]]:
    """All trials of a `demonstrations` stage's output, by action: an item a demonstrated rope.

    An action that was not demonstrated raises a `DemonstrationError` where it is looked up.
    """
    trials = _TrialsByAction()
    for path in sorted((Path(folder) / "trials").glob("*.npz")):
        own = Trials.load(path)
        trials.setdefault(own.action, []).append(own)
    if not trials:
        raise FileNotFoundError(f"no trials (*.npz) in {folder}/trials")
    return trials
