"""A rope as a camera sees it, differentiable in its vertices (Sec. VI, extended to depth).

A rope is a chain of capsules. A pixel's ray passes each link at some distance d, and the link
covers it by alpha = sigmoid((radius - d) / softness); links are composited front to back.

Compiled loops render the pixels near links, with gradients by hand. A pixel is a flat index into B
images, a link one into B ropes of E links each. Loops are cached by the file they are in: after a
change to a function that another file's loops use, empty `__pycache__`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from numba import njit
from numpy.typing import NDArray
from torch import Tensor

from knotflow.perception.camera.pinhole import Camera

compiled = njit(cache=True, error_model="numpy")

LEAST = 1e-12  # keeps divisors from zero
Vector = tuple[float, float, float]
_REACH = 5.0  # softnesses from a link's surface, where alpha is below 1 %
_GRAZING = 0.1  # of the squared radius: bounds the slope of a link's surface at its silhouette
_STEEPEST = 0.3  # sine of the angle between ray and link, below which a link is seen end on


@compiled
def dot(one: Vector, other: Vector) -> float:
    """Scalar product."""
    return one[0] * other[0] + one[1] * other[1] + one[2] * other[2]


@compiled
def minus(one: Vector, other: Vector) -> Vector:
    """Difference of two vectors."""
    return one[0] - other[0], one[1] - other[1], one[2] - other[2]


@compiled
def vertex_at(ropes: NDArray[np.float64], rope: int, place: int) -> Vector:
    """Vertex of one of several ropes."""
    return ropes[rope, place, 0], ropes[rope, place, 1], ropes[rope, place, 2]


@compiled
def link_at(ropes: NDArray[np.float64], rope: int, place: int) -> tuple[Vector, Vector]:
    """Begin of a link of ropes (B, V, 3), and the way from there to its end."""
    begin = vertex_at(ropes, rope, place)
    return begin, minus(vertex_at(ropes, rope, place + 1), begin)


@compiled
def _span(x: float, z: float, reach: float, focal: float, centre: float) -> tuple[float, float]:
    """Extent of a ball around (x, z) along one axis of the image."""
    aside = reach * np.sqrt(x * x + z * z - reach * reach)
    below = z * z - reach * reach
    return focal * (x * z - aside) / below + centre, focal * (x * z + aside) / below + centre


@compiled
def _window(start: Any, end: Any, reach: float, eye: Any, size: int, axis: int) -> tuple[int, int]:
    """First and last row or column of pixels that may see a link; an empty range where none do."""
    focal, centre = eye[axis], eye[2 + axis]
    one = _span(start[axis], start[2], reach, focal, centre)
    other = _span(end[axis], end[2], reach, focal, centre)
    low = max(0.0, np.floor(min(one[0], other[0])))
    high = min(size - 1.0, np.ceil(max(one[1], other[1])))
    return (int(low), int(high)) if low <= high else (0, -1)


@compiled
def _ray(column: int, row: int, eye: Any) -> Vector:
    """The unit direction of a pixel's ray."""
    x, y = (column - eye[2]) / eye[0], (row - eye[3]) / eye[1]
    deep = 1.0 / np.sqrt(x * x + y * y + 1.0)
    return x * deep, y * deep, deep


@compiled
def _nearest(a: Vector, link: Vector, r: Vector) -> tuple[float, float, float, float, float, float]:
    """Where a ray passes a link that begins at `a`.

    Returns:
        ahead, onward: along the ray, where the link begins, and how much further it ends.
        square, skew: of the link's way across the ray, its square and its product with the way
            from the ray to `a`.
        along, distance: place along the link (0..1) nearest to the ray, and squared distance there.
    """
    ahead, onward = dot(a, r), dot(link, r)
    square = skew = 0.0
    for k in range(3):
        across = link[k] - onward * r[k]
        square += across * across
        skew += (a[k] - ahead * r[k]) * across
    along = min(max(-skew / (square + LEAST), 0.0), 1.0)
    distance = 0.0
    for k in range(3):
        offset = a[k] - ahead * r[k] + along * (link[k] - onward * r[k])
        distance += offset * offset
    return ahead, onward, square, skew, along, distance


@compiled
def _share(inside: float) -> tuple[float, float]:
    """The logistic function, and one less it, equally exact."""
    if inside >= 0:
        small = np.exp(-inside)
        return 1.0 / (1.0 + small), small / (1.0 + small)
    small = np.exp(inside)
    return small / (1.0 + small), 1.0 / (1.0 + small)


