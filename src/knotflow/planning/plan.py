"""A plan to tie a knot: what a search found, or how far it came; and its JSON file."""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from knotflow.planning.frame import Frame, Placement
from knotflow.planning.waypoints import GripperConfig, Waypoints, trace_waypoints
from knotflow.simulation import control_points
from knotflow.topology import Action, Arrange, TopologicalState, parse_action
from knotflow.topology.polyline import Floats

FORMAT = "knotflow.plan"
VERSION = 3

OUT_OF_REACH = "out of reach"
"""Outcome of an expansion for which no spline was found that the arm can follow."""

STOPPED = "the search was stopped"
"""Why it ended where a user stopped it."""

_PLAIN = ("goal", "solved", "reason", "branches", "kept")
_DECIMALS = 6  # of trajectories: micrometres, once float32 is widened


class PlanFormatError(ValueError):
    """A text that is not a plan, or not one that this version reads."""


@dataclass(frozen=True, eq=False)
class PlanStep:
    """One executed spline (6,), see `simulation.spline`; metres and seconds, world frame.

    Attributes:
        action: the topological action it instantiates, or `Arrange`, which keeps the state.
        start: (V, 3) the rope at rest before, in `start_state`.
        end: (V, 3) the rope at rest after, in `end_state`, to which the action leads unless the
            spline `jumps`.
        times: (T,) of the frames; the first is 0, at the grasp.
        trajectory: (T, V, 3) the rope in simulation; (0, V, 3) if it was not stored.
        gripper: (T, 3) the gripper.
        release_time: from grasp to release.
    """

    action: Action
    spline: Floats
    start: Floats
    start_state: TopologicalState
    end: Floats
    end_state: TopologicalState
    times: Floats
    trajectory: NDArray[np.float32]
    gripper: NDArray[np.floating[Any]]
    release_time: float

    @property
    def jumps(self) -> bool:
        """Whether no one action leads to `end_state`; `action` is then what was asked for.

        Only the paper's rule keeps such ends.
        """
        return self.start_state.apply(self.action) != self.end_state

    def controls(self, radius: float) -> Floats:
        """(3, 3) the control points of the spline on a rope of that radius, metres."""
        return control_points(self.start, self.spline, radius)


@dataclass(frozen=True)
class ExpansionStats:
    """How many splines tried one action from one state with one outcome.

    The outcome is the `str` of the end state, "diverged", "unreadable", "fragile" for the
    action's state with too short segments (`PlannerConfig.margin`), or "out of reach" where no
    spline was found that the arm can follow, and none simulated.
    """

    state: TopologicalState
    action: Action
    outcome: str
    success: bool
    branches: int


