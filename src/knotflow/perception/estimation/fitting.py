"""A rope's shape by gradient steps on the losses of its rendering (Sec. VI, [15]), with depth; the
rope is a chain of links of equal lengths.

Steps are smoothed along the rope (Nicolet, Jacobson and Jakob, Large Steps in Inverse Rendering of
Geometry, 2021).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn.functional import huber_loss

from knotflow.perception.camera.rendering import (
    LEAST,
    Vector,
    compiled,
    dot,
    link_at,
    minus,
    render,
)
from knotflow.perception.estimation.evidence import Target
from knotflow.simulation import RopeConfig
from knotflow.threads import one_thread
from knotflow.topology.polyline import Floats

_SMOOTHING = 3.0  # how far a vertex takes its neighbours along, links squared
_DEPTH_SCALE = 5e-3  # metres, beyond which errors of depth count linearly
_BENDING, _OVERLAP = 0.05, 0.1  # weights of both losses
_APART = 3  # links along the rope from which on two may overlap
_FAR = 0.015  # metres, from where on a point pulls less the farther it is
_LENGTH, _ALIKE, _STAY = 100.0, 20.0, 0.05  # weights beside one of each point
_ROUNDS = 5  # of registration


@dataclass
class FitConfig:
    """Gradient steps in image space."""

    steps: int = 80
    """Number of gradient steps."""
    step_size: float = 2e-3
    """First step of a coordinate, metres; falls to a tenth as the steps end."""
    softness: tuple[float, float] = (6e-3, 1.5e-3)
    """Softness of the rendering at the first and the last step, metres."""
    depth: float = 1.0
    """Weight of the depth image beside the silhouette; 0 fits to colour alone."""


def project_lengths(points: NDArray, link_length: float) -> Floats:
    """The shape with links of equal length nearest to `points` (V, 3), metres, by Newton's
    method."""
    shape = np.array(points, np.float64)
    for _ in range(50):
        span = np.diff(shape, axis=0)
        length = np.linalg.norm(span, axis=1)
        error = length - link_length
        if np.abs(error).max() < 1e-9 * link_length:
            break
        unit = span / np.maximum(length, 1e-12)[:, None]
        beside = -(unit[1:] * unit[:-1]).sum(1)  # J J^T is tridiagonal: neighbours share a vertex
        gram = 2.0 * np.eye(len(unit)) + np.diag(beside, 1) + np.diag(beside, -1)
        pull = np.linalg.solve(gram, error)[:, None] * unit
        shape[:-1] += pull
        shape[1:] -= pull
    return shape


def nearest_on_chain(points: Floats, chain: Floats) -> tuple[NDArray[np.intp], Floats, Floats]:
    """Where a chain of straight links (V, D) is nearest to points (N, D): the link (N,), the share
    of it that lies before that place (N,), and the way from there to the point (N, D)."""
    links = np.diff(chain, axis=0)
    square = np.maximum((links**2).sum(axis=1), 1e-12)  # seen along itself, a link is a point
    offset = points[:, None] - chain[:-1]  # (N, V - 1, D)
    along = np.clip((offset * links).sum(axis=2) / square, 0.0, 1.0)
    apart = offset - along[..., None] * links
    nearest = (apart**2).sum(axis=2).argmin(axis=1)
    rows = np.arange(len(points))
    return nearest, along[rows, nearest], apart[rows, nearest]


@compiled
def nearest_places(p: Vector, d: Vector, q: Vector, e: Vector) -> tuple[float, float]:
    """Where a segment from p along d and one from q along e are nearest, shares of d and e
    (Ericson, Real-Time Collision Detection, Sec. 5.1.9)."""
    r = minus(p, q)
    dd, ee, de = dot(d, d), dot(e, e), dot(d, e)
    dr, er = dot(d, r), dot(e, r)
    s = min(max((de * er - dr * ee) / (dd * ee - de * de + LEAST), 0.0), 1.0)
    t = min(max((de * s + er) / (ee + LEAST), 0.0), 1.0)
    return min(max((de * t - dr) / (dd + LEAST), 0.0), 1.0), t


@compiled
def overlap(ropes: Floats, radius: float) -> tuple[Floats, Floats]:
    """Squared depth (B,) of the strands of ropes (B, V, 3) in each other, in radii, summed over
    pairs of links, and its gradient (B, V, 3)."""
    loss, slope = np.zeros(len(ropes)), np.zeros_like(ropes)
    links = ropes.shape[1] - 1
    length = np.empty(links)
    for rope in range(len(ropes)):
        for place in range(links):
            _, way = link_at(ropes, rope, place)
            length[place] = np.sqrt(dot(way, way))
        for one in range(links - _APART):
            p, d = link_at(ropes, rope, one)
            for other in range(one + _APART, links):
                q, e = link_at(ropes, rope, other)
                begun = minus(p, q)
                if dot(begun, begun) >= (2 * radius + length[one] + length[other]) ** 2:
                    continue
                s, t = nearest_places(p, d, q, e)
                square = 1e-14
                for k in range(3):
                    square += (begun[k] + s * d[k] - t * e[k]) ** 2
                distance = np.sqrt(square)
                depth = 2.0 - distance / radius
                if depth <= 0:
                    continue
                loss[rope] += depth**2
                # Where two links are nearest does not move, to first order, with their ends.
                for k in range(3):
                    gap = begun[k] + s * d[k] - t * e[k]
                    pull = -2.0 * depth / radius * gap / distance
                    slope[rope, one, k] += (1 - s) * pull
                    slope[rope, one + 1, k] += s * pull
                    slope[rope, other, k] -= (1 - t) * pull
                    slope[rope, other + 1, k] -= t * pull
    return loss, slope


def silhouette_loss(occupancy: Tensor, target: Target) -> Tensor:
    """Squared difference in the coverage (..., H, W) of known pixels, per pixel of rope."""
    difference = (occupancy - target.coverage.to(occupancy)) * target.known
    return difference.square().sum((-2, -1)) / target.mask.sum().clamp(min=1)


def depth_loss(depth: Tensor, occupancy: Tensor, target: Target, scale: float) -> Tensor:
    """Huber loss of the depth (..., H, W) in units of `scale`, metres, per pixel of rope. Pixels
    count by their occupancy, which gets no gradient: leaving a pixel does not explain its depth."""
    both = target.mask & ~target.depth.isnan() & ~depth.isnan()
    error = ((depth - target.depth) / scale).where(both, 0.0)
    each = huber_loss(error, torch.zeros_like(error), reduction="none") * occupancy.detach()
    return each.sum((-2, -1)) / target.mask.sum().clamp(min=1)


def length_loss(points: Tensor, link_length: float) -> Tensor:
    """Squared relative error of the links' lengths, in tenths; points (..., V, 3) metres."""
    lengths = (points[..., 1:, :] - points[..., :-1, :]).norm(dim=-1)
    return ((lengths / link_length - 1) / 0.1).square().mean(-1)


