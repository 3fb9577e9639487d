"""Even out a drawing of a planar map without ever letting two of its edges meet.

Every triangle of the mesh wants its own shape and size. The measure is the symmetric Dirichlet
energy |J|^2 (1 + 1 / det(J)^2) of the map J from that shape, which grows without bound before a
triangle folds over: going downhill from a valid drawing stays among valid drawings. A small power
of it lets badly cramped triangles open up at the pace of the others. A second term makes the rope
run straight, through crossings too.
"""

from __future__ import annotations

from collections import deque

import numpy as np
from scipy.sparse import csc_array
from scipy.sparse.linalg import SuperLU, splu

from knotflow.topology.embedding import Mesh, graph_laplacian
from knotflow.topology.polyline import Floats

_POWER = 0.25  # of the measure; its logarithm (0) leaves deeply nested loops cramped
_STIFFNESS = 3.0  # of the rope against bending
_STEPS = 300
_MEMORY = 10
_SETTLED = 1e-4  # relative fall of the energy in so many steps
_REFRESH = 5  # steps between new guesses at the Hessian


class _Distortion:
    """The energy of node places (N, 2) and its gradient."""

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

    def jacobians(self, places: Floats) -> Floats:
        """(T, 2, 2) from each triangle's wanted shape to its drawing."""
        return _spans(places[self.triangles]) @ self.to_shape

    def hessian_guess(self, places: Floats) -> SuperLU:
        """To begin L-BFGS from: solving it moves neighbours together, cramped ones by little."""
        first, second = self.edges.T
        square = ((places[first] - places[second]) ** 2).sum(axis=1)
        hessian = 2.0 * graph_laplacian(len(places), self.edges, 1.0 / square)
        hessian += self.stiffness
        hessian[self.rim] = hessian[:, self.rim] = 0.0
        hessian[self.rim, self.rim] = 1.0
        return splu(csc_array(hessian))

    def __call__(self, places: Floats) -> tuple[float, Floats]:
        jacobian = self.jacobians(places)
        det = np.linalg.det(jacobian)
        gradient = 2.0 * self.stiffness @ places
        if det.min() <= 0.0:
            return np.inf, gradient
        square = (jacobian**2).sum(axis=(1, 2))
        dirichlet = square * (1.0 + det**-2)
        energy = (self.weight * dirichlet**_POWER).sum() / _POWER + 0.5 * (gradient * places).sum()
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


def relax(mesh: Mesh, places: Floats) -> Floats:
    """Even out a valid drawing: places (N, 2) to places (N, 2), the rim's kept.

    Raises:
        ValueError: a triangle of the given drawing is folded over.
    """
    energy_of = _Distortion(mesh)
    det = np.linalg.det(energy_of.jacobians(places))
    if det.min() <= 0.0:
        raise ValueError(f"triangle {int(det.argmin())} of the drawing is folded over")
    pairs: deque[tuple[Floats, Floats]] = deque(maxlen=_MEMORY)
    energies: deque[float] = deque(maxlen=_MEMORY)
    energy, gradient = energy_of(places)
    for count in range(_STEPS):
        if count % _REFRESH == 0:
            guess = energy_of.hessian_guess(places)
        direction = -_quasi_newton(gradient, pairs, guess)
        slope = float((direction * gradient).sum())
        step = 1.0 if pairs else min(1.0, 0.1 / float(np.abs(direction).max()))
        new_energy, new_gradient = energy_of(places + step * direction)
        while new_energy > energy + 1e-4 * step * slope and step > 1e-8:
            step /= 2.0
            new_energy, new_gradient = energy_of(places + step * direction)
        if not new_energy < energy:
            if not pairs:
                break
            pairs.clear()
            guess = energy_of.hessian_guess(places)
            continue
        pair = (step * direction, new_gradient - gradient)
        if (pair[0] * pair[1]).sum() > 1e-12:
            pairs.append(pair)
        places, energy, gradient = places + pair[0], new_energy, new_gradient
        energies.append(energy)
        if len(energies) == _MEMORY and energies[0] - energy < _SETTLED * abs(energy):
            break
    return places


def _quasi_newton(gradient: Floats, pairs: deque[tuple[Floats, Floats]], guess: SuperLU) -> Floats:
    """The two-loop recursion of L-BFGS, with `guess` as the first guess at the Hessian."""
    vector = gradient.copy()
    shares = []
    for move, change in reversed(pairs):
        shares.append((move * vector).sum() / (move * change).sum())
        vector -= shares[-1] * change
    vector = guess.solve(vector)
    if pairs:
        move, change = pairs[-1]
        vector *= (move * change).sum() / (change * guess.solve(change)).sum()
    for (move, change), share in zip(pairs, reversed(shares), strict=True):
        vector += move * (share - (change * vector).sum() / (move * change).sum())
    return vector


def _spans(corners: Floats) -> Floats:
    """(T, 2, 2) with the two edges from each triangle's first corner as columns."""
    return (corners[:, 1:] - corners[:, :1]).transpose(0, 2, 1)
