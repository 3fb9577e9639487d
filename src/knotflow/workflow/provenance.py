"""Where a result comes from: the commit, the state of the tree, the libraries."""

from __future__ import annotations

import platform
import subprocess
import tomllib
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

LIBRARIES = ("knotflow", "mcap", "mujoco", "numpy", "pandas", "tensordict", "torch", "torchrl")
GENERATED = ("results", "reports")  # made by the runs themselves: they do not make the code dirty


@dataclass(frozen=True)
class CodeState:
    """Which code makes a result."""

    commit: str
    """Of the checkout, or "none, version X" where the code is installed from a wheel."""
    dirty: bool | None = None
    """Whether the checkout differs from its commit; None without a commit."""
    commit_date: str | None = None
    """When it was committed, in ISO 8601; None without a commit."""


def code_state(package: Path) -> CodeState:
    """The state of the knotflow checkout that a package folder belongs to.

    A package that lies in somebody else's repository, such as one installed into a virtual
    environment there, belongs to none: the repository must be knotflow's own, by its
    pyproject.toml, and must track the package's files at src/knotflow/.

    Args:
        package: folder of the imported package, which holds its `__init__.py`.
    """
    package = package.resolve()
    no_commit = CodeState(f"none, version {library_versions().get('knotflow', 'unknown')}")
    top = _git(package, "rev-parse", "--show-toplevel")
    if top is None or not _is_knotflow(Path(top), package):
        return no_commit
    commit = _git(package, "rev-parse", "--verify", "HEAD")
    excluded = [f":(exclude){name}" for name in GENERATED]
    changes = _git(Path(top), "status", "--porcelain", "--", ".", *excluded)
    if commit is None or changes is None:
        return no_commit
    return CodeState(commit, bool(changes), _git(package, "log", "-1", "--format=%cI", commit))


def _is_knotflow(top: Path, package: Path) -> bool:
    """Whether the repository at `top` is the one that `package` is developed in."""
    if package != top.resolve() / "src" / "knotflow":
        return False
    try:
        project = tomllib.loads((top / "pyproject.toml").read_text("utf-8"))["project"]["name"]
    except (OSError, KeyError, tomllib.TOMLDecodeError):
        return False
    tracked = _git(package, "ls-files", "--error-unmatch", "--", "__init__.py") is not None
    return project == "knotflow" and tracked


def _git(folder: Path, *arguments: str) -> str | None:
    """What git prints in `folder`; None where it fails or is not installed."""
    try:
        done = subprocess.run(
            ["git", "-C", str(folder), *arguments], capture_output=True, text=True, check=False
        )
    except FileNotFoundError:
        return None
    return done.stdout.strip() if done.returncode == 0 else None


def library_versions() -> dict[str, str]:
    """Python and those of the libraries that shape results which are installed."""
    versions = {"python": platform.python_version()}
    for name in LIBRARIES:
        try:
            versions[name] = metadata.version(name)
        except metadata.PackageNotFoundError:  # optional, or run from the source tree
            continue
    return versions
