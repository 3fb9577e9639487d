"""A plan as JSON: what the file holds, metres and seconds, and how it is read back."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from knotflow.planning.plan_step import PlanStep, Tried
from knotflow.topology import TopologicalState, parse_action

FORMAT = "knotflow.plan"
VERSION = 1

_PLAIN = ("goal", "solved", "reason", "branches", "nodes")
_SECONDS = ("seconds", "sampling_seconds", "simulation_seconds", "move_time")
_DECIMALS = 6  # of trajectories: micrometres


class PlanFormatError(ValueError):
    """A text that is not a plan, or not one that this version reads."""


def dump(plan: Mapping[str, Any], trajectories: bool = True) -> str:
    """The JSON text of a plan's fields, a line for each step; see `KnotPlan.to_json`."""
    steps = [
        {
            "action": str(step.action),
            "start_state": str(step.start_state),
            "end_state": str(step.end_state),
            "spline": step.spline.tolist(),
            "control_points_m": step.controls(plan["radius"]).tolist(),
            "end_m": step.end.tolist(),
            "times_s": step.times.tolist(),
            "gripper_m": _rounded(step.gripper),
            "trajectory_m": _rounded(step.trajectory) if trajectories else [],
        }
        for step in plan["steps"]
    ]
    tried = [
        {
            "state": str(tried.state),
            "action": str(tried.action),
            "outcome": tried.outcome,
            "success": tried.success,
            "branches": tried.branches,
        }
        for tried in plan["tried"]
    ]
    head: dict[str, Any] = {"format": FORMAT, "version": VERSION}
    head |= {name: plan[name] for name in _PLAIN}
    head |= {f"{name}_s": plan[name] for name in _SECONDS}
    head |= {
        "goal_states": [str(state) for state in plan["goal_states"]],
        "radius_m": plan["radius"],
        "start_state": str(plan["start_state"]),
        "start_m": plan["start"].tolist(),
        "steps": steps,
        "tried": tried,
    }
    # Arrays stay on the line of their key: a file to look through, at a third of the size.
    lines = [f"{json.dumps(key)}: {_value(value)}" for key, value in head.items()]
    return "{\n" + ",\n".join(lines) + "\n}\n"


def load(text: str) -> dict[str, Any]:
    """The fields of the plan in a JSON text; see `KnotPlan.from_json`."""
    try:
        data = json.loads(text)
    except json.JSONDecodeError as error:
        raise PlanFormatError(f"the plan is not JSON: {error}") from None
    if not isinstance(data, dict) or data.get("format") != FORMAT:
        raise PlanFormatError(f'the JSON is no plan: it has no "format": "{FORMAT}"')
    if data.get("version") != VERSION:
        raise PlanFormatError(
            f"the plan has version {data.get('version')}, this program reads version {VERSION}"
        )
    try:
        start = np.array(data["start_m"], np.float64)
        steps = []
        shape = start
        for step in data["steps"]:
            end = np.array(step["end_m"], np.float64)
            steps.append(
                PlanStep(
                    action=parse_action(step["action"]),
                    spline=np.array(step["spline"], np.float64),
                    start=shape,
                    start_state=TopologicalState.parse(step["start_state"]),
                    end=end,
                    end_state=TopologicalState.parse(step["end_state"]),
                    times=np.array(step["times_s"], np.float64),
                    trajectory=np.array(step["trajectory_m"], np.float32).reshape(
                        -1, len(start), 3
                    ),
                    gripper=np.array(step["gripper_m"], np.float32).reshape(-1, 3),
                )
            )
            shape = end
        return {
            "goal_states": tuple(TopologicalState.parse(state) for state in data["goal_states"]),
            "start": start,
            "start_state": TopologicalState.parse(data["start_state"]),
            "steps": tuple(steps),
            "tried": tuple(
                Tried(
                    TopologicalState.parse(tried["state"]),
                    parse_action(tried["action"]),
                    tried["outcome"],
                    tried["success"],
                    tried["branches"],
                )
                for tried in data["tried"]
            ),
            "radius": data["radius_m"],
            **{name: data[name] for name in _PLAIN},
            **{name: data[f"{name}_s"] for name in _SECONDS},
        }
    except KeyError as error:
        raise PlanFormatError(f"the plan has no {error}") from None
    except (TypeError, ValueError) as error:
        raise PlanFormatError(f"the plan cannot be read: {error}") from error


def _rounded(array: NDArray) -> list[Any]:
    # Widened first: a float32 would be written with all the digits of its nearest float64.
    return np.round(array.astype(np.float64), _DECIMALS).tolist()


def _value(value: Any) -> str:
    if isinstance(value, list) and value and isinstance(value[0], dict):
        return "[\n" + ",\n".join("  " + json.dumps(item) for item in value) + "\n]"
    return json.dumps(value)
