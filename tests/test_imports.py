"""Imports point one way: the floor plan of the packages, and no circle between modules."""

from __future__ import annotations

import ast
from functools import cache
from pathlib import Path

import networkx as nx
import pytest

import knotflow

SOURCE = Path(knotflow.__file__).parent

KNOWS = {
    "versions": set(),
    "threads": set(),
    "arrays": set(),
    "topology": {"arrays"},
    "drawing": {"topology"},
    "simulation": {"topology"},
    "demonstrations": {"simulation"},
    "samplers": {"demonstrations"},
    "baselines": {"samplers"},
    "primitives": {"samplers", "threads"},
    "training": {"primitives"},
    "planning": {"samplers", "drawing"},
    "execution": {"planning", "perception", "demonstrations"},
    "tasks": {"planning", "baselines", "primitives", "report"},
    "recording": {"simulation"},
    "perception": {"simulation", "drawing", "threads"},
    "workflow": {"versions", "baselines", "training", "planning", "recording", "execution"},
    "report": {"drawing", "versions"},
    "config": {"workflow"},
    "view": {"recording"},
    "overrides": {"config"},
    "tie": {"config"},
    "studio": {"tie"},
    "cli": {"tie", "view", "report", "studio"},
    "__main__": {"overrides"},
}
"""Each package and what it may import, beside what that one may: the floor plan as a graph."""


@cache
def imports() -> nx.DiGraph:
    """Every module of knotflow, with an edge to each it imports, inside functions too."""
    paths = {name_of(path): path for path in sorted(SOURCE.rglob("*.py"))}
    graph = nx.DiGraph()
    graph.add_nodes_from(paths)
    for name, path in paths.items():
        package = name if path.name == "__init__.py" else name.rpartition(".")[0]
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            for target in targets(node, package, paths):
                graph.add_edge(name, target)
    return graph


def name_of(path: Path) -> str:
    parts = ("knotflow", *path.relative_to(SOURCE).with_suffix("").parts)
    return ".".join(parts).removesuffix(".__init__")


def targets(node: ast.AST, package: str, known) -> set[str]:
    """The modules of `known` that a statement imports; `from a import b` may be either of two."""
    if isinstance(node, ast.Import):
        return {alias.name for alias in node.names} & set(known)
    if not isinstance(node, ast.ImportFrom):
        return set()
    base = node.module or ""
    if node.level:
        parent = package.split(".")[: len(package.split(".")) - node.level + 1]
        base = ".".join([*parent, *([base] if base else [])])
    inside = {f"{base}.{alias.name}" for alias in node.names}
    return {one if one in known else base for one in inside} & set(known)


def package_of(module: str) -> str:
    return module.split(".")[1]


def test_no_modules_import_each_other_in_a_circle():
    circles = [
        sorted(part) for part in nx.strongly_connected_components(imports()) if len(part) > 1
    ]
    assert not circles, f"these modules import each other in a circle: {circles}"


def test_no_module_imports_upwards():
    plan = nx.DiGraph([(above, below) for above, known in KNOWS.items() for below in known])
    upwards = [
        f"{user} imports {used}"
        for user, used in imports().edges
        if "." in user and "." in used and package_of(user) != package_of(used)
        if package_of(used) not in nx.descendants(plan, package_of(user))
    ]
    assert not upwards, "\n".join(upwards)


@pytest.mark.parametrize("name", sorted({package_of(one) for one in imports() if "." in one}))
def test_the_floor_plan_names_every_package(name):
    assert name in KNOWS
