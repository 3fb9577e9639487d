"""What code the output of a stage depends on, read off its source.

Sources are parsed, not run: an import inside a function, or one that a package defers until it is
needed, counts like any other. Imports for type checking alone do not.
"""

from __future__ import annotations

import ast
import hashlib
import inspect
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec, resolve_name
from pathlib import Path
from typing import Any

import knotflow
from knotflow.versions import COMPONENTS, LIBRARIES

ROOT = Path(knotflow.__file__).parent
STAGES = "knotflow.experiments"
"""The package whose code counts line by line, not by a version."""
DISTRIBUTIONS = {"skimage": "scikit-image"}
"""Names of distributions that are not those of their packages."""
_DEFINITIONS = (ast.FunctionDef, ast.ClassDef)
_IGNORED = {"ctx", "kind", "type_comment", "type_params", "decorator_list"}


@dataclass(frozen=True)
class StageCode:
    """The definitions that a stage consists of, and what they import."""

    digest: str
    """Of the function and all it uses of `STAGES`, without comments, docstrings and names of
    modules."""
    modules: frozenset[str]
    """Modules and libraries that these definitions import from."""


@cache
def stage_code(function: Callable[..., Any]) -> StageCode:
    """The code of a stage: its function and, transitively, what that uses of its own layer."""
    module = function.__module__
    file = source_of(module) or Path(inspect.getfile(function))
    waiting, seen = [(module, file, function.__name__)], set()
    parts, modules = [], set()
    while waiting:
        place = waiting.pop()
        if place in seen:
            continue
        seen.add(place)
        module, file, name = place
        definitions, imports = _top_level(module, file)
        if name not in definitions:
            continue
        node = definitions[name]
        parts.append(_canonical(node))
        used = {one.id for one in ast.walk(node) if isinstance(one, ast.Name)}
        found = [imports[one] for one in used if one in imports] + _imports(node, module, file)
        for origin, attribute in found:
            source = source_of(origin)
            if source is not None and f"{origin}.".startswith(f"{STAGES}."):
                waiting.append((origin, source, attribute))
            else:
                modules.add(origin)
        waiting += [(module, file, one) for one in used if one in definitions]
    digest = hashlib.sha256("\n".join(sorted(parts)).encode()).hexdigest()[:16]
    return StageCode(digest, frozenset(modules))


def component_versions(modules: Iterable[str]) -> dict[str, int]:
    """Versions of the components that modules use, by name."""
    used = {component_of(name) for name in closure(frozenset(modules)) if _is_ours(name)}
    return {name: COMPONENTS[name].version for name in sorted(filter(None, used))}


def file_digests(modules: Iterable[str]) -> dict[str, str]:
    """Digests of the files of those modules that no component owns, such as a lab's sampler."""
    found = {}
    for name in sorted(one for one in modules if component_of(one) is None):
        spec = find_spec(name)
        if spec is not None and spec.origin is not None and Path(spec.origin).is_file():
            found[name] = hashlib.sha256(Path(spec.origin).read_bytes()).hexdigest()[:16]
    return found


def library_versions(modules: Iterable[str]) -> dict[str, str]:
    """Installed minor versions of the libraries in `LIBRARIES` that modules use, by import name."""
    used = {name.partition(".")[0] for name in closure(frozenset(modules))} & {*LIBRARIES}
    return {name: minor_version(name) for name in sorted(used)}


def component_of(module: str) -> str | None:
    """The component that owns a module, None for one without a version."""
    name = f"{module.removeprefix('knotflow.')}."
    owners = {prefix: one for one, (_, modules) in COMPONENTS.items() for prefix in modules}
    return owners.get(max((p for p in owners if name.startswith(f"{p}.")), key=len, default=""))


@cache
def minor_version(library: str) -> str:
    """Such as "2.13" of a library by its import name, "" where it is not installed."""
    try:
        return ".".join(version(DISTRIBUTIONS.get(library, library)).split(".")[:2])
    except PackageNotFoundError:
        return ""


