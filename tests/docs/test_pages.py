"""The documentation's snippets run, and the commands and experiments that it names exist."""

from __future__ import annotations

import os
import re
import shlex
import sys
from importlib import import_module
from pathlib import Path
from types import ModuleType

import pytest
from tests.experiments.configuration import composed

from knotflow.apps.cli import app
from knotflow.experiments.config import experiments
from knotflow.experiments.run import workflow_of
from knotflow.samplers.demonstrations import SHIPPED

# The package exports a function of the module's name.
sampler_module = import_module("knotflow.samplers.sampler")
ROOT = Path(__file__).parents[2]
PAGES = sorted((ROOT / "docs").glob("*.md"))
SNIPPET = re.compile(r"```python\n(.*?)```", re.DOTALL)
WITH_SNIPPETS = [
    page for page in PAGES if page.stem != "leaderboard" and SNIPPET.search(page.read_text("utf-8"))
]


@pytest.mark.slow
@pytest.mark.parametrize("page", WITH_SNIPPETS, ids=lambda page: page.stem)
def test_snippets_run(page, tmp_path, monkeypatch):
    os.symlink(ROOT / "results", tmp_path / "results")
    monkeypatch.chdir(tmp_path)
    text = page.read_text("utf-8")
    module = ModuleType(f"page_{page.stem}")  # dataclasses look up the module they are in
    monkeypatch.setitem(sys.modules, module.__name__, module)
    for sampler in sampler_module.MODULES.values():
        import_module(sampler)
    for registry in ("_FACTORIES", "_REQUIRED_INPUTS"):  # what a page registers is forgotten
        monkeypatch.setattr(sampler_module, registry, dict(getattr(sampler_module, registry)))
    space = vars(module)
    for match in SNIPPET.finditer(text):
        # As many empty lines as stand before it, so that an error names the page's line.
        lead = "\n" * text[: match.start(1)].count("\n")
        exec(compile(lead + match[1], str(page), "exec", dont_inherit=True), space)
    if "plan" in space:
        assert space["plan"].solved
    if page.stem == "your_arm":
        log = space["robot"].log
        assert log.count("grasp") == len(space["plan"].steps) and log[-1] == "release"
        assert (tmp_path / "overhand.csv").read_text().count("\n") > 20


@pytest.mark.parametrize("page", [*PAGES, ROOT / "README.md"], ids=lambda page: page.name)
def test_commands_exist(page):
    text = page.read_text("utf-8")
    blocks = re.findall(r"```(?:bash|text)\n(.*?)```", text, re.DOTALL)
    lines = [line for block in blocks for line in block.splitlines()]
    commands = {m[1] for line in lines if (m := re.match(r"(?:\$ )?knotflow (\w+)", line))}
    named = set(re.findall(r"\+experiment=(\w+)", text)) - {"NAME"}
    assert commands <= set(app) and named <= set(experiments())


@pytest.mark.parametrize("page", [*PAGES, ROOT / "README.md"], ids=lambda page: page.name)
def test_experiments_take_what_the_page_sets(page):
    text = page.read_text("utf-8").replace("\\\n", " ")
    for line in re.findall(r"^(?:\w+=\S+ )?python -m knotflow (.*)$", text, re.MULTILINE):
        words = [one for one in shlex.split(line, comments=True) if not one.startswith("-")]
        set_up = [one.partition(",")[0] for one in words if not one.startswith("hydra/")]
        if "demonstrations_file=both.jsonl" in set_up:
            set_up[set_up.index("demonstrations_file=both.jsonl")] = (
                f"demonstrations_file={SHIPPED}"
            )
        config = composed(*set_up)
        if not {"+experiment=paper", "+experiment=everything"} & {*set_up}:
            assert workflow_of(config).nodes, line


def test_every_experiment_is_documented():
    page = (ROOT / "docs" / "experiments.md").read_text("utf-8")
    single = {*experiments()} - {"paper", "everything"}
    assert [name for name in sorted(single) if f"`{name}`" not in page] == []


def test_readme_is_short():
    assert len((ROOT / "README.md").read_text("utf-8").split()) <= 1200
