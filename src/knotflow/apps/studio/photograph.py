"""A photograph's rope, as estimated and then corrected by a person; knows no browser."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import linear_sum_assignment

from knotflow.perception.estimation.crossings import CrossingEvidence
from knotflow.perception.photo.colours import Colours
from knotflow.perception.photo.estimate import PhotoEstimate, RopePhoto
from knotflow.perception.photo.io import on_table
from knotflow.planning import MeasuredRope, RopeOptions, RopeTable, measured_rope
from knotflow.planning.rope.size import RopeSize, parse_metres
from knotflow.topology import TopologicalState
from knotflow.topology.polyline import Floats, arc_lengths, interpolate

_SPACING, _MOST_HANDLES = 6.0, 32  # widths between handles
_CLEAR = 2.5  # widths between a handle and a crossing
_REACH = 10.0  # widths along the line on either side, within which it follows a dragged handle
_SAME = 0.12  # of the length, both passages together, by which a drag moves a crossing


class PhotoError(ValueError):
    """A correction that is impossible, or a rope that is still in doubt."""


class Photograph:
    """A photograph, and the centre line in it that a person corrects.

    Pixels are those of `rgb`, u right and v down.

    Attributes:
        name: of its file.
        rgb: (H, W, 3) the photograph, at most about a megapixel.
        found: the rope as it is now.
        length, diameter: of the rope, as texts such as 0.9m; without a diameter it is as wide as
            in the photograph.
    """

    def __init__(self, name: str, rgb: NDArray[np.uint8], colour: str = "") -> None:
        """Estimate the rope in an image (H, W, 3), of a colour's name or #rrggbb if given.

        Raises:
            ImageError: no rope is seen, or no such colour.
        """
        self.name, self.length, self.diameter = name, "", ""
        self._photo = RopePhoto.of(rgb, Colours.parse(colour))
        self.rgb = self._photo.rgb
        line, self._path_doubts = self._photo.trace()
        self.found = self._photo.read(line, self._photo.crossings(line))
        self._said: tuple[bool, ...] = (False,) * len(self.found.crossings)
        self._accepted: frozenset[str] = frozenset()
        self._history: list[tuple[PhotoEstimate, tuple[bool, ...], frozenset[str]]] = []

    @property
    def state(self) -> TopologicalState | None:
        """Seen from above; None where the centre line does not determine it."""
        return self.found.state

    @property
    def doubts(self) -> tuple[str, ...]:
        """Why the rope may be another one, without what was confirmed."""
        found = (*self.found.doubts, *self._path_doubts)
        return tuple(one for one in found if one not in self._accepted)

    @property
    def places(self) -> Floats:
        """(C, 2) of the crossings, pixels."""
        index = np.arange(len(self.found.pixels))
        at = index[-1] * np.array([one.fractions[0] for one in self.found.crossings])
        return interpolate(at, index, self.found.pixels)

    @property
    def handles(self) -> NDArray[np.int64]:
        """(K,) indices of the centre line at which it is dragged, the ends among them."""
        line, width = self.found.pixels, self.found.width
        count = int(np.clip(self.found.length / width / _SPACING, 2, _MOST_HANDLES))
        index = np.linspace(0, len(line) - 1, count + 1).round().astype(int)
        apart = np.linalg.norm(line[index, None] - self.places, axis=2)
        clear = (apart > _CLEAR * width).all(axis=1)
        clear[[0, -1]] = True
        return index[clear]

    def dragged(self, handle: int, place: ArrayLike) -> Floats:
        """The centre line (N, 2) with a handle at a place (2,), pixels, and its neighbourhood
        following."""
        line, held = self.found.pixels, self.handles[handle]
        step = self.found.length / (len(line) - 1)
        off = np.abs(np.arange(len(line)) - held) * step / (_REACH * self.found.width)
        follows = np.cos(np.pi / 2 * np.minimum(off, 1.0)) ** 2
        bent: Floats = line + follows[:, None] * (np.asarray(place) - line[held])
        return bent

    def drag(self, handle: int, place: ArrayLike) -> None:
        """Drag a handle to a place (2,), pixels. Which strand is on top is read again in the
        photograph, but for crossings of which it was said."""
        height, width = self.rgb.shape[:2]
        bent = self.dragged(handle, np.clip(place, 0, [width - 1, height - 1]))
        along = arc_lengths(bent)
        even = np.linspace(0.0, along[-1], len(bent))
        line = interpolate(even, along, bent)
        crossings = list(self._photo.crossings(line))
        said = [False] * len(crossings)
        apart = np.abs(_fractions(crossings)[:, None] - _fractions(self.found.crossings)).sum(2)
        for now, before in zip(*linear_sum_assignment(apart), strict=True):
            if self._said[before] and apart[now, before] < _SAME:
                was, said[now] = self.found.crossings[before], True
                crossings[now] = replace(crossings[now], first_over=was.first_over, certainty=1.0)
        self._change(line, crossings, said)

    def swap(self, number: int) -> None:
        """Turn a crossing, counted from 0 in the order met: its lower strand is the upper one."""
        crossings, said = list(self.found.crossings), list(self._said)
        if number not in range(len(crossings)):
            raise PhotoError("that crossing is gone: click again")
        over = not crossings[number].first_over
        crossings[number] = replace(crossings[number], first_over=over, certainty=1.0)
        said[number] = True
        self._change(self.found.pixels, crossings, said)

    def reverse(self) -> None:
        """Call the tail the head."""
        crossings = self.found.crossings
        turned = [(one.reversed(), said) for one, said in zip(crossings, self._said, strict=True)]
        turned.sort(key=lambda one: one[0].fractions)
        line = self.found.pixels[::-1].copy()
        self._change(line, [one for one, _ in turned], [said for _, said in turned])

    def confirm(self) -> None:
        """Say that the rope is as it is shown.

        Raises:
            PhotoError: its state cannot be read.
        """
        if self.state is None:
            raise PhotoError(
                "the centre line does not determine the state: drag it so that strands cross "
                "clearly, and no end lies on a strand"
            )
        doubts = self.doubts
        sure = [replace(one, certainty=1.0) for one in self.found.crossings]
        self._change(self.found.pixels, sure, [True] * len(sure))
        self._accepted |= {*doubts}

    def undo(self) -> None:
        """Take the last change back."""
        if not self._history:
            raise PhotoError("there is no change to undo")
        self.found, self._said, self._accepted = self._history.pop()

    @property
    def size(self) -> RopeSize:
        """The rope's, from its length, and from its diameter or its width in the photograph.

        Raises:
            PhotoError: no length.
            RopeInputError: a length or diameter that cannot be read or be a rope's.
        """
        if not self.length.strip():
            raise PhotoError("a photograph has no scale: write the rope's length, such as 0.9m")
        metres = parse_metres(self.length, "the length")
        width = f"{metres * self.found.width / self.found.length:.4g}"
        return RopeSize.of(metres, self.diameter.strip() or width)

    def rope(self) -> MeasuredRope:
        """The rope that lies in the photograph.

        Raises:
            PhotoError: it is in doubt, or its length is not known.
            RopeInputError: a rope of this size cannot lie so.
        """
        size = self.size
        if self.state is None:
            self.confirm()
        if self.doubts:
            raise PhotoError(
                f"the photograph's rope is in doubt: {'; '.join(self.doubts)}. Correct it, or "
                "confirm that it is right"
            )
        options = RopeOptions(length=f"{size.length:.9g}", diameter=f"{size.diameter:.9g}")
        xy = on_table(self.found, size.length, None)
        table = RopeTable(xy, "m", self.found.over, name=self.name)
        measured = measured_rope(table, options, np.random.default_rng())
        laid = TopologicalState.from_curve(measured.points)
        if laid != self.state:
            raise PhotoError(f"as a rope of this size it is in the state {laid}, not {self.state}")
        return measured

    def _change(self, line: Floats, crossings: list[CrossingEvidence], said: list[bool]) -> None:
        self._history.append((self.found, self._said, self._accepted))
        self.found = self._photo.read(line, tuple(crossings))
        self._said = tuple(said)
        self._accepted &= {*self.found.doubts, *self._path_doubts}


def _fractions(crossings: list[CrossingEvidence] | tuple[CrossingEvidence, ...]) -> Floats:
    """(C, 2) where the crossings are met."""
    return np.array([one.fractions for one in crossings]).reshape(-1, 2)
