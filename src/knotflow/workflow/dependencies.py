"""What code a stage's output depends on, read off the imports.

Sources are parsed, not run: an import inside a function, or one that a package defers until it is
needed, counts like any other. Imports for type checking alone do not.
"""

from __future__ import annotations

import ast
from collections.abc import Iterable, Iterator
from functools import cache
from importlib.metadata import packages_distributions, version
from pathlib import Path

import knotflow
from knotflow.versions import COMPONENTS, LIBRARIES

ROOT = Path(knotflow.__file__).parent


def component_of(module: str) -> str | None:
    """The component that owns a module, None for one without a version."""
    name, best = module.removeprefix("knotflow."), ""
    found = None
    for component, (_, modules) in COMPONENTS.items():
        for prefix in modules:
            if f"{name}.".startswith(f"{prefix}.") and len(prefix) > len(best):
                found, best = component, prefix
    return found


def component_versions(modules: Iterable[str]) -> dict[str, int]:
    """Versions of the components that modules use, by name."""
    used = {component_of(name) for name in closure(frozenset(modules)) if _is_ours(name)}
    return {name: COMPONENTS[name].version for name in sorted(filter(None, used))}


def library_versions(modules: Iterable[str]) -> dict[str, str]:
    """Installed minor versions of the libraries in `LIBRARIES` that modules use, by import name."""
    used = {name.partition(".")[0] for name in closure(frozenset(modules))} & {*LIBRARIES}
    return {name: minor_version(name) for name in sorted(used)}


@cache
def minor_version(library: str) -> str:
    """Such as "2.13" of a library by its import name, "" where it is not installed."""
    distributions = packages_distributions().get(library)
    return ".".join(version(distributions[0]).split(".")[:2]) if distributions else ""


@cache
def closure(modules: frozenset[str]) -> frozenset[str]:
    """Dotted names of modules, of all they import, and of all those import; libraries included."""
    found: set[str] = set()
    waiting = [*modules]
    while waiting:
        name = waiting.pop()
        if name not in found:
            found.add(name)
            waiting += imported(name) if _is_ours(name) else ()
    return frozenset(found)


def modules_of(component: str) -> Iterator[str]:
    """The modules that a component consists of."""
    for prefix in COMPONENTS[component].modules:
        path = ROOT.joinpath(*prefix.split("."))
        for file in path.rglob("*.py") if path.is_dir() else [path.with_suffix(".py")]:
            name = ".".join(("knotflow", *file.relative_to(ROOT).with_suffix("").parts))
            if component_of(name) == component and file.name != "__init__.py":
                yield name


@cache
def imported(module: str) -> frozenset[str]:
    """Dotted names of the modules that a module of knotflow imports."""
    file = source_of(module)
    if file is None:
        return frozenset()
    names: set[str] = set()
    for node in _run(ast.parse(file.read_text("utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = _absolute(node, module, file)
            names |= {definer(base, alias.name) for alias in node.names}
    return frozenset(names)


def definer(module: str, name: str) -> str:
    """The module that `from module import name` takes a name from, through packages' exports."""
    if not _is_ours(module) or source_of(f"{module}.{name}") is not None:
        return f"{module}.{name}" if _is_ours(module) else module
    for file in _exports(module):
        for node in ast.parse(file.read_text("utf-8")).body:
            if isinstance(node, ast.ImportFrom):
                for alias in node.names:
                    if (alias.asname or alias.name) == name:
                        return definer(_absolute(node, module, file), alias.name)
    return module


def source_of(module: str) -> Path | None:
    """The source file of a module of knotflow, None where there is none."""
    path = ROOT.joinpath(*module.split(".")[1:])
    for file in (path / "__init__.py", path.with_suffix(".py")):
        if file.is_file():
            return file
    return None


def _is_ours(module: str) -> bool:
    return module.partition(".")[0] == "knotflow"


def _exports(module: str) -> list[Path]:
    folder = ROOT.joinpath(*module.split(".")[1:])
    return [file for name in ("pyi", "py") if (file := folder / f"__init__.{name}").is_file()]


def _absolute(node: ast.ImportFrom, module: str, file: Path) -> str:
    """The absolute name of what an `import from` takes its names from."""
    if not node.level:
        return node.module or ""
    parts = module.split(".")
    package = parts if file.stem == "__init__" else parts[:-1]
    return ".".join([*package[: len(package) - node.level + 1], *filter(None, [node.module])])


def _run(tree: ast.AST) -> Iterator[ast.AST]:
    """All nodes but those below `if TYPE_CHECKING`."""
    waiting = [tree]
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.If) and ast.unparse(node.test).endswith("TYPE_CHECKING"):
            waiting += node.orelse
            continue
        yield node
        waiting += ast.iter_child_nodes(node)