@compiled
def composite(
    ropes: NDArray[np.float64],
    radius: float,
    seen_radius: float,
    softness: float,
    reach: float,
    eye: NDArray[np.float64],
    height: int,
    width: int,
) -> tuple[Any, ...]:
    """Ropes (B, V, 3), metres, camera's frame, each rendered into an image of its own; pixels up to
    `reach` metres from a link see it; `eye` is fx, fy, cx, cy.

    Returns:
        depth, occupancy: (B * H * W,) as of `render`.
        pixel, link, weight, deep: (P,) pairs of a pixel and a link that it sees, by pixel and front
            to back: their indices, the share of the pixel that the link covers, its depth, metres.
    """
    count, links = len(ropes), ropes.shape[1] - 1
    area = height * width
    depth, occupancy = np.full(count * area, np.nan), np.zeros(count * area)
    windows = np.zeros((count * links, 4), np.int64)
    most = 0
    for number in range(count * links):
        start = vertex_at(ropes, number // links, number % links)
        end = vertex_at(ropes, number // links, number % links + 1)
        if min(start[2], end[2]) > reach and np.isfinite(sum(start) + sum(end)):
            left, right = _window(start, end, reach, eye, width, 0)
            top, bottom = _window(start, end, reach, eye, height, 1)
            windows[number] = left, right + 1, top, bottom + 1
            most += (right + 1 - left) * (bottom + 1 - top)
    pixel, link = np.empty(most, np.int64), np.empty(most, np.int64)
    weight, deep = np.empty(most), np.empty(most)
    found_pixel, found_link = np.empty(most, np.int64), np.empty(most, np.int64)
    found_inside, found_deep, inside = np.empty(most), np.empty(most), np.empty(most)
    begins = np.empty(area + 1, np.int64)
    done = 0
    for image in range(count):
        found = 0
        begins[:] = 0
        for number in range(image * links, (image + 1) * links):
            a, way = link_at(ropes, image, number - image * links)
            length = dot(way, way) + LEAST
            left, right, top, bottom = windows[number]
            for row in range(top, bottom):
                for column in range(left, right):
                    ray = _ray(column, row, eye)
                    ahead, onward, square, _, along, apart = _nearest(a, way, ray)
                    if apart >= reach * reach:
                        continue
                    distance = np.sqrt(apart + 1e-14)
                    chord = np.sqrt(max(radius**2 - distance**2, _GRAZING * radius**2))
                    sine = np.sqrt(max(square / length, _STEEPEST**2))
                    found_pixel[found], found_link[found] = row * width + column, number
                    found_inside[found] = (seen_radius - distance) / softness
                    found_deep[found] = (ahead + along * onward - chord / sine) * ray[2]
                    begins[row * width + column + 1] += 1
                    found += 1
        for at in range(area):
            begins[at + 1] += begins[at]
        # By pixel, and front to back within each.
        filled = begins[:-1].copy()
        for pair in range(found):
            first, at = done + begins[found_pixel[pair]], done + filled[found_pixel[pair]]
            filled[found_pixel[pair]] += 1
            while at > first and deep[at - 1] > found_deep[pair]:
                link[at], inside[at], deep[at] = link[at - 1], inside[at - 1], deep[at - 1]
                at -= 1
            link[at], inside[at], deep[at] = found_link[pair], found_inside[pair], found_deep[pair]
        for at in range(area):
            if begins[at] == begins[at + 1]:
                continue
            left_over, covered, summed = 1.0, 0.0, 0.0
            for pair in range(done + begins[at], done + begins[at + 1]):
                share, rest = _share(inside[pair])
                pixel[pair], weight[pair] = image * area + at, share * left_over
                covered += weight[pair]
                summed += weight[pair] * deep[pair]
                left_over *= rest
            depth[image * area + at] = summed / (covered + LEAST)
            occupancy[image * area + at] = covered
        done += found
    return depth, occupancy, pixel[:done], link[:done], weight[:done], deep[:done]


@compiled
def composite_gradient(
    ropes: NDArray[np.float64],
    radius: float,
    seen_radius: float,
    softness: float,
    eye: NDArray[np.float64],
    height: int,
    width: int,
    composited: tuple[Any, ...],
    depth_slope: NDArray[np.float64],
    occupancy_slope: NDArray[np.float64],
) -> NDArray[np.float64]:
    """The gradient (B, V, 3) of a loss by the ropes' vertices, from the arguments and the result of
    `composite` and the loss's gradients (B * H * W,) by depth and occupancy."""
    depth, occupancy, pixel, link, weight, deep = composited
    links = ropes.shape[1] - 1
    slope = np.zeros_like(ropes)
    behind = 0.0  # what the links behind lose where this one covers more
    for pair in range(len(pixel) - 1, -1, -1):
        at, number = pixel[pair], link[pair]
        if pair == len(pixel) - 1 or pixel[pair + 1] != at:
            behind = 0.0
        covered = occupancy[at] + LEAST
        by_weight = occupancy_slope[at] + depth_slope[at] * (deep[pair] - depth[at]) / covered
        by_deep = depth_slope[at] * weight[pair] / covered
        image, place = number // links, number % links
        a, way = link_at(ropes, image, place)
        length = dot(way, way) + LEAST
        in_image = at - image * height * width
        ray = _ray(in_image % width, in_image // width, eye)
        ahead, onward, square, skew, along, apart = _nearest(a, way, ray)
        distance = np.sqrt(apart + 1e-14)
        share, rest = _share((seen_radius - distance) / softness)
        by_distance = (share * behind - by_weight * weight[pair] * rest) / softness
        behind += by_weight * weight[pair]

        full, steep = radius**2 - distance**2, square / length
        chord = np.sqrt(max(full, _GRAZING * radius**2))
        sine = np.sqrt(max(steep, _STEEPEST**2))
        by_reached = by_deep * ray[2]
        if full > _GRAZING * radius**2:
            by_distance += by_reached / sine * distance / chord
        by_square = by_length = 0.0
        if steep > _STEEPEST**2:
            by_steep = by_reached * chord / sine**2 / (2.0 * sine)
            by_square, by_length = by_steep / length, -by_steep * steep / length
        by_along = by_reached * onward
        by_offset = by_distance / distance
        for k in range(3):
            across = way[k] - onward * ray[k]
            by_along += by_offset * (a[k] - ahead * ray[k] + along * across) * across
        by_skew = 0.0
        if 0.0 < along < 1.0:
            by_skew = -by_along / (square + LEAST)
            by_square += by_along * skew / (square + LEAST) ** 2
        by_ahead, by_onward = by_reached, along * by_reached
        for k in range(3):
            aside, across = a[k] - ahead * ray[k], way[k] - onward * ray[k]
            offset = by_offset * (aside + along * across)
            by_aside = offset + by_skew * across
            by_across = along * offset + by_skew * aside + 2.0 * by_square * across
            by_ahead -= by_aside * ray[k]
            by_onward -= by_across * ray[k]
            by_way = by_across + 2.0 * by_length * way[k]
            slope[image, place, k] += by_aside - by_way
            slope[image, place + 1, k] += by_way
        for k in range(3):
            slope[image, place, k] += (by_ahead - by_onward) * ray[k]
            slope[image, place + 1, k] += by_onward * ray[k]
    return slope


def render(
    points: Tensor,
    radius: float,
    camera: Camera,
    softness: float = 1e-3,
    seen_radius: float | None = None,
) -> tuple[Tensor, Tensor]:
    """Depth and occupancy of the image of a rope (..., V, 3), metres, world frame, or of many, each
    in an image of its own.

    Over `softness`, metres, the rope's edge fades; `seen_radius` is that of its silhouette, metres,
    where it differs from the `radius`, see `Target`.

    Returns:
        depth (..., H, W): of the rope's surface along the optical axis, metres; NaN where no link
            is near. Where the rope covers a pixel in part, that of the covered part.
        occupancy (..., H, W): share of a pixel that the rope covers, 0..1.
    """
    rotation, position = torch.as_tensor(camera.rotation), torch.as_tensor(camera.position)
    ropes = (points.reshape(-1, *points.shape[-2:]).double() - position) @ rotation  # (B, V, 3)
    seen_radius = radius if seen_radius is None else seen_radius
    depth, occupancy = _Composite.apply(ropes, radius, seen_radius, softness, camera)
    shape = *points.shape[:-2], camera.height, camera.width
    return depth.view(shape).to(points), occupancy.view(shape).to(points)


class _Composite(torch.autograd.Function):
    """Depth and occupancy (B * H * W,) of ropes (B, V, 3) in the camera's frame."""

    @staticmethod
    def forward(
        ctx: Any, ropes: Tensor, radius: float, seen_radius: float, softness: float, camera: Camera
    ) -> tuple[Tensor, Tensor]:
        vertices = np.ascontiguousarray(ropes.detach().numpy())
        eye = np.array([camera.fx, camera.fy, camera.cx, camera.cy])
        size = camera.height, camera.width
        reach = seen_radius + _REACH * softness
        made = composite(vertices, radius, seen_radius, softness, reach, eye, *size)
        ctx.composited = (vertices, radius, seen_radius, softness, eye, *size, made)
        return torch.from_numpy(made[0]), torch.from_numpy(made[1])

    @staticmethod
    def backward(ctx: Any, *slopes: Tensor) -> tuple[Tensor | None, ...]:
        arrays = [np.ascontiguousarray(one.numpy()) for one in slopes]
        by_ropes = composite_gradient(*ctx.composited, *arrays)
        return torch.from_numpy(by_ropes), None, None, None, None
