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


def test_workers_stand_beside_one(write):
    write.table("benchmark", "throughput.csv", COLUMNS, [("a", 40, 2, 100, 2.5, 40.0, 500)])
    assert "beside one" not in compose(Results(write.root), "results").markdown
    columns = ("backend", "workers", "shards", "seconds", "splines_per_second")
    rows = [("loky", 1, 16, 20.0, 25.6), ("ray", 2, 16, 12.5, 41.0)]
    write.table("benchmark", "scaling.csv", columns, rows)
    assert "| 41.0 | 1.60× |" in compose(Results(write.root), "results").markdown
