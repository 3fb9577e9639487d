"""topoly is asked in a process of its own."""

import os

import pytest

from knotflow.planning import homfly
from knotflow.planning.check import closed_curve
from knotflow.topology import TopologicalState
from knotflow.topology.draw import draw

pytest.importorskip("topoly")
CURVE = closed_curve(draw(TopologicalState.parse("4o1+2o5+6o3+"))).tolist()


@pytest.mark.slow
def test_it_closes_no_descriptor_of_this_process_and_is_started_again_where_it_ended():
    kept = os.dup(0)  # fails where descriptor 0 was closed already
    try:
        assert homfly.homfly_type(CURVE) == "+3_1"
        assert os.path.sameopenfile(0, kept)
        child = homfly._started()
        assert homfly._started() is child
        child.kill()
        child.wait()
        assert homfly.homfly_type(CURVE) == "+3_1" and homfly._started() is not child
    finally:
        os.close(kept)


def test_what_is_no_curve_is_refused():
    with pytest.raises(ValueError, match="finite"):
        homfly.homfly_type([*CURVE[:-1], [float("nan"), 0.0, 0.0]])


def test_without_it_the_extra_is_named(monkeypatch):
    monkeypatch.setattr(homfly, "find_spec", lambda name: None)
    with pytest.raises(ModuleNotFoundError, match=r"pip install 'knotflow\[test\]'"):
        homfly.homfly_type(CURVE)
