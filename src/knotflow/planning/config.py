"""What a search takes from the configuration."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass
class PlannerConfig:
    """How the tree grows, and when to give up."""

    bias: float = 10.0
    """How many times likelier a node is chosen than one that is one edge farther from the goal;
    1 is no bias."""
    batch: int = 1
    """Splines simulated at once; 1 is the paper's search."""
    max_branches: int = 2000
    """Give up after this many simulated splines."""
    max_seconds: float = 600.0
    """Give up after this time, seconds of wall clock; a batch that has begun is finished."""
    value_bias: float = 0.0
    """Exponent of the value of a branch, the probability of success that the sampler's critic gives
    it, on its chance to be grown; 0 is the paper's rule. Without a critic every value is 1."""
    failure_discount: float = 1.0
    """Factor on a node's weight for every branch that failed from it; 1 is the paper's rule. Below
    1 the search leaves nodes from which nothing succeeds, such as loops that are too tight."""

    def __post_init__(self) -> None:
        """Refuse values that make no search."""
        if not self.bias >= 1.0:
            raise ValueError(f"planner.bias must be 1 or more, got {self.bias}")
        if not self.value_bias >= 0.0:
            raise ValueError(f"planner.value_bias must be 0 or more, got {self.value_bias}")
        for name in ("batch", "max_branches"):
            if getattr(self, name) < 1:
                raise ValueError(f"planner.{name} must be 1 or more, got {getattr(self, name)}")
        if not self.max_seconds > 0.0:
            raise ValueError(f"planner.max_seconds must be above 0, got {self.max_seconds}")
        if not 0.0 < self.failure_discount <= 1.0:
            raise ValueError(
                f"planner.failure_discount must lie in (0, 1], got {self.failure_discount}"
            )
