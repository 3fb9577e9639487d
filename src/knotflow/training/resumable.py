"""Training that is saved, and goes on from what was saved."""

from __future__ import annotations

from abc import ABC, abstractmethod
from pathlib import Path
from typing import Any

from torchrl.checkpoint import Checkpoint


class Resumable(ABC):
    """Saves all that is needed to go on; its subclasses say what that is."""

    def save(self, path: Path) -> None:
        """Write all that is needed to go on to a folder."""
        Checkpoint(training=self).save(path)

    def load(self, path: Path) -> None:
        """Go on from a folder that `save` wrote, of a training with the same arguments."""
        Checkpoint(training=self).load(path)

    @abstractmethod
    def state_dict(self) -> dict[str, Any]:
        """All that changes while it trains."""

    @abstractmethod
    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Take over what `state_dict` gave."""
