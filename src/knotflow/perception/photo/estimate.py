"""A rope's centre line and topological state from one colour image, in pixels."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial import cKDTree
from skimage.color import rgb2lab
from skimage.measure import block_reduce

from knotflow.perception.camera.image import ImageError
from knotflow.perception.estimation.crossings import END_AMBIGUITIES, CrossingEvidence
from knotflow.perception.estimation.skeleton import TraceError, passages, rank_paths
from knotflow.perception.photo.colours import NO_HEAD, Colour, Colours, end_of_colour
from knotflow.perception.photo.occlusion import occlusion_odds
from knotflow.perception.photo.silhouette import Silhouette, find_silhouette
from knotflow.topology import DegenerateCurveError, TopologicalState, project
from knotflow.topology.polyline import Floats, arc_lengths, interpolate

_MOST_PIXELS = 1.2e6  # of the image that is worked on; larger ones are binned
_TRACED = 5.0  # pixels across, at which the rope is traced
_STEP, _SMOOTH = 0.25, 0.75  # widths: between points of the centre line, and its smoothing
_MOST_POINTS = 1500
_MIN_CERTAINTY = 0.95  # of a crossing that is not in doubt
_MIN_COVERAGE = 0.97  # share of the silhouette that a centre line accounts for
_RIVAL = 0.4  # squared radians of turning by which a path with other crossings is worse, at most
_SHARP = 2.0  # squared radians of turning at all crossings, which a rope hardly does
_OTHER = 0.15  # of the rope's length, from which another one in view is named
_CUT_OFF = 0.5  # widths from the image's border, within which an end may go on outside


@dataclass(frozen=True, eq=False)
class PhotoEstimate:
    """A rope estimated from a colour image.

    Attributes:
        pixels: (N, 2) centre line, u right and v down; head first, which is the left end where no
            colour tells.
        over: (N,) 1 about the places where it is the upper strand of a crossing, else 0.
        width: of the rope, pixels.
        state: seen from above, the image's v pointing down; None where it cannot be read.
        crossings: in the order met; their gaps in height are NaN.
        doubts: why the state may be another one.
        head_known: whether a colour told the head.
    """

    pixels: Floats
    over: Floats
    width: float
    state: TopologicalState | None
    crossings: tuple[CrossingEvidence, ...]
    doubts: tuple[str, ...]
    head_known: bool = False

    @property
    def length(self) -> float:
        """Of the centre line, pixels."""
        return float(arc_lengths(self.pixels)[-1])


@dataclass(frozen=True, eq=False)
class RopePhoto:
    """An image with a rope in it, in which centre lines are read; pixels are those of `rgb`.

    Attributes:
        rgb: (H, W, 3), binned where the image was large.
        silhouette: the rope's.
        binning: the image's pixels a pixel of `rgb`.
        head_colour: of the head, where it is known.
    """

    rgb: NDArray[np.uint8]
    silhouette: Silhouette
    binning: int
    head_colour: Colour | None = None

    @classmethod
    def of(cls, rgb: NDArray[np.uint8], colours: Colours | None = None) -> RopePhoto:
        """From an image (H, W, 3); arguments and errors are those of `estimate_photo`."""
        binning = math.ceil(math.sqrt(rgb.shape[0] * rgb.shape[1] / _MOST_PIXELS))
        rgb = _binned(rgb, binning).round().astype(np.uint8)
        colours = colours or Colours()
        return cls(rgb, find_silhouette(rgb, colours.rope), binning, colours.head)

    @cached_property
    def _lab(self) -> NDArray[np.float32]:
        return rgb2lab(self.rgb).astype(np.float32)

    def trace(self) -> tuple[Floats, tuple[str, ...]]:
        """The rope's centre line (N, 2), even steps, head or left end first; why it may be another.

        Raises:
            ImageError: no path leads along the silhouette.
        """
        seen = self.silhouette
        factor = max(1, round(seen.width / _TRACED))
        try:
            ranked = rank_paths(_binned(seen.coverage, factor), seen.width / factor, shared=True)
        except TraceError as error:
            raise ImageError(f"no rope is seen: {error}") from error
        lines = [
            (cost, _smooth((path + 0.5) * factor - 0.5, seen.width))
            for cost, path in ranked
            if cost < ranked[0][0] + _RIVAL
        ]
        line = _to_ends(lines[0][1], seen.coverage, seen.width)
        head = self.find_head(line)
        if head == -1 or (head is None and line[0, 0] > line[-1, 0]):
            line = line[::-1]
        doubts = []
        if len({_pairs(one) for _, one in lines}) > 1:
            doubts.append("another path through the crossings is almost as smooth")
        if ranked[0][0] > _SHARP:
            doubts.append("no smooth path leads through the crossings")
        others = [one / seen.length for one in seen.others if one > _OTHER * seen.length]
        if others:
            longest = f"{max(others):.0%} as long"
            doubts.append(
                f"{len(others) + 1} ropes are in view; the longest is taken, another is {longest}"
            )
        return line, tuple(doubts)

    def find_head(self, line: Floats) -> int | None:
        """The end of a line (N, 2), 0 or -1, that has the head's colour, if that is known."""
        colour = self.head_colour
        return None if colour is None else end_of_colour(self.rgb, line, colour)

    def crossings(self, line: Floats) -> tuple[CrossingEvidence, ...]:
        """Those of a centre line (N, 2) with even steps, in the order met."""
        met = passages(np.pad(line, ((0, 0), (0, 1))))
        met = met[np.argsort(met[:, 0])]
        last = len(line) - 1
        found = []
        for first, second in met:
            odds = occlusion_odds(self._lab, line, (first, second), self.silhouette.width)
            certainty = 1 / (1 + math.exp(-min(abs(odds), 50.0)))
            places = float(first / last), float(second / last)
            found.append(CrossingEvidence(places, odds > 0, math.nan, certainty))
        return tuple(found)

    def read(self, line: Floats, crossings: tuple[CrossingEvidence, ...]) -> PhotoEstimate:
        """What a centre line (N, 2) with even steps and its crossings amount to."""
        seen = self.silhouette
        over = _over(crossings, line, seen.width)
        state = _state(line, over)
        doubts = (
            *_line_doubts(line, seen.coverage, seen.width),
            *_crossing_doubts(crossings, state),
        )
        known = self.find_head(line) is not None
        if self.head_colour and not known:
            doubts = (*doubts, NO_HEAD)
        return PhotoEstimate(line, over, seen.width, state, crossings, doubts, known)


