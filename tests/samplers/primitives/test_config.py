import pytest

from knotflow.samplers.primitives import CemConfig, PrimitiveConfig


def test_more_elites_than_splines_are_refused():
    PrimitiveConfig(cem=CemConfig(elites=24))
    with pytest.raises(ValueError, match="elites of a primitive are 1 to 24, .* got 51"):
        PrimitiveConfig(cem=CemConfig(elites=51))