def bending_loss(points: Tensor, link_length: float) -> Tensor:
    """Squared change of bend from vertex to vertex, radians: a loss on bends would shrink loops."""
    bend = torch.diff(points, n=2, dim=-2) / link_length
    return torch.diff(bend, dim=-2).square().sum(-1).mean(-1)


def table_loss(points: Tensor, radius: float) -> Tensor:
    """Squared depth of the rope in the table at z = 0, in radii, the mean over vertices."""
    return (1 - points[..., 2] / radius).clamp(min=0).square().mean(-1)


def overlap_loss(points: Tensor, radius: float) -> Tensor:
    """Squared depth of strands in each other, in radii, summed over pairs of links."""
    ropes = points.reshape(-1, *points.shape[-2:]).double()  # (B, V, 3)
    return _Overlap.apply(ropes, radius).view(points.shape[:-2]).to(points)


class _Overlap(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, ropes: Tensor, radius: float) -> Tensor:
        loss, slope = overlap(np.ascontiguousarray(ropes.detach().numpy()), radius)
        ctx.slope = torch.from_numpy(slope)
        return torch.from_numpy(loss)

    @staticmethod
    def backward(ctx: Any, *slopes: Tensor) -> tuple[Tensor | None, ...]:
        return slopes[0][:, None, None] * ctx.slope, None


def image_loss(
    points: Tensor, target: Target, config: FitConfig, softness: float | None = None
) -> Tensor:
    """How badly a shape (..., V, 3) accounts for an image: silhouette and depth."""
    radius, softness = target.rope.radius, config.softness[1] if softness is None else softness
    depth, occupancy = render(points, radius, target.camera, softness, target.seen_radius)
    off = depth_loss(depth, occupancy, target, _DEPTH_SCALE)
    return silhouette_loss(occupancy, target) + config.depth * off


def shape_loss(points: Tensor, rope: RopeConfig) -> Tensor:
    """How unlike a rope on a table a shape (..., V, 3) is, whatever the image."""
    return (
        length_loss(points, rope.link_length)
        + _BENDING * bending_loss(points, rope.link_length)
        + table_loss(points, rope.radius)
        + _OVERLAP * overlap_loss(points, rope.radius)
    )


