"""The whole report: complete, the same bytes each time, and honest about what was not run."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from html.parser import HTMLParser

import pytest

from knotflow.report import ResultsError, make
from knotflow.report.__main__ import main
from knotflow.report.page import SECTIONS


class Page(HTMLParser):
    """Ids, links, and elements left open."""

    VOID = frozenset({"meta", "br", "path", "use", "rect", "line", "hr", "img", "circle"})

    def __init__(self, text):
        super().__init__()
        self.ids, self.links, self.open = [], [], []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        found = dict(attrs)
        self.ids += [found["id"]] if "id" in found else []
        self.links += [found[key] for key in ("href", "src") if key in found]
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.ids += [value for name, value in attrs if name == "id"]

    def handle_endtag(self, tag):
        if tag not in self.VOID:
            assert self.open.pop() == tag


@pytest.fixture(scope="module")
def reports(everything):
    out = everything.parent / "reports"
    make(everything, out)
    return out


@pytest.mark.slow
def test_everything_run_is_everything_shown(reports):
    text = (reports / "report.md").read_text()
    assert "Of 10 claims: 7 hold" in text
    for name in (
        *("single_stage", "ablation_actor_critic", "tree_size", "joint_finetuning"),
        *("goals", "actions", "throughput", "stages"),
    ):
        assert f"(figures/{name}.png)" in text
        assert (reports / "figures" / f"{name}.png").is_file()
        assert (reports / "figures" / f"{name}.svg").is_file()
    assert "{{" not in text and "{%" not in text
    tree_size = text[text.index("\n## Tree size") : text.index("\n## Ablation")]
    assert "An independent library (topoly) confirms" in tree_size


@pytest.mark.slow
def test_same_results_same_bytes(everything, reports):
    before = {path: path.read_bytes() for path in reports.rglob("*") if path.is_file()}
    make(everything, reports)
    assert before == {path: path.read_bytes() for path in reports.rglob("*") if path.is_file()}


def test_the_page_is_whole_and_its_links_lead_somewhere(reports):
    page = Page((reports / "index.html").read_text())
    assert page.open == []
    assert len(page.ids) == len(set(page.ids))
    inside = {link[1:] for link in page.links if link.startswith("#")}
    assert inside <= set(page.ids)
    for link in page.links:
        if not link.startswith(("#", "https://arxiv.org/abs/")):
            assert (reports / link).exists(), link


def test_the_markdown_links_lead_somewhere(reports):
    text = (reports / "report.md").read_text()
    for link in re.findall(r"\]\(([^)#]+)\)", text):
        assert link.startswith("https://arxiv.org/abs/") or (reports / link).exists(), link


def test_the_first_page_has_the_figures_that_there_are_and_the_claims(reports):
    first, _, rest = (reports / "report.md").read_text().partition("## Contents")
    assert re.findall(r"\(figures/(\w+)\.png\)", first) == ["single_stage", "goals"]  # no plan here
    assert "Of 10 claims" in first
    assert rest.index("# The paper's experiments") < rest.index("# Beyond the paper")
    assert "## Contents" not in (reports / "index.html").read_text()


def test_a_shared_stage_is_counted_once(reports):
    text = (reports / "report.md").read_text()
    assert "12 min 17 s in 4 stages" in text
    assert text.count("16,320 noisy copies, simulated") == 1


def test_an_empty_results_folder_says_how_to_run(tmp_path):
    (tmp_path / "results").mkdir()
    make(tmp_path / "results", tmp_path / "reports")
    text = (tmp_path / "reports" / "report.md").read_text()
    assert "Nothing has been run yet" in text
    assert "python -m knotflow +experiment=single_stage budget=smoke" in text
    assert text.count("**Not run yet**") == len(SECTIONS)
    assert "10 were not run yet" in text


def test_only_the_baselines(write, rate_counts, tmp_path):
    write.rates("single_stage", rate_counts(("random", "icp")))
    make(write.root, tmp_path / "reports")
    text = (tmp_path / "reports" / "report.md").read_text()
    assert "Not run yet: imitation and imitation + RL." in text
    assert re.search(r"more often than random sampling on 8 of\s8 actions", text)
    assert "not the paper's counts" not in text.lower()


def test_smoke_runs_are_marked_wherever_they_stand(write, rate_counts, tmp_path):
    write.rates("single_stage", rate_counts(("random", "imitation"), 12), budget="smoke")
    make(write.root, tmp_path / "reports")
    for name in ("report.md", "index.html"):
        text = (tmp_path / "reports" / name).read_text()
        assert "Not the paper's counts." in text
        assert "These are not the paper's counts." in text
        assert "(smoke run)" in text


def test_an_experiment_of_ones_own_is_shown_with_its_tables(write, tmp_path):
    write.table("soft_rope", "stiffness.csv", ("stiffness", "rate"), [(0.1, 0.4)])
    make(write.root, tmp_path / "reports")
    text = (tmp_path / "reports" / "report.md").read_text()
    assert "## Soft rope" in text and "| 0.1 | 0.4 |" in text


def test_an_experiment_nobody_wrote_a_section_for_shows_its_tables(write, tmp_path):
    write.table("soft_rope", "branches.csv", ("seed", "branches"), [(0, 12)])
    make(write.root, tmp_path / "reports")
    text = (tmp_path / "reports" / "report.md").read_text()
    assert "**branches.csv**" in text and "| 0 | 12 |" in text


def test_recordings_are_linked(write, tmp_path):
    write.table("soft_rope", "plan.csv", ("x",), [(1,)])
    (write.root / "soft_rope" / "plan.mcap").touch()
    make(write.root, tmp_path / "reports")
    text = (tmp_path / "reports" / "report.md").read_text()
    assert "[`results/soft_rope/plan.mcap`](../results/soft_rope/plan.mcap)" in text


@pytest.mark.slow
def test_a_broken_table_leaves_the_earlier_report_as_it_was(everything, tmp_path, capsys):
    results, out = tmp_path / "results", tmp_path / "reports"
    shutil.copytree(everything, results)
    make(results, out)
    before = (out / "report.md").read_bytes()
    table = results / "single_stage" / "success_rates.csv"
    table.write_text(table.read_text().replace(",14,", ",15,"))
    with pytest.raises(ResultsError):
        make(results, out)
    assert main(["--results", str(results), "--out", str(out)]) == 1
    assert "success_rates.csv, column 'success_rate', row 1" in capsys.readouterr().err
    assert (out / "report.md").read_bytes() == before


def test_figures_of_what_is_gone_are_removed(write, rate_counts, tmp_path, capsys):
    write.rates("single_stage", rate_counts(("random",)))
    out = tmp_path / "reports"
    assert main(["--results", str(write.root), "--out", str(out)]) == 0
    assert "index.html" in capsys.readouterr().out
    assert (out / "figures" / "single_stage.png").is_file()
    shutil.rmtree(write.root)
    write.root.mkdir()
    make(write.root, out)
    assert list((out / "figures").iterdir()) == []


@pytest.mark.slow
def test_the_report_imports_nothing_that_simulates():
    told = "import sys, knotflow.report.__main__; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", told], capture_output=True, text=True, check=True)
    ours = [m for m in done.stdout.split() if m.split(".")[0] == "knotflow"]
    assert "knotflow.report.page" in ours
    packages = {m.split(".")[1] for m in ours if m != "knotflow"}
    assert packages == {"report", "drawing", "topology", "arrays", "intervals", "versions"}
