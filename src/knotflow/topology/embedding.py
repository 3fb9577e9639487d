"""A straight-line drawing of a state's planar map, without a crossing too many.

The map is thickened to a triangulated disc: every segment gets inner nodes, every face a ring of
nodes along its walls and a node in its middle; the outer face gets a frame far out, the rim of
the disc. By Tutte's theorem no two edges meet where the rim is on a circle and every other node at
a weighted mean of its neighbours. `draw.relax` evens this cramped drawing out.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from knotflow.topology.planar_map import LEFT, Side
from knotflow.topology.polyline import Floats, Ints
from knotflow.topology.state import TopologicalState

PIECES = 4
"""Edges a segment is drawn with; at least 3, or loops would make double edges."""

_FRAME = 3.0  # radius of the frame in radii of the drawing
_FRAME_WEIGHT = 0.02  # the frame only keeps far parts of the drawing from sliding over each other
_LEAST_WEIGHT = 0.05  # of an edge, beside about 1.2 between equilateral triangles


@dataclass(frozen=True, eq=False)
class Mesh:
    """A triangulated disc in which the rope is a path of edges.

    Position p of the state is at path[p * PIECES]; the two positions of a crossing share their
    node. A triangle should have the shape of its place in a regular polygon with the walls of its
    face as sides of length 1.
    """

    path: Ints  # ((2c + 1) * PIECES + 1,) the rope's nodes, head first
    triangles: Ints  # (T, 3) nodes, counter-clockwise
    shapes: Floats  # (T, 3, 2) that each triangle should have
    weights: Floats  # (T,) of each triangle's energy
    rim: Ints  # (R,) the nodes of the outer boundary, counter-clockwise
    rim_radius: float  # of the circle they are fixed on, in wall lengths

    @property
    def num_nodes(self) -> int:
        """Number of nodes, N."""
        return int(self.triangles.max()) + 1

    @property
    def edges(self) -> Ints:
        """(E, 2) pairs of neighbours, the smaller number first."""
        pairs = np.concatenate(
            (self.triangles[:, :2], self.triangles[:, 1:], self.triangles[:, ::2])
        )
        return np.unique(np.sort(pairs, axis=1), axis=0)


def build_mesh(state: TopologicalState) -> Mesh:
    """The triangulated disc round a state's projected rope."""
    path = _rope_nodes(state)
    count = max(path) + 1
    faces, left = state.planar_map.faces, state.planar_map.left
    # The one with most sides, of these one that an end lies in.
    outer = max(range(len(faces)), key=lambda face: (len(faces[face]), face in (left[0], left[-1])))
    triangles: list[tuple[int, int, int]] = []
    shapes: list[tuple[Floats, Floats, Floats]] = []
    weights: list[float] = []
    rim: list[int] = []

    def add_band(
        walls: list[int], ring: list[int], outward: int, radii: tuple[float, float], weight: float
    ) -> None:
        """Two triangles for each wall of a regular polygon, between it and the ring beside it."""
        turn = outward * -2.0 * np.pi / len(walls)
        near, far = _polar(radii[0], 0.0), _polar(radii[0], turn)
        node, next_node = _polar(radii[1], 0.5 * turn), _polar(radii[1], 1.5 * turn)
        for k in range(len(walls)):
            following = (k + 1) % len(walls)
            triangles.append((walls[k], walls[following], ring[k]))
            triangles.append((ring[k], walls[following], ring[following]))
            shapes.extend(((near, far, node), (node, far, next_node)))
            weights.extend((weight, weight))

    for face, sides in enumerate(faces):
        walls = [node for side in sides for node in _along(side, path)]
        number = len(walls)
        ring = list(range(count, count + number))
        count += number
        radius = 0.5 / np.sin(np.pi / number)
        if face == outer:
            # Walked with the face on the left hand, its walls are gone round clockwise.
            frame = list(range(count, count + number))
            count += number
            add_band(walls, ring, 1, (radius, radius + 1.0), 1.0)
            add_band(ring, frame, 1, (radius + 1.0, _FRAME * (radius + 1.0)), _FRAME_WEIGHT)
            rim, rim_radius = frame[::-1], _FRAME * (radius + 1.0)
        else:
            inner = max(radius - 1.0, radius / 2.0)
            add_band(walls, ring, -1, (radius, inner), 1.0)
            corner, next_corner = _polar(inner, 0.0), _polar(inner, 2.0 * np.pi / number)
            for k in range(number):
                triangles.append((ring[k], ring[(k + 1) % number], count))
                shapes.append((corner, next_corner, np.zeros(2)))
                weights.append(1.0)
            count += 1
    nodes, outside = np.array(path), np.array(rim)
    disc = np.array(triangles), np.array(shapes), np.array(weights)
    return Mesh(nodes, *disc, outside, rim_radius)


