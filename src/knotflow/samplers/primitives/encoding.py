"""Encoding of ropes, actions and splines for the networks (Sec. V-A, Fig. 4).

The rope is brought to the canonical action (`canonical`) and into a frame that moves along with it.
The origin is on the under segment, where the robot moves to: its midpoint, or the tip of the head
where that is covered (primitive 4); where a segment is laid over itself (R1, R2(i,i)), the middle
of the outer third that will be under. The x axis points along the rope there, from head to tail.

Three streams of points, evenly spaced along the rope: the over segment, the under segment, and the
whole rope. R1 uses one segment for both, R2(i,i) its halves. Splines are normalised: x and y lie in
this frame, and the grasp counts along the over segment, or from its tip where that is the rope's
end (primitive 3).

Undoing (primitive 6) pulls a piece of rope, the first stream, off a strand, the second; channels
say which is over. The origin is the crossing on the strand (of R2, the middle between the two), and
the x axis runs along the strand. The grasp counts from the piece's middle or, where it is the
rope's end, from its crossing. Arranging (primitive 5) is encoded as the action wanted next, but its
grasp counts along the whole rope.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from knotflow.samplers.primitives.canonical import (
    UNDO,
    Canonical,
    anchor_of,
    canonicalise,
    grasp_of,
    kinds_of,
    marks_of,
    streams_of,
)
from knotflow.simulation import NOMINAL, SPLINE_HIGH, SPLINE_LOW, RopeConfig
from knotflow.topology import Action
from knotflow.topology.polyline import Floats, arc_lengths

if TYPE_CHECKING:
    from tensordict import TensorDict

STREAM_POINTS = (10, 10, 24)
"""Points of the over, the under and the whole stream."""
CHANNELS = 10
"""Of each stream point: x, y, z, position along the rope, direction x and y, whether it is on the
over and on the under segment, and `proportions` of the rope."""
KINDS = UNDO + 1
"""Length of "kind", which gives arranging what is wanted: 1 at the number of each of `kinds_of`."""

PLANE_SCALE = 0.2
"""Metres a unit of x and y in network space."""
HEIGHT_CENTRE, HEIGHT_SCALE = 0.07, 0.035
"""Height that is 0 in network space, and metres a unit."""
POINT_HEIGHT_SCALE = 0.02
"""Metres a unit of a rope point's z; about the thickness of the rope."""

_LEAST_BENDING = 0.05  # relative to the nominal rope, of one without stiffness
_TANGENT = 0.03  # of the rope's length to each side, over which a point's direction is taken


@dataclass(frozen=True)
class Frames:
    """The frames of S ropes; turns splines between the world and network space, both float64."""

    origin: Floats  # (S, 2) metres, on the canonical rope
    axis: Floats  # (S, 2) unit x axis
    # (S, 2) the grasp that is 0 in network space and a unit of it, fractions of the canonical
    # rope's length
    grasp: Floats
    mirror: NDArray[np.bool_]  # (S,) whether the canonical rope is mirrored
    reverse: NDArray[np.bool_]  # (S,) whether it is reversed

    def __len__(self) -> int:
        return len(self.origin)

    def __getitem__(self, rows: slice | NDArray[np.intp]) -> Frames:
        return Frames(*(getattr(self, one.name)[rows] for one in fields(self)))

    def to_network(self, splines: Floats) -> Floats:
        """Splines (S, K, 6) of the world, see `simulation.spline`, in network space."""
        canonical = self._transformed(np.asarray(splines, dtype=np.float64))
        out = np.empty_like(canonical)
        out[..., 0] = (canonical[..., 0] - self.grasp[:, 0, None]) / self.grasp[:, 1, None]
        out[..., 1:3] = self._into(canonical[..., 1:3])
        out[..., 3] = (canonical[..., 3] - HEIGHT_CENTRE) / HEIGHT_SCALE
        out[..., 4:6] = self._into(canonical[..., 4:6])
        return out

    def to_world(self, splines: Floats) -> Floats:
        """Splines (S, K, 6) of network space in the world, clipped into range."""
        splines = np.asarray(splines, dtype=np.float64)
        out = np.empty_like(splines)
        out[..., 0] = self.grasp[:, 0, None] + splines[..., 0] * self.grasp[:, 1, None]
        out[..., 1:3] = self._out_of(splines[..., 1:3])
        out[..., 3] = splines[..., 3] * HEIGHT_SCALE + HEIGHT_CENTRE
        out[..., 4:6] = self._out_of(splines[..., 4:6])
        # The range is symmetric under Mirror and Reverse, so clipping keeps the law.
        return self._transformed(np.clip(out, SPLINE_LOW, SPLINE_HIGH))

    def _into(self, xy: Floats) -> Floats:
        shifted = (xy - self.origin[:, None]) / PLANE_SCALE
        cos, sin = self.axis[:, 0, None], self.axis[:, 1, None]
        x, y = shifted[..., 0], shifted[..., 1]
        return np.stack([cos * x + sin * y, cos * y - sin * x], axis=-1)

    def _out_of(self, xy: Floats) -> Floats:
        cos, sin = self.axis[:, 0, None], self.axis[:, 1, None]
        x, y = xy[..., 0], xy[..., 1]
        turned = np.stack([cos * x - sin * y, sin * x + cos * y], axis=-1)
        return turned * PLANE_SCALE + self.origin[:, None]

    def _transformed(self, splines: Floats) -> Floats:
        """World splines as canonical ones and back: Mirror and Reverse are involutions."""
        out = splines.copy()
        out[..., [2, 5]] *= np.where(self.mirror, -1.0, 1.0)[:, None, None]
        out[..., 0] = np.where(self.reverse[:, None], 1 - out[..., 0], out[..., 0])
        return out


