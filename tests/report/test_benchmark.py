"""The benchmark's table has to agree with itself."""

import pytest

from knotflow.report.page import compose
from knotflow.report.results import Results, ResultsError

COLUMNS = ("case", "links", "threads", "rollouts", "seconds")
COLUMNS += ("splines_per_second", "peak_memory_mb")


def test_throughput_agrees_with_rollouts_and_seconds(write):
    write.table("benchmark", "throughput.csv", COLUMNS, [("a", 40, 2, 100, 2.5, 40.1, 500)])
    assert "executes 40.1 splines" in compose(Results(write.root), "results").markdown
    write.table("benchmark", "throughput.csv", COLUMNS, [("a", 40, 2, 100, 2.5, 60, 500)])
    with pytest.raises(ResultsError, match="column 'splines_per_second', row 1"):
        compose(Results(write.root), "results")