def tutte(mesh: Mesh) -> Floats:
    """Positions (N, 2) of all nodes: the rim on its circle, the others at weighted means."""
    count, rim = mesh.num_nodes, mesh.rim
    angle = 2.0 * np.pi * np.arange(len(rim)) / len(rim)
    positions = np.zeros((count, 2))
    positions[rim] = mesh.rim_radius * np.stack((np.cos(angle), np.sin(angle)), axis=1)
    inner = np.setdiff1d(np.arange(count), rim)
    laplacian = graph_laplacian(count, mesh.edges, _cotangent_weights(mesh))
    positions[inner] = np.linalg.solve(
        laplacian[np.ix_(inner, inner)], -laplacian[np.ix_(inner, rim)] @ positions[rim]
    )
    return positions


def graph_laplacian(count: int, edges: Ints, weight: Floats) -> Floats:
    """(N, N) Laplacian of a graph with weighted edges."""
    first, second = edges.T
    laplacian = np.zeros((count, count))
    laplacian[first, second] = laplacian[second, first] = -weight
    np.fill_diagonal(laplacian, -laplacian.sum(axis=1))
    return laplacian


def _cotangent_weights(mesh: Mesh) -> Floats:
    """(E,) weights with which the drawing is about conformal to the wanted shapes."""
    weight = np.zeros((mesh.num_nodes, mesh.num_nodes))
    for corner in range(3):
        apex, first, second = np.roll(np.arange(3), -corner)
        to_first = mesh.shapes[:, first] - mesh.shapes[:, apex]
        to_second = mesh.shapes[:, second] - mesh.shapes[:, apex]
        dot = (to_first * to_second).sum(axis=1)
        cross = to_first[:, 0] * to_second[:, 1] - to_first[:, 1] * to_second[:, 0]
        ends = np.sort(mesh.triangles[:, [first, second]], axis=1)
        np.add.at(weight, (ends[:, 0], ends[:, 1]), dot / cross)
    # Obtuse angles make negative weights, for which Tutte's theorem promises nothing.
    result: Floats = np.maximum(weight[tuple(mesh.edges.T)], _LEAST_WEIGHT)
    return result


def _rope_nodes(state: TopologicalState) -> list[int]:
    """The node at every place along the rope; the two places of a crossing share theirs."""
    path = list(range(state.num_segments * PIECES + 1))
    for over, under, _ in state.crossings:
        path[max(over, under) * PIECES] = min(over, under) * PIECES
    numbers = {node: number for number, node in enumerate(sorted(set(path)))}
    return [numbers[node] for node in path]


def _polar(radius: float, angle: float) -> Floats:
    return radius * np.array([np.cos(angle), np.sin(angle)])


def _along(side: Side, path: list[int]) -> list[int]:
    """The nodes of a segment in the direction of one of its sides, without the last."""
    segment, direction = side
    nodes = path[segment * PIECES : (segment + 1) * PIECES + 1]
    return nodes[:-1] if direction == LEFT else nodes[:0:-1]
