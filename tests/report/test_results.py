"""The results folder: what is read of it, what is not, and what makes it unreadable."""

from __future__ import annotations

import json

import pytest

from knotflow.report.results import COUNT, NOTE, TEXT, Results, ResultsError, read_table


def test_no_folder_is_refused_and_an_empty_one_has_no_results(tmp_path):
    with pytest.raises(ResultsError, match="nowhere: there is no such results folder"):
        Results(tmp_path / "nowhere")
    assert Results(tmp_path).experiments == {}


def test_a_table_that_was_cut_at_a_line_end_is_refused(tmp_path):
    folder = tmp_path / "knots"
    folder.mkdir()
    (folder / "branches.csv").write_text("knot,branches\noverhand,3\noverhand,4\n")
    size = (folder / "branches.csv").stat().st_size
    (folder / "run.json").write_text(json.dumps({"bytes": {"branches.csv": size}}))
    assert list(Results(tmp_path).experiments) == ["knots"]
    (folder / "branches.csv").write_text("knot,branches\noverhand,3\n")
    with pytest.raises(ResultsError, match="has 25 bytes, but 36 when it was made.*knots again"):
        Results(tmp_path)


@pytest.mark.parametrize("folder", ["stages", "metrics"])
def test_stage_outputs_are_never_read(write, folder):
    path = write.root / folder / "success_rates.csv"
    path.parent.mkdir(parents=True)
    path.write_text("not a table")
    assert Results(write.root).experiments == {}


def test_an_experiment_without_tables_is_not_measured(write):
    write.run("single_stage", {})
    assert not Results(write.root).experiments["single_stage"].measured


def test_a_table_alone_is_enough(write):
    write.table("single_stage", "any.csv", ("x",), [(1,)])
    (write.root / "single_stage" / "run.json").unlink()
    found = Results(write.root).experiments["single_stage"]
    assert found.measured and not found.paper
    assert (found.budget, found.commits, found.stages) == ("", "commit unknown", [])


def made(*commits, **more):
    return {str(i): {"commit": commit, **more} for i, commit in enumerate(commits)}


def dated(**hours):
    """Stages by the hour and zone at which their commit was made, in the order of the stages."""
    return {
        name: {"commit": name * 40, "commit_date": hour and f"2026-11-22T{hour}"}
        for name, hour in hours.items()
    }


@pytest.mark.parametrize(
    ("stages", "words"),
    [
        (made("a" * 40, "a" * 40), "commit `aaaaaaaaaa`"),
        (
            dated(b="09:00:00+00:00", c="10:00:00+00:00", a="10:30:00+02:00"),
            "3 commits, from `aaaaaaaaaa` to `cccccccccc`",
        ),
        (dated(b="09:00:00+00:00", a=None), "2 commits: `bbbbbbbbbb`, `aaaaaaaaaa`"),
        (made("b", commits=["a", "b"]), "2 commits: `a`, `b`"),
        (made("a", None), "commit `a`, unknown for 1 of 2 stages"),
        (made("a", dirty=True), "commit `a`, with uncommitted changes"),
        (made(None), "commit unknown"),
    ],
)
def test_commits_are_those_of_the_stages_never_that_of_the_run(write, stages, words):
    write.run("single_stage", stages)
    path = write.root / "single_stage" / "run.json"
    path.write_text(path.read_text().replace("{", '{"commit": "fff", "dirty": false, ', 1))
    assert Results(write.root).experiments["single_stage"].commits == words


@pytest.mark.parametrize(
    ("packages", "words"),
    [
        ([{"simulation": 2, "topology": 1}], ""),
        ([{"simulation": 2}, {"simulation": 1, "planning": 2}], "simulation 1, now 2"),
        ([{"simulation": 1, "planning": 1}], "planning 1, now 2; simulation 1, now 2"),
        ([{"gone": 1}], ""),
        ([], ""),
    ],
)
def test_results_of_packages_that_behave_otherwise_by_now_say_so(
    write, monkeypatch, packages, words
):
    now = {"simulation": 2, "planning": 2, "topology": 1}
    monkeypatch.setattr("knotflow.report.results.VERSIONS", now)
    write.run("single_stage", {str(i): {"packages": made} for i, made in enumerate(packages)})
    assert Results(write.root).experiments["single_stage"].outdated == words


def test_results_from_before_versions_were_recorded_are_outdated(write, monkeypatch):
    monkeypatch.setattr("knotflow.report.results.VERSIONS", {"simulation": 2, "training": 1})
    write.run("single_stage", made("a" * 40))
    assert Results(write.root).experiments["single_stage"].outdated == "simulation 1, now 2"


def test_run_json_tells_of_stages_and_missing_keys_are_tolerated(write):
    told = {
        "one": {"stage": "make", "signature": "a", "seconds": 2, "caption": "c"},
        "two": {"origin": "shared"},
    }
    write.run("single_stage", told)
    one, two = Results(write.root).experiments["single_stage"].stages
    assert (one.node, one.stage, one.seconds, one.shared) == ("one", "make", 2.0, False)
    assert (two.stage, two.seconds, two.shared, two.caption) == ("two", None, True, "")


def test_the_rope_is_found_in_the_resolved_config(write):
    write.run("single_stage", {})
    (rope,) = Results(write.root).experiments["single_stage"].ropes
    assert rope == {"length": 1.0, "radius": 0.008, "links": 40}


@pytest.mark.parametrize(
    ("name", "content", "problem"),
    [
        ("run.json", "{", "not JSON"),
        ("run.json", "[1]", "list where a mapping was expected"),
        ("config.yaml", "a: [", "not YAML"),
    ],
)
def test_a_broken_file_is_named(write, name, content, problem):
    path = write.root / "single_stage" / name
    path.parent.mkdir(parents=True)
    path.write_text(content)
    with pytest.raises(ResultsError, match=f"single_stage/{name}.*{problem}"):
        Results(write.root)


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        (b"", "not a table"),
        (b"\xff\xfe", "not a table"),
        (b"name,n\n1,2,3\n", "not a table .*line 2"),
        (b"name,n\n", "a header and no rows"),
        (b"name,n,n\na,2,3\n", "'n' appears more than once"),
        (b"name\na\n", "column 'n' is missing; it has name"),
        (b"name,n\na,1\nb\n", r"column 'n', row 2 \(line 3\): '' is not a number"),
        (b"name,n\na,1\n,2\n", r"column 'name', row 2 \(line 3\): is empty"),
        (b"name,n\na,-1\n", r"column 'n', row 1 \(line 2\): '-1' is outside"),
        (b"name,n\na,inf\n", "'inf' is outside"),
        (b"name,n\na,1.5\n", "'1.5' is not a whole number"),
        (b"name,n\na,1\na,2\n", "column 'name', row 2 .*: a stands in an earlier row already"),
    ],
)
def test_what_is_wrong_with_a_table_is_named_with_its_place(tmp_path, content, problem):
    path = tmp_path / "table.csv"
    path.write_bytes(content)
    with pytest.raises(ResultsError, match=f"table.csv.*{problem}"):
        read_table(path, {"name": TEXT, "n": COUNT}, key=("name",))


def test_a_table_may_have_more_than_is_asked_for(tmp_path):
    path = tmp_path / "table.csv"
    path.write_text('commit,n,note\nabc,3,""\nabc,4,"x, y"\n')
    table = read_table(path, {"n": COUNT, "note": NOTE})
    assert table["n"].tolist() == [3, 4] and table["note"].tolist() == ["", "x, y"]