def estimate_photo(rgb: NDArray[np.uint8], colours: Colours | None = None) -> PhotoEstimate:
    """The rope in an image (H, W, 3) of a table from above; `colours` where other things are in it.

    Raises:
        ImageError: no rope is seen.
    """
    photo = RopePhoto.of(rgb, colours)
    line, doubts = photo.trace()
    found = photo.read(line, photo.crossings(line))
    return replace(
        found,
        pixels=(line + 0.5) * photo.binning - 0.5,
        width=photo.binning * found.width,
        doubts=(*found.doubts, *doubts),
    )


def _binned(image: NDArray, factor: int) -> NDArray:
    """Means of squares of `factor` pixels a side."""
    height, width = (size // factor * factor for size in image.shape[:2])
    block = (factor, factor, 1)[: image.ndim]
    return np.asarray(block_reduce(image[:height, :width], block, np.mean), np.float32)


def _smooth(path: Floats, width: float) -> Floats:
    """The path (N, 2) with even steps and without its raggedness."""
    along = arc_lengths(path)
    count = int(min(_MOST_POINTS, max(8, along[-1] / (_STEP * width))))
    even = interpolate(np.linspace(0, along[-1], count), along, path)
    sigma = _SMOOTH * width / (along[-1] / count)
    pad = min(count - 1, math.ceil(3 * sigma))
    padded = np.pad(even, ((pad, pad), (0, 0)), "reflect", reflect_type="odd")
    return np.asarray(ndimage.gaussian_filter1d(padded, sigma, axis=0)[pad : pad + count])


def _to_ends(line: Floats, coverage: NDArray[np.float32], width: float) -> Floats:
    """The line (N, 2) prolonged to where the silhouette ends: a skeleton stops short of that."""
    step = float(arc_lengths(line)[-1]) / (len(line) - 1)
    back = min(len(line) - 1, max(1, round(width / step)))
    parts = [line]
    for end, inner, place in ((line[0], line[back], 0), (line[-1], line[-1 - back], 2)):
        ahead = (end - inner) / max(float(np.linalg.norm(end - inner)), 1e-9)
        further = end + step * np.arange(1, round(1.5 * width / step) + 1)[:, None] * ahead
        on = ndimage.map_coordinates(coverage, further.T[::-1], order=1) > 0.5
        kept = further[: len(on) if on.all() else int(on.argmin())]
        parts.insert(place, kept[::-1] if place == 0 else kept)
    return np.concatenate(parts)


def _over(crossings: tuple[CrossingEvidence, ...], line: Floats, width: float) -> Floats:
    """(N,) 1 within a width of each upper passage, or halfway to the next one."""
    last = len(line) - 1
    index = np.arange(len(line))
    step = float(arc_lengths(line)[-1]) / last
    over = np.zeros(len(line))
    places = last * np.sort([place for one in crossings for place in one.fractions])
    for one in crossings:
        at = last * one.fractions[0 if one.first_over else 1]
        gaps = np.abs(places - at)
        reach = min(width / step, float(gaps[gaps > 1e-6].min()) / 2)
        over[np.abs(index - at) <= max(reach, 1.0)] = 1.0
    return over


def _state(line: Floats, over: Floats) -> TopologicalState | None:
    curve = np.column_stack([line[:, 0], -line[:, 1], over])
    try:
        return TopologicalState.from_crossings(project(curve, min_gap=0.1).crossings)
    except DegenerateCurveError:
        return None


def _pairs(line: Floats) -> frozenset[frozenset[tuple[int, int]]]:
    """Which positions along a line (N, 2) meet at crossings, from either end."""
    met = passages(np.pad(line, ((0, 0), (0, 1))))
    places = np.sort(met.ravel())
    pairs = [(int(a) + 1, int(b) + 1) for a, b in np.searchsorted(places, met)]
    last = len(places) + 1
    return frozenset((frozenset(pairs), frozenset((last - b, last - a) for a, b in pairs)))


def _line_doubts(line: Floats, coverage: NDArray[np.float32], width: float) -> list[str]:
    doubts = []
    height, across = coverage.shape
    border = np.minimum(line, [across - 1, height - 1] - line).min(axis=1)
    outside = int((border[[0, -1]] < _CUT_OFF * width).sum())
    if outside:
        ends = "an end lies" if outside == 1 else "both ends lie"
        doubts.append(f"{ends} at the image's border: the rope may go on outside")
    rows, columns = np.nonzero(coverage > 0.5)
    off, _ = cKDTree(line).query(np.column_stack([columns, rows]), distance_upper_bound=width)
    accounted = float((off < 0.8 * width).mean())
    if accounted < _MIN_COVERAGE:
        doubts.append(f"the centre line accounts for {accounted:.0%} of the rope in the image")
    own = round(math.pi * width / (float(arc_lengths(line)[-1]) / (len(line) - 1)))
    for end, turned in ((0, line), (-1, line[::-1])):
        rest = turned[own:]
        if len(rest) and np.linalg.norm(rest - turned[0], axis=1).min() < 0.6 * width:
            doubts.append(END_AMBIGUITIES[end])
    return doubts


def _crossing_doubts(
    crossings: tuple[CrossingEvidence, ...], state: TopologicalState | None
) -> list[str]:
    doubts = [
        f"crossing {number}: which strand is on top cannot be told ({one.certainty:.0%})"
        for number, one in enumerate(crossings, 1)
        if one.certainty < _MIN_CERTAINTY
    ]
    if state is None or state.num_crossings != len(crossings):
        doubts.append("the centre line does not determine the state")
    return doubts