@dataclass(frozen=True)
class Encoded:
    """S ropes with an action each, as the networks of one primitive see them.

    `inputs` have "streams" (S, sum of STREAM_POINTS, CHANNELS) and "grasp" (S, 2), float32; for
    arranging also "kind" (S, KINDS), what is wanted next.
    """

    inputs: Mapping[str, Tensor]
    frames: Frames

    @property
    def states(self) -> TensorDict:
        """The inputs [S], for training."""
        from tensordict import TensorDict  # which loads all of torch's compiler

        return TensorDict(dict(self.inputs), batch_size=[len(self.frames)])


def proportions(rope: RopeConfig) -> tuple[float, float]:
    """Logarithms of a rope's diameter and bending length in lengths; 0 of the nominal rope's."""
    thick, bending = (
        getattr(rope, name) / rope.length / (getattr(NOMINAL, name) / NOMINAL.length)
        for name in ("radius", "bending_length")
    )
    return float(np.log(thick)), float(np.log(max(bending, _LEAST_BENDING)))


def encode(
    points: Sequence[Floats] | Floats,
    actions: Sequence[Action],
    arranging: bool = False,
    rope: RopeConfig | None = None,
) -> Encoded:
    """Encode S shapes (V, 3) of a rope, by default the nominal one, with an action each, for its
    primitive, or for arranging before it.

    Raises:
        IllegalActionError, DegenerateCurveError: see `canonicalise`.
    """
    ropes = [canonicalise(p, a, rope) for p, a in zip(points, actions, strict=True)]
    return encode_canonical(ropes, arranging)


def encode_canonical(ropes: Sequence[Canonical], arranging: bool = False) -> Encoded:
    """Encode ropes that were brought to the learned counterpart; see `encode`."""
    parts = [_encode_one(rope, arranging) for rope in ropes]
    streams, origin, axis, grasp = (np.stack(part) for part in zip(*parts, strict=True))
    mirror = np.array([rope.symmetry.mirror for rope in ropes])
    reverse = np.array([rope.symmetry.reverse for rope in ropes])
    inputs = {
        "streams": torch.from_numpy(streams).float(),
        "grasp": torch.from_numpy(grasp).float(),
    }
    if arranging:
        kind = torch.zeros(len(ropes), KINDS)
        for row, rope in enumerate(ropes):
            kind[row, list(kinds_of(rope.action, len(rope.segments)))] = 1
        inputs["kind"] = kind
    return Encoded(inputs, Frames(origin, axis, grasp, mirror, reverse))


def _encode_one(rope: Canonical, arranging: bool) -> tuple[Floats, Floats, Floats, Floats]:
    """Streams (P, CHANNELS), origin (2,), axis (2,) and grasp (2,), as in `Frames`."""
    over, under = marks_of(rope)
    anchor, reach = anchor_of(rope)
    vertices = rope.points
    along = arc_lengths(vertices)
    along /= along[-1]
    spans = zip([*streams_of(rope), np.array([0.0, 1.0])], STREAM_POINTS, strict=True)
    at = np.concatenate([np.linspace(begin, end, count) for (begin, end), count in spans])
    low, high = np.clip(at - _TANGENT, 0, 1), np.clip(at + _TANGENT, 0, 1)
    origin_at = np.array([anchor, max(anchor - reach, 0.0), min(anchor + reach, 1.0)])
    sites = np.concatenate([at, low, high, origin_at])
    x, y, z = (np.interp(sites, along, vertices[:, k]) for k in range(3))
    origin = np.array([x[-3], y[-3]])
    cos, sin = _unit(x[-1] - x[-2], y[-1] - y[-2])
    n = len(at)
    dx, dy = (x[:n] - origin[0]) / PLANE_SCALE, (y[:n] - origin[1]) / PLANE_SCALE
    tx, ty = _unit(x[2 * n : 3 * n] - x[n : 2 * n], y[2 * n : 3 * n] - y[n : 2 * n])
    streams = np.stack(
        [
            cos * dx + sin * dy,
            cos * dy - sin * dx,
            z[:n] / POINT_HEIGHT_SCALE,
            2 * at - 1,
            cos * tx + sin * ty,
            cos * ty - sin * tx,
            (at >= over[0]) & (at <= over[1]),
            (at >= under[0]) & (at <= under[1]),
            *(np.full(n, one) for one in proportions(rope.rope)),
        ],
        axis=1,
    )
    return streams, origin, np.array([cos, sin]), grasp_of(rope, arranging)


def _unit(x: Floats, y: Floats) -> tuple[Floats, Floats]:
    length = np.maximum(np.hypot(x, y), 1e-9)
    return x / length, y / length


def control_features(states: Mapping[str, Tensor], splines: Tensor) -> Tensor:
    """The critic's input (S, n, 12) for splines (S, n, 6) in network space on ropes [S].

    The spline; position along the rope; the grasped point's x, y, z and direction x, y.
    """
    centre, unit = states["grasp"][:, None].chunk(2, dim=2)
    grasp = (centre + unit * splines[..., :1]).clamp(0, 1)  # (S, n, 1)
    count = STREAM_POINTS[-1]
    position = grasp * (count - 1)
    low = position.floor().clamp(max=count - 2)
    rope = states["streams"][:, -count:]  # (S, count, CHANNELS)
    row = low.long().expand(-1, -1, CHANNELS)
    held = torch.lerp(rope.gather(1, row), rope.gather(1, row + 1), position - low)
    return torch.cat([splines, 2 * grasp - 1, held[..., [0, 1, 2, 4, 5]]], dim=-1)


CONTROL_FEATURES = 12
GRASP_POSITION = (0, 1, 1, 1, 1, 1, 0, 1, 1, 1, 0, 0)
"""Of these, those that say where the rope is grasped by the point's position alone."""