@dataclass(frozen=True, eq=False)
class KnotPlan:
    """A plan, complete or as far as the search came.

    Attributes:
        goal: what was asked for: a knot's name, a state or a path.
        goal_states: the states in which that knot is tied.
        solved: whether the last step ends in one of them.
        reason: why the search stopped.
        start: (V, 3) the rope at rest before the first step, metres, in `start_state`.
        steps: to the goal or, not solved, to the node of the tree nearest to it; maybe none.
        tried: a summary of all simulated splines.
        branches: simulated splines.
        kept: those whose ends were kept in the tree, which the paper's authors counted.
        seconds: wall time of the search.
        radius: of the rope, metres.
        frame: in which the rope was measured.
        worlds: in which the plan was executed open loop; 0 if it was not.
        survived: in how many of them the rope was in the planned state after each step.
    """

    goal: str
    goal_states: tuple[TopologicalState, ...]
    solved: bool
    reason: str
    start: Floats
    start_state: TopologicalState
    steps: tuple[PlanStep, ...]
    tried: tuple[ExpansionStats, ...]
    branches: int
    kept: int
    seconds: float
    radius: float
    frame: Frame = field(default_factory=Frame)
    worlds: int = 0
    survived: tuple[int, ...] = ()

    @property
    def actions(self) -> tuple[Action, ...]:
        """The steps' actions without arranging: the topological path, unless a step `jumps`."""
        return tuple(step.action for step in self.steps if not isinstance(step.action, Arrange))

    @property
    def splines(self) -> Floats:
        """(n, 6) the spline of each step."""
        return np.array([step.spline for step in self.steps]).reshape(-1, 6)

    @property
    def controls(self) -> Floats:
        """(n, 3, 3) the control points of each step's spline, metres."""
        return np.array([step.controls(self.radius) for step in self.steps]).reshape(-1, 3, 3)

    @property
    def shapes(self) -> Floats:
        """(n + 1, V, 3) the rope at rest: start, between steps, and final, metres."""
        return np.stack([self.start, *(step.end for step in self.steps)])

    @property
    def states(self) -> tuple[TopologicalState, ...]:
        """The n + 1 topological states of `shapes`."""
        return (self.start_state, *(step.end_state for step in self.steps))

    def steps_from(self, state: TopologicalState) -> tuple[PlanStep, ...]:
        """The steps that are left from a state, where it is met last; none where it is not."""
        met = [row for row, step in enumerate(self.steps) if step.start_state == state]
        return self.steps[met[-1] :] if met else ()

    def summary(self) -> str:
        """The topological path, one state per line, and the size of the search, for printing."""
        steps = [("start", self.start_state)]
        steps += [(str(step.action), step.end_state) for step in self.steps]
        width = max(10, *(len(action) for action, _ in steps))
        lines = [f"{action:<{width}} {state}" for action, state in steps]
        outcome = f"{self.goal}: tied" if self.solved else f"{self.goal}: NOT tied"
        lines.append(
            f"{outcome} ({self.reason}); {self.branches} splines simulated, {self.kept} kept, "
            f"{self.seconds:.2f} s"
        )
        if self.worlds:
            lines.append(f"ties in {self.survival()}")
        if self.solved:
            return "\n".join(lines)
        branches: Counter[tuple[TopologicalState, str]] = Counter()
        successes, unreached = branches.copy(), branches.copy()
        for one in self.tried:
            if one.outcome == OUT_OF_REACH:
                unreached[one.state, str(one.action)] += one.branches
            else:
                branches[one.state, str(one.action)] += one.branches
                successes[one.state, str(one.action)] += one.branches * one.success
        lines += [
            f"  {how} from {state}: {successes[state, how]} of {branches[state, how]} splines "
            "reached its state"
            + (f"; {times} times none was in reach" if (times := unreached[state, how]) else "")
            for state, how in sorted({*branches, *unreached})
        ] or ["  nothing was tried"]
        return "\n".join(lines)

    def survival_interval(self) -> tuple[float, float]:
        """95 % Wilson interval of the share of worlds in which the plan ties; needs `worlds`."""
        from scipy.stats import binomtest  # here, as it loads slowly

        low, high = binomtest(self.survived[-1], self.worlds).proportion_ci(method="wilson")
        return float(low), float(high)

    def survival(self) -> str:
        """In how many `worlds` the plan ties, for printing."""
        low, high = self.survival_interval()
        return (
            f"{self.survived[-1]} of {self.worlds} other worlds (95 % interval "
            f"{100 * low:.0f} to {100 * high:.0f} %)"
        )

    def placed(self, placement: Placement, frame: Frame) -> KnotPlan:
        """This plan of a model rope for the rope that lies there."""
        at = placement
        steps = tuple(
            replace(
                step,
                spline=at.splines(step.spline),
                start=at.points(step.start),
                end=at.points(step.end),
                times=at.times(step.times),
                trajectory=at.points(step.trajectory),
                gripper=at.points(step.gripper),
                release_time=float(at.times(step.release_time)),
            )
            for step in self.steps
        )
        radius = at.length * self.radius
        return replace(self, start=at.points(self.start), steps=steps, radius=radius, frame=frame)

    def waypoints(self, rate_hz: float = 20.0, config: GripperConfig | None = None) -> Waypoints:
        """Timed gripper waypoints with open and close, by default as high as the rope needs; errors
        as of `trace_waypoints`."""
        shapes = self.shapes
        moves = config or GripperConfig().clear_of(shapes, self.radius)
        return trace_waypoints(self.steps, shapes, self.radius, rate_hz, moves)

    def to_json(self, trajectories: bool = True) -> str:
        """The plan as JSON text, trajectories rounded to micrometres; `from_json` reads it back.

        Without `trajectories` a step keeps its frames' times and gripper only.
        """
        head = {
            "format": FORMAT,
            "version": VERSION,
            **{name: getattr(self, name) for name in _PLAIN},
            "seconds_s": self.seconds,
            "goal_states": self.goal_states,
            "radius_m": self.radius,
            "frame": self.frame.to_json(),
            "worlds": self.worlds,
            "survived": self.survived,
            "survival_interval": np.round(self.survival_interval(), 4) if self.worlds else None,
            "start_state": self.start_state,
            "start_m": self.start,
            "steps": [
                {
                    "action": step.action,
                    "start_state": step.start_state,
                    "end_state": step.end_state,
                    "spline": step.spline,
                    "control_points_m": step.controls(self.radius),
                    "end_m": step.end,
                    "times_s": step.times,
                    "release_time_s": step.release_time,
                    "gripper_m": np.round(np.float64(step.gripper), _DECIMALS),
                    "trajectory_m": np.round(np.float64(step.trajectory), _DECIMALS)
                    if trajectories
                    else [],
                }
                for step in self.steps
            ],
            "tried": [vars(one) for one in self.tried],
        }
        # One line per key or step keeps the file legible, at a third of the size.
        lines = [f"{json.dumps(key)}: {_value(value)}" for key, value in head.items()]
        return "{\n" + ",\n".join(lines) + "\n}\n"

    @classmethod
    def from_json(cls, text: str) -> KnotPlan:
        """Read what `to_json` wrote.

        Raises:
            PlanFormatError: not a plan, one of another version, or one with parts missing.
        """
        try:
            data = json.loads(text)
            written = data["format"], data["version"]
            if written != (FORMAT, VERSION):
                raise ValueError(f"it has format and version {written}, not {(FORMAT, VERSION)}")
            return cls._parse(data)
        except KeyError as error:
            raise PlanFormatError(f"the plan has no {error}") from None
        except (TypeError, ValueError, AttributeError, OverflowError, RecursionError) as error:
            raise PlanFormatError(f"the plan cannot be read: {error}") from error

    @classmethod
    def _parse(cls, data: dict[str, Any]) -> KnotPlan:
        state = TopologicalState.parse
        start = shape = np.array(data["start_m"], np.float64)
        steps: list[PlanStep] = []
        for step in data["steps"]:
            steps.append(
                PlanStep(
                    action=parse_action(step["action"]),
                    spline=np.array(step["spline"], np.float64).reshape(6),
                    start=shape,
                    start_state=state(step["start_state"]),
                    end=np.array(step["end_m"], np.float64),
                    end_state=state(step["end_state"]),
                    times=np.array(step["times_s"], np.float64),
                    trajectory=np.array(step["trajectory_m"], np.float32).reshape(-1, *start.shape),
                    gripper=np.array(step["gripper_m"], np.float32).reshape(-1, 3),
                    release_time=float(step["release_time_s"]),
                )
            )
            if (shape := steps[-1].end).shape != start.shape:
                raise ValueError(f"a step ends with a rope {shape.shape}, but starts {start.shape}")
        tried = [
            ExpansionStats(state(one.pop("state")), parse_action(one.pop("action")), **one)
            for one in data["tried"]
        ]
        worlds, survived = int(data.get("worlds", 0)), tuple(data.get("survived") or ())
        if worlds and len(survived) != len(steps):
            raise ValueError(f"it survived {len(survived)} of {len(steps)} steps")
        return cls(
            goal_states=tuple(map(state, data["goal_states"])),
            start=start,
            start_state=state(data["start_state"]),
            steps=tuple(steps),
            tried=tuple(tried),
            seconds=float(data["seconds_s"]),
            radius=float(data["radius_m"]),
            frame=Frame.from_json(data["frame"]) if "frame" in data else Frame(),
            worlds=worlds,
            survived=survived,
            **{name: data[name] for name in _PLAIN},
        )


def _value(value: Any) -> str:
    if isinstance(value, list) and value:
        return "[\n" + ",\n".join("  " + _value(item) for item in value) + "\n]"
    return json.dumps(value, default=_plain)


def _plain(value: Any) -> Any:
    return value.tolist() if isinstance(value, np.ndarray) else str(value)
