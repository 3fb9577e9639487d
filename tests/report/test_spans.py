"""Numbers between marks are those of the tables, in README and documentation too."""

import re
from pathlib import Path

import pytest

from knotflow.report.results import Results, ResultsError
from knotflow.report.spans import SPAN, fill, pages

ROOT = Path(__file__).parents[2]
STATE = re.compile(r"<!-- state .*?<!-- / -->")


def test_readme_and_docs_have_the_numbers_of_the_tables():
    """`python -m knotflow.report` mends this; whether a result is stale is not compared."""
    found = pages(Results(ROOT / "results"))
    assert {page.name for page in found} >= {"README.md", "what_to_expect.md"}
    for page, content in found.items():
        assert STATE.sub("", content.decode()) == STATE.sub("", page.read_text("utf-8")), page


@pytest.mark.parametrize(
    ("mark", "value"),
    [
        ("share a/t.csv tied where arm == 'x'", "1 of 2"),
        ("percent a/t.csv tied", "67 %"),
        ("percent a/t.csv hits/trials", "50 %"),
        ("share a/t.csv hits<5", "2 of 3"),
        ("median a/t.csv hits", "4"),
        ("mean a/t.csv hits where tied", "3.5"),
        ("most a/t.csv trials", "2,000"),
        ("share a/t.csv tied where arm == 'z'", "not run"),
        ("share b/t.csv tied", "not run"),
        ("state a", "current"),
        ("state b", "–"),
    ],
)
def test_measures(write, mark, value):
    rows = [("x", True, 3, 8), ("x", False, 1_000, 2_000), ("y", True, 4, 6)]
    write.table("a", "t.csv", ("arm", "tied", "hits", "trials"), rows)
    text = f"Tied <!-- {mark} -->old<!-- / -->."
    results = Results(write.root)
    assert fill(text, results, marks=False) == f"Tied {value}."
    filled = fill(text, results)
    assert filled == text.replace("old", value) and fill(filled, results) == filled


@pytest.mark.parametrize(
    "mark", ["share a/t.csv tide", "tied a/t.csv tied", "share a/t.csv tied where nobody == 1"]
)
def test_a_mark_that_its_table_cannot_answer_is_named(write, mark):
    write.table("a", "t.csv", ("tied",), [(True,)])
    with pytest.raises(ResultsError, match=re.escape(mark)):
        fill(f"<!-- {mark} --><!-- / -->", Results(write.root))


def test_every_mark_of_the_pages_is_complete():
    for page in pages(Results(ROOT / "results")):
        text = page.read_text("utf-8")
        assert len(SPAN.findall(text)) == text.count("<!-- / -->")
