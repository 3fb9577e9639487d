"""Demonstrations: a start shape, an action, and the spline a demonstrator chose for it.

The shipped file holds 50, all made by `scripted.demonstrate` (`source` "scripted"); no human
demonstrators were at hand. Demonstrations by people are added beside them with
`save_demonstrations` and their own `source`, and named in the configuration.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from knotflow.demonstrations.tasks import Task, task
from knotflow.simulation import SplineError, check_splines

SHIPPED = Path(__file__).parent / "data" / "scripted.jsonl"
"""The demonstrations that come with the package."""


class DemonstrationError(ValueError):
    """A demonstration file that cannot be used as it is."""


@dataclass(frozen=True)
class Demonstration:
    """One demonstrated spline."""

    task: Task
    """The action, and the state it starts from."""
    points: NDArray[np.float64]
    """(V, 3) start shape, metres."""
    spline: NDArray[np.float64]
    """(6,), see `simulation.spline`."""
    source: str
    """Who demonstrated it: "scripted", or a person's or a study's name."""


def save_demonstrations(path: Path, demonstrations: Iterable[Demonstration]) -> None:
    """Write demonstrations as JSON lines, positions to a micrometre."""
    lines = [
        json.dumps(
            {
                "action": str(one.task.action),
                "source": one.source,
                "spline": np.round(one.spline, 6).tolist(),
                "points": np.round(one.points, 6).tolist(),
            }
        )
        for one in demonstrations
    ]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def load_demonstrations(path: Path = SHIPPED) -> list[Demonstration]:
    """The demonstrations of a file.

    Raises:
        DemonstrationError: naming the file, the line, and what is wrong with it.
    """
    demonstrations = []
    for number, line in enumerate(Path(path).read_text(encoding="utf-8").splitlines(), 1):
        try:
            row = json.loads(line)
            points = np.array(row["points"], dtype=np.float64)
            if points.ndim != 2 or points.shape[1] != 3 or not np.isfinite(points).all():
                raise ValueError(f"points must be finite and (V, 3), they are {points.shape}")
            demonstration = Demonstration(
                task(row["action"]), points, check_splines(row["spline"]), row["source"]
            )
        except KeyError as error:
            raise DemonstrationError(f"{path}, line {number}: {error} is missing") from None
        except (ValueError, TypeError, SplineError) as error:
            raise DemonstrationError(f"{path}, line {number}: {error}") from None
        demonstrations.append(demonstration)
    return demonstrations
