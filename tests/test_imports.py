"""Imports point one way: the floor plan of the packages, and no circle between modules."""

from __future__ import annotations

import ast
from functools import cache
from pathlib import Path

import networkx as nx

import knotflow

SOURCE = Path(knotflow.__file__).parent

KNOWS = {
    "versions": set(),
    "threads": set(),
    "arrays": set(),
    "statistics": set(),
    "seeding": set(),
    "topology": {"arrays"},
    "simulation": {"topology", "threads"},
    "samplers": {"simulation", "threads"},
    "training": {"samplers", "seeding"},
    "planning": {"samplers"},
    "recording": {"simulation"},
    "viz": {"planning", "recording"},
    "perception": {"simulation", "viz", "threads", "training"},
    "execution": {"planning", "perception"},
    "workflow": {"versions", "threads"},
    "experiments": {"seeding", "workflow", "training", "execution", "recording", "statistics"},
    "report": {"viz", "statistics", "versions"},
    "apps": {"experiments", "report"},
    "__main__": {"experiments"},
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


@cache
def stub(package: str) -> dict[str, str]:
    """Name -> the module it is loaded from, of a package that loads its names when they are used;
    none of other packages."""
    file = SOURCE.joinpath(*package.split(".")[1:], "__init__.pyi")
    if not file.is_file():
        return {}
    return {
        alias.asname or alias.name: f"{package}.{node.module}"
        for node in ast.parse(file.read_text("utf-8")).body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }


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
    found = set()
    for alias in node.names:
        inside = f"{base}.{alias.name}"
        found.add(inside if inside in known else stub(base).get(alias.name, base))
    return found & set(known)


def package_of(module: str) -> str:
    return module.split(".")[1]


def test_no_modules_import_each_other_in_a_circle():
    circles = [
        sorted(part) for part in nx.strongly_connected_components(imports()) if len(part) > 1
    ]
    assert not circles, f"these modules import each other in a circle: {circles}"


def between_packages():
    """The imports of a module of one package by one of another, as (user, used)."""
    for user, used in imports().edges:
        if "." in user and "." in used and package_of(user) != package_of(used):
            yield user, used


def test_no_module_imports_upwards():
    plan = nx.DiGraph([(above, below) for above, known in KNOWS.items() for below in known])
    upwards = [
        f"{user} imports {used}"
        for user, used in between_packages()
        if package_of(used) not in nx.descendants(plan, package_of(user))
    ]
    assert not upwards, "\n".join(upwards)


def test_the_floor_plan_has_no_arrow_that_no_import_needs():
    needed = {(package_of(user), package_of(used)) for user, used in between_packages()}
    arrows = {(above, below) for above, known in KNOWS.items() for below in known}
    assert not arrows - needed


def test_a_name_of_a_package_that_loads_late_is_an_import_of_its_module():
    (statement,) = ast.parse("from knotflow.planning import plan_knot, rules").body
    known = {"knotflow.planning", "knotflow.planning.tree", "knotflow.planning.rules"}
    assert targets(statement, "knotflow", known) == known - {"knotflow.planning"}


def test_the_floor_plan_names_every_package():
    assert {package_of(one) for one in imports() if "." in one} <= KNOWS.keys()
