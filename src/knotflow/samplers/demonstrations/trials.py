"""Trials: splines that were simulated, and which succeeded. What every method learns from."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from knotflow.topology import Action, parse_action


@dataclass(frozen=True)
class Trials:
    """Splines of one action, tried from a few start shapes each many times."""

    action: Action
    """The action that was tried."""
    starts: NDArray[np.float64]
    """(S, V, 3) start shapes, metres."""
    start: NDArray[np.intp]
    """(N,) index of the start shape of each trial."""
    splines: NDArray[np.float64]
    """(N, 6) splines, see `simulation.spline`."""
    success: NDArray[np.bool_]
    """(N,) whether the action's state was reached."""

    def __len__(self) -> int:
        return len(self.splines)

    def from_starts(self, chosen: NDArray[np.intp]) -> Trials:
        """The trials from some of the start shapes, by ascending index."""
        rows = np.isin(self.start, chosen)
        return Trials(
            self.action,
            self.starts[chosen],
            np.searchsorted(chosen, self.start[rows]),
            self.splines[rows],
            self.success[rows],
        )

    def save(self, path: Path) -> None:
        """Write to an .npz file."""
        np.savez_compressed(
            path,
            action=str(self.action),
            starts=self.starts,
            start=self.start,
            splines=self.splines,
            success=self.success,
        )

    @classmethod
    def load(cls, path: Path) -> Trials:
        """Read what `save` wrote."""
        with np.load(path) as file:
            return cls(
                parse_action(str(file["action"])),
                *(file[name] for name in ("starts", "start", "splines", "success")),
            )

    @classmethod
    def concatenate(cls, parts: Iterable[Trials]) -> Trials:
        """Trials of one action as one, every part with start shapes of its own."""
        parts = list(parts)
        offset = np.cumsum([0, *(len(part.starts) for part in parts[:-1])])
        return cls(
            parts[0].action,
            np.concatenate([part.starts for part in parts]),
            np.concatenate([part.start + shift for part, shift in zip(parts, offset, strict=True)]),
            np.concatenate([part.splines for part in parts]),
            np.concatenate([part.success for part in parts]),
        )


def load_trials(folder: Path) -> dict[Action, Trials]:
    """All trials of a stage's output, `folder/trials/*.npz`, by action."""
    parts: dict[Action, list[Trials]] = {}
    for path in sorted((Path(folder) / "trials").glob("*.npz")):
        trials = Trials.load(path)
        parts.setdefault(trials.action, []).append(trials)
    if not parts:
        raise FileNotFoundError(f"no trials (*.npz) in {folder}/trials")
    return {action: Trials.concatenate(some) for action, some in parts.items()}