@cache
def closure(modules: frozenset[str]) -> frozenset[str]:
    """Dotted names of modules, of all they import, and of all those import; libraries included."""
    found: set[str] = set()
    waiting = [*modules]
    while waiting:
        name = waiting.pop()
        if name not in found:
            found.add(name)
            waiting += imported(name)
    return frozenset(found)


@cache
def imported(module: str) -> frozenset[str]:
    """Dotted names of the modules that a module of knotflow imports; none of other modules."""
    file = source_of(module)
    if file is None:
        return frozenset()
    return frozenset(origin for origin, _ in _imports(_parse(file), module, file))


@cache
def source_of(module: str) -> Path | None:
    """The source file of a module of knotflow, None where there is none."""
    if not _is_ours(module):
        return None
    path = ROOT.joinpath(*module.split(".")[1:])
    found = (file for file in (path / "__init__.py", path.with_suffix(".py")) if file.is_file())
    return next(found, None)


@cache
def definer(module: str, name: str) -> tuple[str, str]:
    """The module that defines what `from module import name` takes, and its name there."""
    if source_of(f"{module}.{name}") is not None:
        return f"{module}.{name}", ""
    folder = ROOT.joinpath(*module.split(".")[1:])
    for file in (folder / "__init__.pyi", folder / "__init__.py"):
        if _is_ours(module) and file.is_file():
            for node in _parse(file).body:
                if isinstance(node, ast.ImportFrom):
                    for alias in node.names:
                        if (alias.asname or alias.name) == name:
                            return definer(_absolute(node, module, file), alias.name)
    return module, name


def _imports(tree: ast.AST, module: str, file: Path) -> list[tuple[str, str]]:
    """What is imported below a node: (module, name there), the name "" for a whole module."""
    return [origin for node in _run(tree) for origin in _imported(node, module, file).values()]


def _imported(node: ast.AST, module: str, file: Path) -> dict[str, tuple[str, str]]:
    """What an import statement takes, as in `_imports`, by the names it gives it."""
    if isinstance(node, ast.Import):
        return {one.asname or one.name.partition(".")[0]: (one.name, "") for one in node.names}
    if isinstance(node, ast.ImportFrom):
        base = _absolute(node, module, file)
        return {one.asname or one.name: definer(base, one.name) for one in node.names}
    return {}


@cache
def _top_level(module: str, file: Path) -> tuple[dict[str, ast.stmt], dict[str, tuple[str, str]]]:
    """The definitions of a module by name, and what it imports by the names it gives them."""
    definitions: dict[str, ast.stmt] = {}
    imports: dict[str, tuple[str, str]] = {}
    for node in _parse(file).body:
        imports |= _imported(node, module, file)
        if isinstance(node, _DEFINITIONS):
            definitions[node.name] = node
        elif isinstance(node, ast.Assign | ast.AnnAssign):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            names = (one for target in targets for one in ast.walk(target))
            definitions |= {one.id: node for one in names if isinstance(one, ast.Name)}
    return definitions, imports


def _canonical(node: Any) -> str:
    """A syntax tree as text, the same on every Python version; docstrings are left out."""
    if isinstance(node, list):
        kept = [
            one
            for one in node
            if not (isinstance(one, ast.Expr) and isinstance(one.value, ast.Constant))
        ]
        return f"[{','.join(map(_canonical, kept))}]"
    if isinstance(node, ast.AST):
        fields = [
            f"{name}={_canonical(value)}"
            for name, value in ast.iter_fields(node)
            if name not in _IGNORED and value is not None and value != []
        ]
        return f"{type(node).__name__}({','.join(fields)})"
    return repr(node)


@cache
def _parse(file: Path) -> ast.Module:
    return ast.parse(file.read_text("utf-8"))


def _is_ours(module: str) -> bool:
    return module.partition(".")[0] == "knotflow"


def _absolute(node: ast.ImportFrom, module: str, file: Path) -> str:
    """The absolute name of what an `import from` takes its names from."""
    package = module if file.stem == "__init__" else module.rpartition(".")[0]
    return resolve_name("." * node.level + (node.module or ""), package)


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
