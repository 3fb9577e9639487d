"""How far links are apart, against many places on both."""

import numpy as np
import pytest
from scipy.spatial.distance import cdist

from knotflow.perception.estimation.chain import nearest_places, overlap


def test_the_nearest_places_are_the_nearest_of_many(rng):
    share = np.linspace(0, 1, 60)[:, None]
    for p, d, q, e in rng.normal(size=(30, 4, 3)):
        s, t = nearest_places(*(tuple(one) for one in (p, d, q, e)))
        found = np.linalg.norm(p + s * d - q - t * e)
        least = cdist(p + share * d, q + share * e).min()
        assert found == pytest.approx(least, abs=0.02)
        assert found <= least + 1e-6


def test_links_count_from_the_third_along_the_rope_on():
    folded = np.array([[[0, 0, 0], [1, 0, 0], [1, 0.1, 0], [0, 0.1, 0], [0, 0.2, 0]]], float)
    assert overlap(folded, 0.05)[0].item() == pytest.approx(0.0)  # links 0 and 2 are 0.1 apart
    loss, slope = overlap(folded, 0.1)  # and so are 0 and 3, which would have to be 0.2
    assert loss[0] == pytest.approx(1.0)
    assert slope[0, 0, 1] > 0 > slope[0, 3, 1]
