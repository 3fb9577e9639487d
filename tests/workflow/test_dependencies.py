import importlib.util
import sys
from importlib.metadata import version

import pytest

from knotflow.versions import COMPONENTS, LIBRARIES, Component
from knotflow.workflow import dependencies
from knotflow.workflow.dependencies import (
    ROOT,
    closure,
    component_of,
    component_versions,
    definer,
    file_digests,
    library_versions,
    minor_version,
    source_of,
    stage_code,
)

STAGE = '''
"""Stages."""
import numpy as np
from typing import TYPE_CHECKING
from knotflow.topology import TopologicalState

if TYPE_CHECKING:
    import mujoco

FACTOR = 2.0


def helper(value):
    """Explains."""
    return FACTOR * value  # a comment


def unused():
    from knotflow.planning import plan_knot


def toy(run, *, count: int) -> None:
    """Makes a file."""
    print(helper(count), TopologicalState)
'''


@pytest.fixture
def code(tmp_path):
    """The code of the stage `toy` in a module with some text."""

    def of(text):
        dependencies._parse.cache_clear()
        dependencies._top_level.cache_clear()
        path = tmp_path / "toy_module.py"
        path.write_text(text)
        spec = importlib.util.spec_from_file_location("toy_module", path)
        module = importlib.util.module_from_spec(spec)
        sys.modules["toy_module"] = module
        spec.loader.exec_module(module)
        return stage_code(module.toy)

    return of


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("# a comment", ""),
        ('"""Explains."""', '"""Otherwise."""'),
        ("return FACTOR", "return  FACTOR"),
    ],
)
def test_comments_docstrings_and_layout_do_not_count(code, old, new):
    assert code(STAGE).digest == code(STAGE.replace(old, new)).digest


@pytest.mark.parametrize(
    ("old", "new"), [("FACTOR = 2.0", "FACTOR = 3.0"), ("helper(count)", "helper(count + 1)")]
)
def test_a_line_of_the_stage_or_of_its_helpers_counts(code, old, new):
    assert code(STAGE).digest != code(STAGE.replace(old, new)).digest


def test_definitions_that_the_stage_does_not_use_do_not_count(code):
    changed = STAGE.replace("import plan_knot", "import plan_knot, parse_goal")
    assert code(STAGE).digest == code(changed).digest
    used = component_versions(code(STAGE).modules)
    assert "topology" in used and "planning" not in used


def test_type_checking_imports_do_not_count(code):
    assert "mujoco" not in library_versions(code(STAGE).modules)


def test_names_are_followed_through_packages():
    module, name = definer("knotflow.planning", "plan_knot")
    assert (module, name) == ("knotflow.planning.tree", "plan_knot")


def test_a_stage_counts_only_what_it_uses():
    from knotflow.experiments import demonstrations, single_stage

    pools = component_versions(stage_code(demonstrations.pools).modules)
    assert {"simulation", "demonstrations", "recording"} <= pools.keys()
    assert not {"primitives", "training", "planning", "perception"} & pools.keys()
    exemplars = component_versions(stage_code(single_stage.exemplars).modules)
    assert "recording" in exemplars  # it reads recordings back


def test_every_module_has_one_component_and_every_component_modules():
    for name in COMPONENTS:
        for module in COMPONENTS[name].modules:
            assert (ROOT / module.replace(".", "/")).is_dir() or source_of(f"knotflow.{module}")
            assert component_of(f"knotflow.{module}") == name


def test_moving_a_file_changes_no_version(monkeypatch):
    before = component_versions(["knotflow.planning.tree"])
    moved = COMPONENTS | {"topology": Component(COMPONENTS["topology"].version, ("topology", "x"))}
    monkeypatch.setattr(dependencies, "COMPONENTS", moved)
    assert component_versions(["knotflow.planning.tree"]) == before


def test_a_module_of_no_component_counts_by_its_file(monkeypatch, tmp_path):
    monkeypatch.syspath_prepend(str(tmp_path))
    (tmp_path / "my_sampler.py").write_text("DEVIATION = 1\n")
    before = file_digests(["my_sampler", "knotflow.samplers.icp", "no_such_module"])
    assert [*before] == ["my_sampler"]
    (tmp_path / "my_sampler.py").write_text("DEVIATION = 2\n")
    assert file_digests(["my_sampler"]) != before


def test_version_is_the_minor_one_or_empty():
    assert all(map(minor_version, LIBRARIES))
    assert minor_version("skimage") == ".".join(version("scikit-image").split(".")[:2])
    assert minor_version("absent") == ""


def test_libraries_are_those_imported_with_their_minor_version(monkeypatch):
    found = library_versions(["knotflow.simulation.simulator"])
    assert {"mujoco", "numpy"} <= found.keys() and "torch" not in found
    assert found["numpy"].count(".") == 1
    monkeypatch.setattr(dependencies, "minor_version", lambda name: "99.9")
    assert library_versions(["knotflow.simulation.simulator"])["mujoco"] == "99.9"


def test_closure_reaches_through_imports_inside_functions():
    assert "knotflow.topology.state" in closure(frozenset({"knotflow.planning.tree"}))
