"""Toy stages: shards that are counted, and a sum over them; and a workflow of the two."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from knotflow.workflow import CodeState, StageContext, Workflow, run, runtime, stage

CALLS: list[str] = []


@dataclass
class Machine:
    """Nested config with a field that cannot change the result."""

    scale: int = 2
    threads: int = runtime(1)


@dataclass
class CountConfig:
    """Config of `toy_count`."""

    shards: int = 3
    machine: Machine = field(default_factory=Machine)
    device: str = runtime("cpu")


@dataclass
class SumConfig:
    """Config of `toy_sum`."""

    offset: float = 0.0
    factors: list[int] = field(default_factory=lambda: [1, 2])

    def __post_init__(self) -> None:
        """Refuses what the type alone allows."""
        if self.offset < 0:
            raise ValueError(f"offset is {self.offset}, must be >= 0")


@stage("toy_count", version=1, inputs=())
def count(config: CountConfig, inputs: Mapping[str, Path], context: StageContext) -> None:
    """Writes shard-0.txt, shard-1.txt, ... each holding index * scale."""
    CALLS.append("toy_count")
    names = [f"shard-{index}" for index in range(config.shards)]
    for name in context.pending(names, ".txt"):
        with context.atomic(f"{name}.txt") as path, path.open("w") as file:
            file.write(f"{int(name[6:])} ")
            file.flush()  # half a shard is on the disk now
            BETWEEN()
            file.write(f"{int(name[6:]) * config.machine.scale}\n")


@stage("toy_sum", version=1, inputs=("counts",))
def total(config: SumConfig, inputs: Mapping[str, Path], context: StageContext) -> None:
    """Writes sum.csv, and the same number in a folder."""
    CALLS.append("toy_sum")
    numbers = [int(path.read_text().split()[1]) for path in inputs["counts"].glob("shard-*.txt")]
    with context.atomic("sum.csv") as path:
        path.write_text(f"sum\n{sum(numbers) + config.offset}\n")
    with context.atomic("pictures") as folder:
        folder.mkdir()
        (folder / "sum.txt").write_text(f"{sum(numbers)}\n")


def BETWEEN() -> None:
    """Called in the middle of every shard; tests replace it to interrupt there."""


@pytest.fixture(autouse=True)
def _forget_calls() -> Iterator[None]:
    CALLS.clear()
    yield


@pytest.fixture
def calls() -> list[str]:
    """Names of the toy stages that ran in this test, in order."""
    return CALLS


@pytest.fixture
def between(monkeypatch: pytest.MonkeyPatch) -> Callable[[Callable[[], None]], None]:
    """Sets what happens in the middle of every shard."""
    return lambda action: monkeypatch.setitem(globals(), "BETWEEN", action)


@pytest.fixture
def mapping() -> dict[str, Any]:
    """The toy workflow as its YAML would be read; free to be changed."""
    return {
        "name": "toy",
        "caption": "counts and their sum",
        "stages": {
            # listed against their order on purpose
            "adding": {
                "stage": "toy_sum",
                "needs": {"counts": "toy_count"},
                "config": {"offset": 0.5},
                "caption": "the sum",
            },
            "toy_count": {"config": {"machine": {"scale": 3}}},
        },
        "results": {"sum.csv": "adding/sum.csv", "figures/toy": "adding/pictures"},
    }


@pytest.fixture
def go(tmp_path: Path) -> Callable[..., Path]:
    """Runs a workflow mapping in tmp_path/results without metrics."""

    def run_it(mapping: Mapping[str, Any], **changes: Any) -> Path:
        settings: dict[str, Any] = {
            "experiment": "toy",
            "results_dir": tmp_path / "results",
            "code": CodeState("abc", False),
            "budget": "smoke",
            "metrics": "none",
        }
        return run(Workflow.from_config(mapping), **(settings | changes))

    return run_it
