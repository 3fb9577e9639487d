"""What may go wrong with a robot and its camera while it ties, once in its first action."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from knotflow.execution.robot import Relay, Robot

if TYPE_CHECKING:
    from knotflow.perception import RgbdImage


class Faulty(Relay):
    """A robot that fails, by its own clock, a while after its fingers closed first."""

    after = 1.0
    """Seconds from then on that it works: half of them close the fingers, half drag."""
    lasting = 1.0
    """Seconds that it then fails."""

    def __init__(self, robot: Robot) -> None:
        super().__init__(robot)
        self._left = np.inf

    def move_to(self, position: NDArray, seconds: float) -> None:
        """See `Robot`."""
        super().move_to(position, seconds)
        self._left -= seconds

    def grasp(self) -> None:
        """See `Robot`."""
        super().grasp()
        self._left = min(self._left, self.after)

    @property
    def fails(self) -> bool:
        """Whether it fails now."""
        return -self.lasting < round(self._left, 6) <= 0


class LosesFrames(Faulty):
    """No image arrives for a second of the first drag."""

    def observe(self) -> RgbdImage:
        """See `Robot`."""
        if self.fails:
            raise TimeoutError("the frame was lost")
        return super().observe()


class SeesTable(Faulty):
    """Images show the table alone, from within the first drag until after the first look."""

    lasting = 8.0

    def observe(self) -> RgbdImage:
        """See `Robot`."""
        image = super().observe()
        return bare(image) if self.fails else image


class DropsRope(Faulty):
    """The fingers open by themselves in the middle of the first drag."""

    def move_to(self, position: NDArray, seconds: float) -> None:
        """See `Robot`."""
        worked = not self.fails
        super().move_to(position, seconds)
        if worked and self.fails:
            self.robot.release()


FAULTS: dict[str, type[Relay]] = {
    "": Relay,
    "frames lost": LosesFrames,
    "rope dropped": DropsRope,
    "table alone": SeesTable,
}
"""By the names that tables give them; without a name nothing fails."""


def bare(image: RgbdImage) -> RgbdImage:
    """The image without a rope: all of it is as most of it is, where something is known."""
    from knotflow.perception import RgbdImage

    depth = np.where(np.isnan(image.depth), np.nan, np.nanmedian(image.depth))
    colour = np.median(image.rgb.reshape(-1, 3), axis=0).astype(np.uint8)
    return RgbdImage(np.broadcast_to(colour, image.rgb.shape), depth.astype(np.float32), image.time)
