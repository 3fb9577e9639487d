"""From a topological state to a rope shape that has it: a rounded knot diagram with heights.

The triangles of the mesh of `embedding` are relaxed towards their own shapes by minimising the
symmetric Dirichlet energy |J|^2 (1 + 1 / det(J)^2) of the map J from that shape. It grows without
bound before a triangle folds over, so descent from a valid drawing stays among valid drawings. A
second term keeps the rope straight, through crossings too.
"""

from __future__ import annotations

from collections import deque

import numpy as np
from scipy.sparse import csc_array
from scipy.sparse.linalg import SuperLU, splu

from knotflow.topology.curve import project
from knotflow.topology.embedding import Mesh, build_mesh, graph_laplacian, tutte
from knotflow.topology.polyline import Floats, arc_lengths, planar_crossings
from knotflow.topology.state import TopologicalState

ROPE_GAP = 0.016
"""Metres. Height of an over strand above an under strand, one diameter of the default rope."""

_POWER = 0.25  # of the energy, so that cramped triangles open up at the pace of the others
_STIFFNESS = 3.0  # of the rope against bending
_STEPS = 300
_MEMORY = 10
_CONVERGED = 1e-4  # relative decrease of the energy in _MEMORY steps
_REFRESH = 5  # steps between new initial Hessians


def draw(state: TopologicalState, gap: float = ROPE_GAP, samples: int = 8) -> Floats:
    """A rounded rope shape (V, 3) with the given state, 1 m long in the projection.

    Always the same; metres, head first, centred at the origin. Over strands are `gap` high, under
    strands and ends at 0. Each of the 4 pieces of a segment has so many `samples`.

    Raises:
        RuntimeError: the drawing does not read back as the state: `samples` is too small.
    """
    mesh = build_mesh(state)
    nodes = relax(mesh, tutte(mesh))[mesh.path]
    xy = _spline(nodes, samples)
    xy *= 1.0 / np.linalg.norm(np.diff(xy, axis=0), axis=1).sum()
    points = _lift(state, xy - (xy.min(axis=0) + xy.max(axis=0)) / 2.0, gap)
    drawn = TopologicalState.from_crossings(project(points, gap / 2.0).crossings)
    if drawn != state:
        raise RuntimeError(f"the drawing of {state} reads back as {drawn}")
    return points


def _spline(nodes: Floats, samples: int) -> Floats:
    """The uniform cubic B-spline with these control points, from the first to the last."""
    # Mirrored end nodes make it begin and end there.
    before, after = 2.0 * nodes[:1] - nodes[1:2], 2.0 * nodes[-1:] - nodes[-2:-1]
    control = np.concatenate((before, nodes, after))
    u = (np.arange(samples) / samples)[:, None]
    basis = ((1 - u) ** 3, 3 * u**3 - 6 * u**2 + 4, -3 * u**3 + 3 * u**2 + 3 * u + 1, u**3)
    pieces = len(nodes) - 1
    curve = sum(b * control[k : k + pieces, None] / 6.0 for k, b in enumerate(basis))
    return np.concatenate((np.reshape(curve, (-1, 2)), nodes[-1:]))


def _lift(state: TopologicalState, xy: Floats, gap: float) -> Floats:
    """Give a flat drawing its heights, smoothly from one passage of a crossing to the next."""
    at_crossings = np.sort(planar_crossings(xy).passed)
    reached = arc_lengths(xy)
    over = {position for position, _, _ in state.crossings}
    levels = [gap if position in over else 0.0 for position in range(1, state.num_segments)]
    if len(at_crossings) != len(levels):
        raise RuntimeError(
            f"the drawing of {state} has {len(at_crossings) // 2} crossings; more samples may help"
        )
    knots = np.concatenate(([0.0], at_crossings, [reached[-1]]))
    heights = np.array([0.0, *levels, 0.0])
    span = np.clip(np.searchsorted(knots, reached, side="right") - 1, 0, len(knots) - 2)
    u = (reached - knots[span]) / (knots[span + 1] - knots[span])
    z = heights[span] + (heights[span + 1] - heights[span]) * (3.0 - 2.0 * u) * u**2
    return np.column_stack((xy, z))


