"""The packages that a stage uses, and their versions in its signature."""

from __future__ import annotations

from pathlib import Path

import pytest

import knotflow.workflow.stages  # noqa: F401  registers them
from knotflow.versions import VERSIONS
from knotflow.workflow import get_stage
from knotflow.workflow.packages import ROOT, used_packages

NO_RESULTS = {"drawing", "recording", "report", "studio", "tasks", "workflow"}
"""Packages that show, keep, order or ask for what others compute."""


def test_every_package_that_computes_has_a_version() -> None:
    folders = {path.parent.name for path in ROOT.glob("*/__init__.py")}
    assert {name for name in VERSIONS if "." not in name} == folders - NO_RESULTS
    for name in VERSIONS:
        assert ROOT.joinpath(*name.split(".")).is_dir()


@pytest.mark.parametrize(
    ("stage", "uses", "does_not_use"),
    [
        ("starts", {"topology", "simulation"}, {"primitives", "planning"}),
        ("imitation", {"training", "primitives", "demonstrations"}, {"baselines", "planning"}),
        ("evaluation", {"primitives", "baselines"}, {"training", "baselines.causal_infogan"}),
        ("plans", {"planning", "primitives", "simulation"}, {"training"}),
        ("causal_infogan", {"baselines.causal_infogan"}, {"baselines", "primitives"}),
        ("success_rates", set(), {"topology", "simulation"}),
    ],
)
def test_stages_use_what_they_import_and_what_that_imports(
    stage: str, uses: set[str], does_not_use: set[str]
) -> None:
    packages = get_stage(stage).packages
    assert packages.keys() >= uses and not packages.keys() & does_not_use
    assert all(version == VERSIONS[name] for name, version in packages.items())


@pytest.mark.parametrize(
    ("source", "used"),
    [
        ("import numpy", ()),
        ("import knotflow.topology.curve", ("topology",)),
        ("from knotflow import topology", ("topology",)),
        ("def later():\n    from knotflow.topology import knot", ("topology",)),
        ("from knotflow.simulation import straight", ("simulation", "topology")),
        ("from knotflow.samplers import Sampler", ()),
        ("from knotflow.workflow.stages.success_rates import tabulate", ()),
        (
            "from knotflow.workflow.stages.starts import load_starts",
            ("demonstrations", "simulation", "topology"),
        ),
    ],
)
def test_every_form_of_import_counts(source: str, used: tuple[str, ...], tmp_path: Path) -> None:
    (tmp_path / "stage.py").write_text(source)
    assert used_packages(tmp_path / "stage.py") == used


def test_who_builds_samplers_uses_the_packages_that_have_some(tmp_path: Path) -> None:
    (tmp_path / "stage.py").write_text("from knotflow.samplers import build_sampler")
    assert {"baselines", "primitives"} <= set(used_packages(tmp_path / "stage.py"))
