"""Where the time went."""

from knotflow.report.page import timing
from knotflow.report.results import Results
from knotflow.report.section import Figures


def text_of(write):
    results = Results(write.root)
    return timing(results, Figures(results))


def test_nothing_recorded_is_said(write):
    write.run("goals", {})
    assert text_of(write) == "No run has recorded its stages yet."


def test_time_and_memory_by_experiment_and_shared_stages_once(write):
    write.run("goals", {"goals": {"key": "g", "seconds": 90.0, "memory_mb": 1234}})
    write.run("knots", {"again": {"key": "g", "seconds": 0.1}, "knots": {"seconds": 30.0}})
    text = text_of(write)
    assert "took 2 min 0 s in 2 stages" in text
    assert "| `goals` | 1 | 1 min 30 s | 1,234 MB |" in text
    assert "| `knots` | 1 | 30 s | – |" in text
    assert "(figures/stages.png)" in text
