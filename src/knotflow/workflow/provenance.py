"""Where a result comes from: the commit, the state of the tree, the libraries."""

from __future__ import annotations

import platform
import subprocess
from importlib import metadata
from pathlib import Path

LIBRARIES = ("knotflow", "mcap", "mujoco", "numpy", "pandas", "tensordict", "torch", "torchrl")
GENERATED = ("results", "reports")  # made by the runs themselves: they do not make the code dirty


def git_state(folder: Path) -> dict[str, str | bool | None]:
    """`commit` and `dirty` of the repository that `folder` lies in; None outside of one."""

    def git(*arguments: str, at: Path = folder) -> str | None:
        try:
            done = subprocess.run(
                ["git", "-C", str(at), *arguments], capture_output=True, text=True, check=False
            )
        except FileNotFoundError:  # git itself is not installed
            return None
        return done.stdout.strip() if done.returncode == 0 else None

    top = git("rev-parse", "--show-toplevel")
    if top is None:
        return {"commit": None, "dirty": None}
    excluded = [f":(exclude){name}" for name in GENERATED]
    changes = git("status", "--porcelain", "--", ".", *excluded, at=Path(top))
    return {
        "commit": git("rev-parse", "--verify", "HEAD"),
        "dirty": None if changes is None else bool(changes),
    }


def library_versions() -> dict[str, str]:
    """Python and those of the libraries that shape results which are installed."""
    versions = {"python": platform.python_version()}
    for name in LIBRARIES:
        try:
            versions[name] = metadata.version(name)
        except metadata.PackageNotFoundError:  # optional, or run from the source tree
            continue
    return versions
