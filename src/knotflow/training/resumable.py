"""Training that is saved, and goes on from what was saved."""

from __future__ import annotations

from abc import ABC, abstractmethod
from pathlib import Path
from typing import Any

from torchrl.checkpoint import Checkpoint, StateDictCheckpointAdapter


class Resumable(ABC):
    """Saves all that is needed to go on; its subclasses say what that is."""

    def save(self, path: Path) -> None:
        """Write all that is needed to go on to a folder."""
        self._checkpoint().save(path)

    def load(self, path: Path) -> None:
        """Go on from a folder that `save` wrote, of a training with the same arguments."""
        self._checkpoint().load(path)

    def _checkpoint(self) -> Checkpoint:
        """All tensors in one file: each would be one of its own, a thousand to force to disk."""
        adapter = StateDictCheckpointAdapter("consolidated")
        return Checkpoint().register("training", self, adapter=adapter)

    @abstractmethod
    def state_dict(self) -> dict[str, Any]:
        """All that changes while it trains."""

    @abstractmethod
    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Take over what `state_dict` gave."""