class _Distortion:
    """The energy of node positions (N, 2) and its gradient."""

    def __init__(self, mesh: Mesh) -> None:
        spans = _spans(mesh.shapes)
        self.triangles = mesh.triangles
        self.weight = mesh.weights
        self.rim = mesh.rim
        self.edges = mesh.edges
        self.to_shape = np.linalg.inv(spans)
        bend = np.zeros((len(mesh.path) - 2, mesh.num_nodes))
        row = np.arange(len(bend))
        for offset, factor in ((0, 1.0), (1, -2.0), (2, 1.0)):
            np.add.at(bend, (row, mesh.path[offset : offset + len(bend)]), factor)
        self.stiffness = _STIFFNESS * bend.T @ bend  # (N, N)

    def initial_hessian(self, positions: Floats) -> SuperLU:
        """The initial Hessian of L-BFGS, factorised."""
        first, second = self.edges.T
        square = ((positions[first] - positions[second]) ** 2).sum(axis=1)
        hessian = 2.0 * graph_laplacian(len(positions), self.edges, 1.0 / square)
        hessian += self.stiffness
        hessian[self.rim] = hessian[:, self.rim] = 0.0
        hessian[self.rim, self.rim] = 1.0
        return splu(csc_array(hessian))

    def __call__(self, positions: Floats) -> tuple[float, Floats]:
        # (T, 2, 2) from each triangle's wanted shape to its drawing
        jacobian = _spans(positions[self.triangles]) @ self.to_shape
        det = np.linalg.det(jacobian)
        gradient = 2.0 * self.stiffness @ positions
        if det.min() <= 0.0:
            return np.inf, gradient
        square = (jacobian**2).sum(axis=(1, 2))
        dirichlet = square * (1.0 + det**-2)
        energy = (self.weight * dirichlet**_POWER).sum() / _POWER + 0.5 * (
            gradient * positions
        ).sum()
        cofactor = jacobian[:, ::-1, ::-1] * np.array([[1.0, -1.0], [-1.0, 1.0]])
        slope = (self.weight * dirichlet ** (_POWER - 1.0))[:, None, None] * (
            2.0 * jacobian * (1.0 + det**-2)[:, None, None]
            - 2.0 * (square * det**-3)[:, None, None] * cofactor
        )
        force = (slope @ self.to_shape.transpose(0, 2, 1)).transpose(0, 2, 1)  # (T, corner, xy)
        np.add.at(gradient, self.triangles[:, 1:], force)
        np.add.at(gradient, self.triangles[:, 0], -force.sum(axis=1))
        gradient[self.rim] = 0.0
        return float(energy), gradient


def relax(mesh: Mesh, positions: Floats) -> Floats:
    """Relax the node positions (N, 2) of a drawing without folded triangles; the rim's stay."""
    energy_of = _Distortion(mesh)
    pairs: deque[tuple[Floats, Floats]] = deque(maxlen=_MEMORY)
    energies: deque[float] = deque(maxlen=_MEMORY)
    energy, gradient = energy_of(positions)
    for count in range(_STEPS):
        if count % _REFRESH == 0:
            hessian = energy_of.initial_hessian(positions)
        direction = -_quasi_newton(gradient, pairs, hessian)
        slope = float((direction * gradient).sum())
        step = 1.0 if pairs else min(1.0, 0.1 / float(np.abs(direction).max()))
        new_energy, new_gradient = energy_of(positions + step * direction)
        while new_energy > energy + 1e-4 * step * slope and step > 1e-8:
            step /= 2.0
            new_energy, new_gradient = energy_of(positions + step * direction)
        if not new_energy < energy:
            if not pairs:
                break
            pairs.clear()
            hessian = energy_of.initial_hessian(positions)
            continue
        pair = (step * direction, new_gradient - gradient)
        if (pair[0] * pair[1]).sum() > 1e-12:
            pairs.append(pair)
        positions, energy, gradient = positions + pair[0], new_energy, new_gradient
        energies.append(energy)
        if len(energies) == _MEMORY and energies[0] - energy < _CONVERGED * abs(energy):
            break
    return positions


def _quasi_newton(
    gradient: Floats, pairs: deque[tuple[Floats, Floats]], hessian: SuperLU
) -> Floats:
    """The two-loop recursion of L-BFGS with an initial Hessian."""
    vector: Floats = gradient.copy()
    shares: list[float] = []
    for move, change in reversed(pairs):
        shares.append((move * vector).sum() / (move * change).sum())
        vector -= shares[-1] * change
    vector = np.asarray(hessian.solve(vector), np.float64)
    if pairs:
        move, change = pairs[-1]
        vector *= (move * change).sum() / (change * hessian.solve(change)).sum()
    for (move, change), share in zip(pairs, reversed(shares), strict=True):
        vector += move * (share - (change * vector).sum() / (move * change).sum())
    return vector


def _spans(corners: Floats) -> Floats:
    """(T, 2, 2) with the two edges from each triangle's first corner as columns."""
    edges: Floats = corners[:, 1:] - corners[:, :1]
    return edges.transpose(0, 2, 1)
