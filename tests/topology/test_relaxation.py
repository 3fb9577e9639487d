"""Straight-line drawings stay free of folds while they are evened out."""

from __future__ import annotations

import numpy as np
import pytest

from knotflow.topology.embedding import build_mesh, tutte
from knotflow.topology.relaxation import relax


def doubled_areas(mesh, places):
    first, second, third = (places[mesh.triangles[:, corner]] for corner in range(3))
    one, two = second - first, third - first
    return one[:, 0] * two[:, 1] - one[:, 1] * two[:, 0]


@pytest.mark.parametrize("crossings", [0, 1, 3, 6, 10])
def test_no_triangle_folds(random_state, crossings):
    mesh = build_mesh(random_state(crossings, 7))
    places = tutte(mesh)
    assert doubled_areas(mesh, places).min() > 0
    relaxed = relax(mesh, places)
    assert doubled_areas(mesh, relaxed).min() > 0
    np.testing.assert_array_equal(relaxed[mesh.rim], places[mesh.rim])
    lengths = [np.linalg.norm(np.diff(p[mesh.path], axis=0), axis=1) for p in (places, relaxed)]
    assert lengths[1].max() / lengths[1].min() <= lengths[0].max() / lengths[0].min()
    assert 0.2 < np.median(lengths[1]) < 3.0


def test_a_folded_drawing_is_refused(random_state):
    mesh = build_mesh(random_state(2, 0))
    mirrored = tutte(mesh) * np.array([1.0, -1.0])
    with pytest.raises(ValueError, match="folded over"):
        relax(mesh, mirrored)
