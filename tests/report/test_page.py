"""The whole report: complete, the same bytes each time, and honest about what was not run."""

import re
import shutil
import subprocess
import sys
from contextlib import suppress
from pathlib import Path
from string import Formatter

import pytest

from knotflow.report import ResultsError, make
from knotflow.report.__main__ import main
from knotflow.report.markdown import slug
from knotflow.report.page import beside
from knotflow.report.results import NotMeasured, Results
from knotflow.report.section import Figures, texts
from knotflow.report.sections import SECTIONS

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def reports(everything):
    out = everything.parent / "reports"
    make(everything, out)
    return out


@pytest.fixture
def report(write, tmp_path, undrawn):
    """The text of the report on what was written."""

    def made():
        make(write.root, tmp_path / "reports")
        return (tmp_path / "reports" / "report.md").read_text()

    return made


@pytest.mark.slow
def test_all_that_was_run_is_shown(reports):
    text = (reports / "report.md").read_text()
    assert "Of 10 claims, 8 hold" in text
    for name in (
        *("single_stage", "ablation_actor_critic", "tree_size", "joint_finetuning"),
        *("goals", "actions"),
    ):
        assert f"(figures/{name}.png)" in text
        assert (reports / "figures" / f"{name}.png").is_file()
    assert not re.search(r"\{\w+\}", text)
    assert {path.suffix for path in reports.rglob("*") if path.is_file()} == {".md", ".png"}


@pytest.mark.slow
def test_same_results_same_bytes(everything, reports):
    before = {path: path.read_bytes() for path in reports.rglob("*") if path.is_file()}
    make(everything, reports)
    assert before == {path: path.read_bytes() for path in reports.rglob("*") if path.is_file()}


@pytest.mark.slow
def test_links_and_figure_numbers(reports):
    text = (reports / "report.md").read_text()
    anchors = {slug(title) for title in re.findall(r"^#+ (.+)$", text, flags=re.MULTILINE)}
    for link in re.findall(r"\]\(([^)]+)\)", text):
        if link.startswith("#"):
            assert link[1:] in anchors
        else:
            there = (reports / link).exists() or (ROOT / "reports" / link).exists()
            assert link.startswith("https://") or there, link
    figures = [int(number) for number in re.findall(r"^\*Figure (\d+)\.", text, re.MULTILINE)]
    assert figures == list(range(1, len(figures) + 1))
    assert "12 min 17 s in 4 stages" in text  # shared ones once


def test_empty_results_folder_says_how_to_run(write, report):
    write.root.mkdir(exist_ok=True)
    text = report()
    assert "Nothing has been run yet" in text
    assert "python -m knotflow +experiment=single_stage budget=smoke" in text
    assert text.count("**Not run**") == len(SECTIONS)
    assert "Of 10 claims, 10 were not run." in text


def test_what_was_not_run_is_not_reported_as_a_limit(write, rate_counts, report):
    assert "not run succeed" not in report() and "| Rope | not given | – |" in report()
    assert "**No robot.**" in report() and "**Hard actions" not in report()
    write.rates("single_stage", rate_counts(("random", "reinforcement")))
    assert "One spline for `C(2,4,1)` after RL: 34\u00a0% succeed" in report()
    assert "not run [random states]" not in report()


def test_documentation_is_linked_where_it_is(write, report, tmp_path):
    assert "../docs/" not in report() and "What a lab can expect lists" in report()
    (tmp_path / "docs").mkdir()
    assert "](../docs/what_to_expect.md)" in report()


@pytest.mark.slow
def test_only_the_baselines(write, rate_counts, report):
    write.rates("single_stage", rate_counts(("random", "icp")))
    text = report()
    assert "Not run: imitation and imitation + RL." in text
    assert "ICP / random" in text and "not the paper's counts" not in text.lower()


def test_smoke_runs_are_marked(write, rate_counts, report):
    write.rates("single_stage", rate_counts(("random", "imitation"), 12), budget="smoke")
    text = report()
    assert "Not the paper's counts." in text
    assert "These are not the paper's counts." in text
    assert "(smoke run)" in text


@pytest.mark.slow
def test_stale_results_are_marked(write, rate_counts, report):
    write.rates("single_stage", rate_counts(("random", "imitation")))
    assert "stale:" not in report()
    write.run("single_stage", {"rates": {"signature": "s", "commit": "c" * 40}})
    text = report()
    assert "| stale: made before stages had keys | paper | `cccccccccc` |" in text
    assert "**holds partly**<br>stale" in text or "**holds**<br>stale" in text


def test_experiment_without_a_section_shows_its_tables(write, report):
    write.table("soft_rope", "stiffness.csv", ("stiffness", "rate"), [(0.1, 0.4)])
    (write.root / "soft_rope" / "plan.mcap").touch()
    text = report()
    assert "### Soft rope" in text and "| 0.1 | 0.4 |" in text
    assert "[`plan.mcap`](../results/soft_rope/plan.mcap)" in text


