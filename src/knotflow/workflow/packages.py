"""Which packages a stage uses, read off the imports, so that no stage can forget to name one.

The sources are parsed, not run: an import inside a function, or one that a package puts off until
it is needed, counts like any other.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import knotflow
from knotflow.samplers import MODULES
from knotflow.versions import VERSIONS

ROOT = Path(knotflow.__file__).parent
SAMPLER_BUILDER = "knotflow.samplers.build_sampler"
"""Imports samplers by name, when it is called."""


def package_versions(function: Callable[..., Any]) -> dict[str, int]:
    """The packages that the source file of a function uses, with their versions, by name.

    Packages used by those packages, and by other files of `workflow.stages` that are imported,
    are among them.
    """
    return {name: VERSIONS[name] for name in used_packages(Path(function.__code__.co_filename))}


@cache
def used_packages(source: Path) -> tuple[str, ...]:
    """Names of the packages with a version that a source file imports, and of those below them."""
    found: set[str] = set()
    seen: set[Path] = set()
    waiting = [source]
    while waiting:
        file = waiting.pop()
        if file in seen:
            continue
        seen.add(file)
        for name in _imports(file):
            package = _package(name)
            if package is not None and package not in found:
                found.add(package)
                waiting += sources(package)
            elif name.startswith("knotflow.workflow.stages."):
                waiting += _stage_file(name)
    return tuple(sorted(found))


@cache
def _imports(file: Path) -> frozenset[str]:
    """Dotted names of all that a file imports; of `from a.b import c`, a.b.c."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(file.read_text("utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            names |= {f"{_origin(node, file)}.{alias.name}" for alias in node.names}
    return frozenset(names | set(MODULES) if SAMPLER_BUILDER in names else names)


def _origin(node: ast.ImportFrom, file: Path) -> str:
    """The absolute name of what an `import from` takes its names from."""
    if not node.level or ROOT not in file.parents:
        return node.module or ""
    folder = file.parents[node.level - 1].relative_to(ROOT.parent)
    return ".".join([*folder.parts, *filter(None, [node.module])])


def _package(name: str) -> str | None:
    """The innermost package with a version that an imported name belongs to."""
    parts = name.split(".")[1:] if name.startswith("knotflow.") else []
    inner = (".".join(parts[:length]) for length in range(len(parts), 0, -1))
    return next((package for package in inner if package in VERSIONS), None)


def sources(package: str) -> Iterator[Path]:
    """The sources of a package, without those of an inner one that has its own version."""
    folder = ROOT.joinpath(*package.split("."))
    for file in folder.rglob("*.py"):
        if _package(".".join(["knotflow", *file.relative_to(ROOT).parent.parts])) == package:
            yield file


def _stage_file(name: str) -> list[Path]:
    file = ROOT / "workflow" / "stages" / f"{name.split('.')[3]}.py"
    return [file] if file.is_file() else []
