"""The results folder: what is read of it, what is not, and what makes it unreadable."""

import pytest
import yaml

from knotflow.report import results as module
from knotflow.report.results import Results, ResultsError, read_table
from knotflow.versions import Component


def test_missing_folder_is_refused_and_empty_one_has_no_results(tmp_path):
    with pytest.raises(ResultsError, match="nowhere: there is no such results folder"):
        Results(tmp_path / "nowhere")
    assert Results(tmp_path).experiments == {}


@pytest.mark.parametrize("folder", ["stages", "metrics"])
def test_stage_outputs_are_not_read(write, folder):
    path = write.root / folder / "success_rates.csv"
    path.parent.mkdir(parents=True)
    path.write_text("not a table")
    assert Results(write.root).experiments == {}


def test_experiment_without_tables_is_not_measured(write):
    write.run("single_stage", {})
    assert Results(write.root).measured("single_stage") is None
    assert Results(write.root).measured("nothing") is None


def test_table_alone_is_enough(write):
    write.table("single_stage", "any.csv", ("x",), [(1,)])
    (write.root / "single_stage" / "run.json").unlink()
    found = Results(write.root).measured("single_stage")
    assert (found.budget, found.commits, found.stages) == ("unknown", "unknown", {})


def stages_of(*commits, **more):
    return {str(i): {"commit": commit, **more} for i, commit in enumerate(commits)}


@pytest.mark.parametrize(
    ("stages", "words"),
    [
        (stages_of("a" * 40, "a" * 40), "`aaaaaaaaaa`"),
        (stages_of("a", dirty=True), "`a` with uncommitted changes"),
        (stages_of(None), "unknown"),
    ],
)
def test_commits_are_those_of_the_stages(write, stages, words):
    write.run("single_stage", stages)
    assert Results(write.root).experiments["single_stage"].commits == words


@pytest.mark.parametrize(
    ("stages", "words"),
    [
        ([{"key": "k", "components": {"simulation": 2, "topology": 1}}], ""),
        ([{"key": "k", "components": {"gone": 1}}], ""),
        (
            [
                {"key": "k", "components": {"simulation": 2}},
                {"key": "l", "components": {"simulation": 1, "planning": 2}},
            ],
            "simulation 1, now 2",
        ),
        (
            [{"signature": "s", "packages": {"planning": 1}}],
            "planning 1, now 2; made before stages had keys",
        ),
        ([], ""),
    ],
)
def test_stale_results_say_why(write, monkeypatch, stages, words):
    now = {"simulation": 2, "planning": 2, "topology": 1}
    components = {name: Component(version, ()) for name, version in now.items()}
    monkeypatch.setattr(module, "COMPONENTS", components)
    write.run("single_stage", {str(i): made for i, made in enumerate(stages)})
    assert Results(write.root).experiments["single_stage"].stale == words


def test_settings_are_found_at_any_depth(write):
    write.run("tree_size", {})
    stages = {
        "icp": {"config": {"planner": {"bias": 10.0}, "seeds": 5}},
        "steps": {"config": {"seeds": 3}},
    }
    (write.root / "tree_size" / "config.yaml").write_text(yaml.safe_dump({"stages": stages}))
    results = Results(write.root)
    assert results.setting("tree_size", "bias") == 10.0
    assert results.setting("tree_size", "seeds", "steps") == 3
    assert results.setting("tree_size", "nothing") is None
    assert results.setting("nothing", "bias", "icp") is None


@pytest.mark.parametrize(
    ("name", "content", "problem"),
    [
        ("run.json", "{", "cannot be read"),
        ("run.json", "[1]", "list where a mapping was expected"),
        ("config.yaml", "a: [", "cannot be read"),
    ],
)
def test_broken_file_is_named(write, name, content, problem):
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
        (b"name,n\na,1\n1,2,3\n", "not a table .*line 3"),
        (b"name,n,ok\n", "a header and no rows"),
        (b"name,ok\na,1\n", "no column n; it has name, ok"),
        (b"name,n,ok\na,1,1\nb,,1\n", "line 3: n is '' and should be a whole number"),
        (b"name,n,ok\na,-1,1\n", "line 2: n is '-1'"),
        (b"name,n,ok\na,inf,1\n", "n is 'inf'"),
        (b"name,n,ok\na,1.5,1\n", "n is '1.5'"),
        (b"name,n,ok\na,1,maybe\n", "ok is 'maybe' and should be true or false"),
        (b"name,n,ok\na,1,1\na,2,0\n", "line 3: a is there twice"),
    ],
)
def test_invalid_table_is_refused_with_its_place(tmp_path, content, problem):
    path = tmp_path / "table.csv"
    path.write_bytes(content)
    with pytest.raises(ResultsError, match=f"table.csv.*{problem}"):
        read_table(path, {"name": str, "n": int, "ok": bool}, key=("name",))


def test_table_may_have_further_columns_and_empty_numbers(tmp_path):
    path = tmp_path / "table.csv"
    path.write_text('commit,n,x,note\nabc,3,,""\nabc,4,0.5,"x, y"\n')
    table = read_table(path, {"n": int, "x": float, "note": str})
    assert table["n"].tolist() == [3, 4] and table["note"].tolist() == ["", "x, y"]
    assert table["x"].isna().tolist() == [True, False]
