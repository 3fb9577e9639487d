"""The commit of the code, whether the code differs from it, and code that has no commit."""

from __future__ import annotations

import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

import knotflow
from knotflow.workflow import CodeState, code_state
from knotflow.workflow.provenance import library_versions

Git = Callable[..., str]
NONE = CodeState(f"none, version {library_versions().get('knotflow', 'unknown')}")


@pytest.fixture
def git(tmp_path: Path) -> Git:
    """Runs git in tmp_path, a new repository."""

    def run(*arguments: str) -> str:
        identity = ["-c", "user.name=n", "-c", "user.email=e", "-c", "commit.gpgsign=false"]
        command = ["git", "-C", str(tmp_path), *identity, *arguments]
        return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()

    run("init")
    return run


def write_package(folder: Path, pyproject: str = '[project]\nname = "knotflow"\n') -> Path:
    """A checkout with one file of code, in `folder`."""
    package = folder / "src" / "knotflow"
    package.mkdir(parents=True)
    (package / "__init__.py").write_text("1")
    (folder / "pyproject.toml").write_text(pyproject)
    return package


def test_commit_and_dirty(tmp_path: Path, git: Git) -> None:
    package = write_package(tmp_path)
    assert code_state(package) == NONE  # nothing is committed yet
    git("add", ".")
    git("commit", "--no-verify", "-m", "first")
    clean = CodeState(git("rev-parse", "HEAD"), False, git("log", "-1", "--format=%cI"))
    assert code_state(package) == clean
    (tmp_path / "results").mkdir()
    (tmp_path / "results" / "table.csv").write_text("1")
    assert code_state(package) == clean  # results come from the code, they are not it
    (package / "__init__.py").write_text("2")
    assert code_state(package) == replace(clean, dirty=True)


def test_outside_of_a_repository(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("GIT_CEILING_DIRECTORIES", str(tmp_path.parent))
    assert code_state(write_package(tmp_path)) == NONE


@pytest.mark.slow
@pytest.mark.parametrize("place", [".venv/lib/python3.12/site-packages/knotflow", "src/knotflow"])
def test_a_package_inside_a_foreign_repository_records_none(
    place: str, tmp_path: Path, git: Git
) -> None:
    (tmp_path / "pyproject.toml").write_text('[project]\nname = "theirs"\n')
    package = tmp_path / place
    source = Path(knotflow.__file__).parent
    shutil.copytree(source, package, ignore=shutil.ignore_patterns("__pycache__", "data"))
    git("add", "--force", ".")
    git("commit", "--no-verify", "-m", "theirs")
    ask = (
        "from pathlib import Path; import knotflow.workflow as w;"
        "print(w.__file__); print(w.code_state(Path(w.__file__).parents[1]).commit)"
    )
    told = subprocess.run(
        [sys.executable, "-c", ask],
        env={"PYTHONPATH": str(package.parent), "PATH": "/usr/bin:/bin"},
        capture_output=True,
        text=True,
        check=True,
    ).stdout.splitlines()
    assert told == [str(package / "workflow" / "__init__.py"), NONE.commit]


def test_files_that_the_repository_does_not_track_are_not_its_own(tmp_path: Path, git: Git) -> None:
    write_package(tmp_path)
    (tmp_path / ".gitignore").write_text("src\n")
    git("add", ".")
    git("commit", "--no-verify", "-m", "first")
    assert code_state(tmp_path / "src" / "knotflow") == NONE


def test_library_versions() -> None:
    assert {"python", "numpy", "torch"} <= library_versions().keys()