def test_another_run_of_an_experiment_has_no_section(write, report):
    write.table("plan-pentagram-random-0", "branches.csv", ("seed",), [(0,)])
    write.run("plan-pentagram-random-0", {})
    path = write.root / "plan-pentagram-random-0" / "config.yaml"
    path.write_text("workflow: overhand\n")
    assert "pentagram-random" not in report()


@pytest.mark.slow
def test_broken_table_leaves_the_earlier_report(everything, tmp_path, capsys):
    results, out = tmp_path / "results", tmp_path / "reports"
    shutil.copytree(everything, results)
    out.mkdir()
    (out / "report.md").write_text("the earlier one")
    table = results / "single_stage" / "per_start.csv"
    table.write_text(table.read_text().replace(",0,4,", ",0,0,", 1))
    with pytest.raises(ResultsError):
        make(results, out)
    assert main(["--results", str(results), "--out", str(out)]) == 1
    assert "per_start.csv, line 2" in capsys.readouterr().err
    assert (out / "report.md").read_text() == "the earlier one"
    assert [path.name for path in out.iterdir()] == ["report.md"]


@pytest.mark.slow
def test_old_figures_are_removed(write, rate_counts, tmp_path, capsys):
    write.rates("single_stage", rate_counts(("random",)))
    out = tmp_path / "reports"
    assert main(["--results", str(write.root), "--out", str(out)]) == 0
    assert "report.md and 1 figures" in capsys.readouterr().out
    assert (out / "figures" / "single_stage.png").is_file()
    shutil.rmtree(write.root)
    write.root.mkdir()
    make(write.root, out)
    assert list((out / "figures").iterdir()) == []


def test_other_files_beside_the_figures_stay(write, report, tmp_path):
    folder = tmp_path / "reports" / "figures"
    (folder / "folder").mkdir(parents=True)
    (folder / "mine.png").touch()
    report()
    assert {path.name for path in folder.iterdir()} == {"folder", "mine.png"}


@pytest.mark.slow
def test_report_imports_nothing_that_simulates():
    told = "import sys, knotflow.report.__main__; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", told], capture_output=True, text=True, check=True)
    ours = [m for m in done.stdout.split() if m.split(".")[0] == "knotflow"]
    assert "knotflow.report.page" in ours
    packages = {m.split(".")[1] for m in ours if m != "knotflow"}
    assert packages <= {"report", "viz", "topology", "arrays", "statistics", "versions"}


@pytest.mark.slow
def test_each_section_has_its_words_and_a_part_for_every_slot(everything, undrawn):
    assert texts().keys() == SECTIONS.keys()
    results = Results(everything)
    for section in SECTIONS.values():
        slots = {slot for _, slot, _, _ in Formatter().parse(section.text.results) if slot}
        with suppress(NotMeasured):
            assert slots <= section.parts(results, Figures(results)).keys()


@pytest.mark.parametrize(
    ("results", "out"),
    [
        ("results", "reports"),
        ("results/smoke", "reports/smoke"),
        ("/lab/results/mine/results", "/lab/results/mine/reports"),
        ("tables", "tables/reports"),
    ],
)
def test_a_report_is_beside_its_results(results, out):
    assert beside(Path(results)) == Path(out)


def test_a_folder_without_runs_leaves_the_pages_around_it(tmp_path, undrawn):
    (tmp_path / "README.md").write_text(shown := "<!-- state single_stage -->current<!-- / -->")
    (tmp_path / "tables").mkdir()
    make(tmp_path / "tables", tmp_path / "tables" / "reports")
    assert (tmp_path / "README.md").read_text() == shown


def test_a_report_of_other_results_leaves_the_pages_around_it(write, tmp_path, undrawn):
    (tmp_path / "README.md").write_text(shown := "<!-- state goals -->current<!-- / -->")
    write.goals([("three", "1o2-", True, 1.0)])
    write.root.rename(tmp_path / "mine")
    make(tmp_path / "mine", tmp_path / "out")
    assert (tmp_path / "README.md").read_text() == shown


def test_tables_without_rows_are_shown_as_none(write, report):
    write.table("mine", "counts.csv", ["goal", "tied"], [("overhand", "3 of 4")])
    write.table("mine", "checks.csv", ["goal", "steady"], [])
    text = report()
    assert "| overhand | 3 of 4 |" in text and "steady" not in text


def test_where_only_other_runs_are_not_everything_is_called_not_run(write, report):
    write.table("knots-20", "knots.csv", ["goal", "tied"], [("overhand", "3 of 4")])
    write.run("knots-20", {}, workflow="knots")
    assert "Nothing has been run yet" not in report()