def misfit(shape: NDArray, target: Target, config: FitConfig) -> float:
    """Negative logarithm of the likelihood of an image if the rope lies in a shape (V, 3)."""
    with torch.no_grad():
        loss = image_loss(torch.as_tensor(shape), target, config)
    return target.independent_pixels * float(loss)


@one_thread()
def fit(
    points: NDArray,
    target: Target,
    config: FitConfig | None = None,
    prior: Callable[[Tensor], Tensor] | None = None,
) -> NDArray[np.float64]:
    """The shape (V, 3), metres, near a first guess `points` (V, 3) that accounts for an image; many
    guesses (B, V, 3) are fitted each by itself. A `prior` is a further loss of the shape."""
    config = config or FitConfig()
    identity = torch.eye(points.shape[-2], dtype=torch.float64)
    differences = torch.diff(identity, dim=0)
    smooth = torch.linalg.inv(identity + _SMOOTHING * differences.T @ differences)
    start = torch.tensor(np.ascontiguousarray(points, np.float64))
    moves = torch.zeros_like(start, requires_grad=True)
    optimiser = torch.optim.Adam([moves], lr=config.step_size, betas=(0.8, 0.95), fused=True)
    soft, sharp = config.softness
    for step in range(config.steps):
        softness = soft * (sharp / soft) ** (step / max(1, config.steps - 1))
        shape = start + smooth @ moves
        loss = image_loss(shape, target, config, softness)
        loss = loss + shape_loss(shape, target.rope)
        if prior is not None:
            loss = loss + prior(shape)
        optimiser.zero_grad()
        loss.sum().backward()
        optimiser.step()
        optimiser.param_groups[0]["lr"] *= 0.1 ** (1 / config.steps)
    shapes = (start + smooth @ moves).detach().numpy()
    each = shapes.reshape(-1, *shapes.shape[-2:])
    found = [project_lengths(shape, target.rope.link_length) for shape in each]
    return np.stack(found).reshape(shapes.shape)


def register(start: Floats, cloud: Floats, rope: RopeConfig) -> Floats:
    """The shape (V, 3) near `start` (V, 3) that the rope's points (N, 3) lie on, metres: iterated
    closest points (Besl and McKay, 1992) by Gauss-Newton steps, links of constant length."""
    shape = np.array(start, np.float64)
    if len(cloud) == 0:
        return shape
    count = len(shape)
    second = np.diff(np.eye(count), n=2, axis=0)  # (V - 2, V)
    still = np.kron(_ALIKE * second.T @ second + _STAY * np.eye(count), np.eye(3))
    first = np.diff(np.eye(count), axis=0)  # (V - 1, V)
    for _ in range(_ROUNDS):
        links = np.diff(shape, axis=0)
        length = np.linalg.norm(links, axis=1)
        unit = links / length[:, None]
        stretch = (first[:, :, None] * unit[:, None]).reshape(count - 1, -1)  # (V - 1, 3 V)
        pull, towards = _pull(shape, unit, cloud)
        normal = still + pull + _LENGTH * stretch.T @ stretch
        right = towards + _LENGTH * stretch.T @ (rope.link_length - length)
        shape = shape + np.linalg.solve(normal, right).reshape(count, 3)
    shape = project_lengths(shape, rope.link_length)
    shape[:, 2] = np.maximum(shape[:, 2], rope.radius)
    return shape


def _pull(shape: Floats, unit: Floats, cloud: Floats) -> tuple[Floats, Floats]:
    """Normal equations of the points' pull: (3 V, 3 V) and (3 V,)."""
    count = len(shape)
    nearest, share, off = nearest_on_chain(cloud, shape)
    weight = 1.0 / (1.0 + (off**2).sum(axis=1) / _FAR**2)
    beyond = ((nearest == 0) & (share == 0)) | ((nearest == count - 2) & (share == 1))
    t = np.where(beyond[:, None], 0.0, unit[nearest])
    across = weight[:, None, None] * (np.eye(3) - t[:, :, None] * t[:, None])  # (N, 3, 3)
    towards = (across @ off[:, :, None])[..., 0]  # (N, 3)
    matrix, right = np.zeros((count, count, 3, 3)), np.zeros((count, 3))
    ends = ((nearest, 1 - share), (nearest + 1, share))
    for one, part in ends:
        np.add.at(right, one, part[:, None] * towards)
        for other, rest in ends:
            np.add.at(matrix, (one, other), (part * rest)[:, None, None] * across)
    return matrix.transpose(0, 2, 1, 3).reshape(3 * count, 3 * count), right.ravel()
