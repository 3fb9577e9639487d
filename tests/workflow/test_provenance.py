"""The commit and whether the code differs from it."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from knotflow.workflow.provenance import git_state, library_versions


def test_commit_and_dirty(tmp_path: Path) -> None:
    def git(*arguments: str) -> str:
        identity = ["-c", "user.name=n", "-c", "user.email=e", "-c", "commit.gpgsign=false"]
        command = ["git", "-C", str(tmp_path), *identity, *arguments]
        return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()

    git("init")
    (tmp_path / "src").mkdir()
    (tmp_path / "src" / "code.py").write_text("1")
    assert git_state(tmp_path) == {"commit": None, "dirty": True}
    git("add", ".")
    git("commit", "--no-verify", "-m", "first")
    clean = {"commit": git("rev-parse", "HEAD"), "dirty": False}
    assert git_state(tmp_path / "src") == clean
    (tmp_path / "results").mkdir()
    (tmp_path / "results" / "table.csv").write_text("1")
    assert git_state(tmp_path / "src") == clean  # results come from the code, they are not it
    (tmp_path / "src" / "code.py").write_text("2")
    assert git_state(tmp_path)["dirty"] is True


def test_outside_of_a_repository(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("GIT_CEILING_DIRECTORIES", str(tmp_path.parent))
    assert git_state(tmp_path) == {"commit": None, "dirty": None}


def test_library_versions() -> None:
    assert {"python", "numpy", "torch"} <= library_versions().keys()
