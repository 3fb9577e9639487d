"""A toy workflow: numbers, made in shards, and their sum."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from knotflow.workflow import StageRun, read_workflow, run_workflow, stage
from knotflow.workflow.stage import STAGES


@dataclass
class ToyConfig:
    """What numbers are made of."""

    offset: float = 0.5
    threads: int = field(default=1, metadata={"affects_result": False})


calls: list[str] = []
"""Shards in the order in which they were made."""


@pytest.fixture(autouse=True)
def toy_stages() -> Iterator[None]:
    """Register the toy stages for a test alone."""
    before = dict(STAGES)
    for function in (toy_numbers, toy_sum, toy_table):
        stage(function)
    calls.clear()
    yield
    STAGES.clear()
    STAGES.update(before)


def toy_numbers(
    run: StageRun, *, shards: int = 3, toy: ToyConfig, seed: int, recorded: bool = False
) -> None:
    """Makes NAME.txt, and recordings/0.mcap if it is `recorded`."""
    if recorded:
        with run.atomic("recordings/0.mcap") as path:
            path.write_text("moves")
    names = [f"{index}" for index in range(shards)]
    for name in run.pending(names, ".txt"):
        calls.append(name)
        with run.atomic(f"{name}.txt") as path:
            path.write_text(str(float(name) + toy.offset + seed))


def toy_sum(run: StageRun, *, toy_numbers: Path, extra: Path | None = None) -> None:
    """Makes sum.txt."""
    numbers = [float(path.read_text()) for path in sorted(toy_numbers.glob("*.txt"))]
    if extra is not None:
        numbers.append(float(extra.read_text()))
    with run.atomic("sum.txt") as path:
        path.write_text(str(sum(numbers)))


def toy_table(run: StageRun, *, sums: Mapping[str, Path]) -> None:
    """Makes table.csv."""
    with run.atomic("table.csv") as path:
        rows = [f"{name},{(folder / 'sum.txt').read_text()}\n" for name, folder in sums.items()]
        path.write_text("name,sum\n" + "".join(rows))


@pytest.fixture
def root() -> dict[str, Any]:
    """A root configuration."""
    return {
        "toy": {"offset": 0.5, "threads": 1},
        "toy_numbers": {"seed": 1},
        "workflow": {
            "name": "toys",
            "caption": "Numbers and their sum",
            "stages": {"toy_numbers": None, "toy_sum": {"caption": "All of them"}},
            "results": {"sum.txt": "toy_sum"},
        },
    }


@pytest.fixture
def read(root: dict[str, Any], tmp_path: Path) -> Any:
    """Reads the workflow of `root`, with an option `big` of the group `toy`."""
    (tmp_path / "conf" / "toy").mkdir(parents=True)
    (tmp_path / "conf" / "toy" / "big.yaml").write_text("offset: 100.0\n")
    return lambda: read_workflow(root, tmp_path / "conf")


@pytest.fixture
def go(read: Any, tmp_path: Path) -> Any:
    """Runs the workflow of `root` as it is now."""
    return lambda **more: run_workflow(read(), tmp_path / "results", **more)
