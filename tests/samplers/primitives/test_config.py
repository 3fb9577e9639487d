import pytest

from knotflow.samplers.primitives import CemConfig, PrimitiveConfig


def test_more_elites_than_splines_are_refused():
    PrimitiveConfig(cem=CemConfig(elites=24))
    with pytest.raises(ValueError, match="elites of a primitive are 1 to 24, .* got 51"):
        PrimitiveConfig(cem=CemConfig(elites=51))


@pytest.mark.parametrize("name", ["iterations", "critic_only_iterations", "valued"])
def test_a_search_has_an_iteration_and_a_spline(name):
    with pytest.raises(ValueError, match=f"cem.{name} of a primitive must be 1 or more, got 0"):
        PrimitiveConfig(cem=CemConfig(**{name: 0}))
