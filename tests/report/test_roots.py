"""The root of the chain: its effect beside the time step's, and success by root."""

import numpy as np
import pytest

from knotflow.report.page import compose
from knotflow.report.results import Results, ResultsError
from knotflow.report.roots import SECTION, successes
from knotflow.report.section import Pictures

ENDS = ("splines", "spline", "root_distance_mm", "root_same_state")
ENDS += ("timestep_distance_mm", "timestep_same_state")
SUCCESSES = ("action", "demonstration", "root", "trials", "successes")


def write_ends(write, root):
    """Ends that the root moves by as many mm more than the time step does."""
    step = np.random.default_rng(3).exponential(8.0, (2, 40)).round(2)
    rows = [
        ("aimed", i, root + one, int(one < 9), other, int(other < 9))
        for i, (one, other) in enumerate(zip(*step, strict=True))
    ]
    write.table("roots", "ends.csv", ENDS, rows)


def write_successes(write, middle, head):
    """R1 with a single demonstration, C with as many as there are counts, of 20 copies each."""
    rows = [("R1(0,1,1)", 0, root, 160, 150) for root in ("middle", "head")]
    rows += [
        ("C(2,4,1)", 1 + i, root, 20, hits)
        for root, counts in (("middle", middle), ("head", head))
        for i, hits in enumerate(counts)
    ]
    write.table("roots", "successes.csv", SUCCESSES, rows)


def found(write):
    return SECTION.values(Results(write.root), Pictures())


def test_a_root_that_changes_no_more_than_the_time_step_does_is_said_not_to_matter(write):
    write_ends(write, root=0.0)
    write_successes(write, middle=(10, 4, 12, 9), head=(9, 5, 11, 10))
    told = found(write)
    assert (told["farther"], told["differ"], told["actions"]) == ("", "", 2)
    assert "matters no more than the time step" in compose(Results(write.root), "r").markdown


def test_splines_and_actions_on_which_the_root_matters_are_named(write):
    write_ends(write, root=20.0)
    write_successes(write, middle=(2, 1, 3, 2), head=(9, 5, 11, 10))
    told = found(write)
    assert (told["farther"], told["differ"]) == ("aimed", "`C(2,4,1)`")
    text = compose(Results(write.root), "r").markdown
    assert "moves the ends of aimed splines significantly" in text
    assert "differ significantly on\n`C(2,4,1)` of 2 actions" in text


def test_starts_are_resampled_where_there_are_several(write):
    write_successes(write, middle=(20, 0, 20, 0), head=(10, 10, 10, 11))
    rates = successes(Results(write.root))
    assert rates.solved("middle", "C(2,4,1)") == (2, 4)
    assert rates.solved("middle", "R1(0,1,1)") is None
    assert rates.interval("middle", "R1(0,1,1)").low == pytest.approx(0.89, abs=0.01)
    assert rates.interval("middle", "C(2,4,1)").low < 0.1  # half of four starts, not of 80 copies


def test_a_spoilt_table_is_refused(write):
    write_ends(write, root=1.0)
    write_successes(write, middle=(21,), head=(3,))
    with pytest.raises(ResultsError, match="21 of only 20 trials"):
        found(write)


def test_without_a_run_there_is_no_section(write):
    assert found(write) is None
