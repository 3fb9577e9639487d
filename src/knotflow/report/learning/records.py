"""What the tables of learning curves hold, checked as they are read."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from knotflow.report.rows import Row, require

#: Metrics of a single action are called "policy_success/C(2,0,1)".
POLICY_SUCCESS = "policy_success"
#: Of joint finetuning: the share of a round's episodes that tied the rope.
EPISODE_SUCCESS = "episode_success"


@dataclass(frozen=True)
class Curve:
    """One metric of one primitive, by validation (imitation) or round (reinforcement) from 1."""

    primitive: int
    metric: str
    steps: tuple[int, ...]
    values: tuple[float, ...]

    @property
    def lowest(self) -> tuple[int, float]:
        """The step of the lowest value, the first of equal ones, and that value."""
        place = int(np.argmin(self.values))
        return self.steps[place], self.values[place]


class Curves:
    """The curves of one stage."""

    def __init__(self, curves: list[Curve]) -> None:
        self._curves = {(curve.primitive, curve.metric): curve for curve in curves}

    def __iter__(self) -> Iterator[Curve]:
        return iter(self._curves.values())

    def get(self, primitive: int, metric: str) -> Curve | None:
        """The curve of one primitive, None where it has no such metric."""
        return self._curves.get((primitive, metric))

    @property
    def primitives(self) -> list[int]:
        """Numbers of the primitives."""
        return sorted({primitive for primitive, _ in self._curves})

    def by_action(self, primitive: int, metric: str) -> dict[str, Curve]:
        """The curves of a metric that is measured action by action."""
        begin = f"{metric}/"
        return {
            curve.metric.removeprefix(begin): curve
            for curve in self
            if curve.primitive == primitive and curve.metric.startswith(begin)
        }


def read_curves(rows: list[Row]) -> Curves:
    """A table of learning curves, a row a value; steps there begin at 0.

    Raises:
        ResultsError: a value is no finite number, or a step stands there twice.
    """
    require(rows, ("primitive", "step", "metric", "value"))
    found: dict[tuple[int, str], dict[int, float]] = {}
    for row in rows:
        own = found.setdefault((row.count("primitive", 1), row.text("metric")), {})
        step = row.count("step") + 1
        if step in own:
            raise row.error("step", f"{step - 1} of {row.text('metric')} stands there twice")
        own[step] = row.number_in("value", -np.inf)
    return Curves(
        [
            Curve(primitive, metric, tuple(sorted(own)), tuple(own[step] for step in sorted(own)))
            for (primitive, metric), own in found.items()
        ]
    )
