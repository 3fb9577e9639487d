"""What the package says of itself agrees with what it is."""

from __future__ import annotations

import tomllib
from importlib import import_module
from pathlib import Path

import yaml

import knotflow

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]


def test_its_types_are_for_others_too():
    assert (Path(knotflow.__file__).parent / "py.typed").is_file()


def test_it_is_cited_with_its_version_and_the_paper():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text("utf-8"))
    assert citation["version"] == PROJECT["version"]
    assert citation["license"] == PROJECT["license"]
    paper = citation["preferred-citation"]
    assert paper["title"] == "Learning Topological Motion Primitives for Knot Planning"
    assert [one["family-names"] for one in paper["authors"]] == ["Yan", "Li", "Zhu", "Bohg"]


def test_gymnasium_finds_the_environment():
    module, _, function = PROJECT["entry-points"]["gymnasium.envs"]["knotflow"].partition(":")
    assert callable(getattr(import_module(module), function))


def test_the_hooks_before_a_commit_run_what_make_check_runs():
    hooks = yaml.safe_load((ROOT / ".pre-commit-config.yaml").read_text("utf-8"))["repos"]
    entries = [hook["entry"] for repo in hooks for hook in repo["hooks"]]
    check = (ROOT / "Makefile").read_text("utf-8").partition("\ncheck:")[2].split("\n\n")[0]
    for tool in ("ruff check", "ruff format", "mypy"):
        assert tool in check and any(entry.startswith(tool) for entry in entries)
