"""Settings of a search, properties of a rope, and the name of a plan's folder."""

from __future__ import annotations

import hashlib
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

RULES = ("posterior", "paper")


@dataclass
class PlannerConfig:
    """How the tree grows, and when to give up."""

    rule: str = "posterior"
    """What is expanded next, see `planning.rules`: posterior, or paper as in Sec. V-B d."""
    arranging: int = 3
    """Most arranging splines in a row before one that acts. By the paper's rule none is meant to
    arrange, and all that keep the state are kept."""
    use_next_value: bool = True
    """Whether splines are also sampled for the value of their ends (Sec. V-B c), where the sampler
    can and another action follows."""
    guess_fraction: float = 0.5
    """Share of guesses among splines for an action whose value is below `guess_below_value`, after
    a success from the same shape, and for arranging; by the paper's rule there are none."""
    guess_below_value: float = 0.3
    """See `guess_fraction`."""
    undoing: bool = False
    """Whether crossings may be undone from any rope. If not set, only where the rope has crossings
    at the start, and by the paper's rule never."""
    batch: int = 1
    """Splines simulated at once; 1 is the paper's search."""
    max_branches: int = 2000
    """Give up after this many simulated splines."""
    max_seconds: float = 600.0
    """Give up after this time, seconds of wall clock; a batch that has begun is finished."""
    steady: bool = False
    """Whether the first plan counts only if its steps are robust (`validation.are_robust`);
    otherwise the search drops the first that is not, and all that follows. Later plans are judged
    in worlds instead."""
    margin: float = 0.0
    """Least length of a segment that an expansion leaves, metres, unless one was shorter before; 0
    is the paper."""

    def __post_init__(self) -> None:
        if self.rule not in RULES:
            raise ValueError(f"unknown planner.rule {self.rule!r}; it is one of {', '.join(RULES)}")
        least = {"arranging": 0, "margin": 0, "batch": 1, "max_branches": 1}
        for name, low in least.items():
            if not (value := getattr(self, name)) >= low:
                raise ValueError(f"planner.{name} must be {low} or more, got {value}")
        for name in ("guess_fraction", "guess_below_value"):
            if not 0.0 <= (share := getattr(self, name)) <= 1.0:
                raise ValueError(f"planner.{name} is a share, 0 to 1, got {share}")
        if not self.max_seconds > 0.0:
            raise ValueError(f"planner.max_seconds must be above 0, got {self.max_seconds}")


FAST_SEARCH = PlannerConfig(batch=4, steady=True, max_branches=20_000, max_seconds=60.0)
"""In batches, so that all cores are used; the default of `plan_rope`."""

Unit = Literal["m", "cm", "mm"]
Axis = Literal["x", "-x", "y", "-y", "z", "-z"]


@dataclass(frozen=True)
class RopeOptions:
    """Properties of a rope and of its file; lengths are texts such as 6mm, 0.7m or 0.7."""

    rope_unit: Unit | None = None
    """Unit of the rope file; by default the one in its header ("x [mm]"), else metres."""
    length: str | None = None
    """Rope's length (0.7m); by default the file's, or 1m."""
    diameter: str | None = None
    """Rope's diameter (6mm); by default a hundredth of its length."""
    stiffness: str | None = None
    """soft, medium (default), stiff, or bending length (4cm)."""
    up: Axis = "z"
    """Axis of the file that points up from the table."""
    cut: int | Literal["open"] | None = None
    """Index of the point at which a closed curve is cut; open for a curve that is not closed."""
    crossings: str | None = None
    """State seen from above, such as 4o1+2o5+6o3+, in place of z."""


def plan_name(knot: str, rope: str, seed: int) -> str:
    """Name of the folder of a plan; rope files of one name and different contents differ."""
    signs, path = knot.replace("+", "p").replace("-", "m"), Path(rope)
    name = path.stem
    if path.is_file():
        name += f"-{hashlib.sha256(path.read_bytes()).hexdigest()[:8]}"
    return re.sub(r"[^A-Za-z0-9.-]+", "_", f"{signs}-{name}-{seed}")
