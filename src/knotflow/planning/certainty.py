"""In how many simulated worlds a plan has to succeed."""

from __future__ import annotations

from dataclasses import dataclass, field

from knotflow.simulation import WorldsConfig


@dataclass
class SurvivalConfig:
    """In how many simulated worlds a plan has to succeed, see `planning.survival`."""

    worlds: int = 16
    """Worlds that plans are executed in, the best in twice as many more; 0 takes the first plan."""
    least: float = 0.75
    """Share of the worlds in which a plan has to tie; otherwise the search continues."""
    spread: WorldsConfig = field(default_factory=lambda: WorldsConfig(level=2))
    """What the worlds are drawn from."""
    batch: int = 8
    """Splines tried from a rope before another one is chosen."""
    tested: int = 3
    """Most of their ends that are simulated in the worlds, those of the highest value."""
    screened: int = 4
    """Worlds in which each is simulated first, and alone where more than one of them is lost."""

    def __post_init__(self) -> None:
        for name, low in {"worlds": 0, "batch": 1, "tested": 1, "screened": 1}.items():
            if not (value := getattr(self, name)) >= low:
                raise ValueError(f"survival.{name} must be {low} or more, got {value}")
        if not 0.0 <= self.least <= 1.0:
            raise ValueError(f"survival.least is a share, 0 to 1, got {self.least}")
