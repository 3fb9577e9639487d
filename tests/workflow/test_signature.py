"""The signature changes with everything that decides the result, and with nothing else."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import dataclass, field, make_dataclass, replace
from enum import Enum
from pathlib import Path
from typing import Any

import pytest

import knotflow
from knotflow.workflow.signature import plain, runtime, runtime_fields, signature


class Kind(Enum):
    """An enum, also by the way a str would look."""

    ICP = "icp"
    RANDOM = "random"


@dataclass
class Simulation:
    """Nested."""

    step: float = 0.01
    threads: int = runtime(1)


@dataclass
class Config:
    """One field of every sort."""

    count: int = 3
    rate: float = 1e-5
    kind: Kind = Kind.ICP
    path: Path | None = None
    names: tuple[str, ...] = ("a", "b")
    weights: dict[str, float] = field(default_factory=lambda: {"x": 1.0, "y": 2.0})
    simulation: Simulation = field(default_factory=Simulation)
    parts: list[Simulation] = field(default_factory=lambda: [Simulation()])
    device: str = runtime("cpu")
    logging: dict[str, Any] = runtime(default_factory=dict)


BASE = signature("stage", 1, Config(), {"demos": "0" * 16}, {})


@pytest.mark.parametrize(
    "change",
    [
        {"count": 4},
        {"rate": 1.0000000000000002e-5},
        {"kind": Kind.RANDOM},
        {"path": Path("x")},
        {"names": ("b", "a")},
        {"weights": {"x": 1.0, "y": 2.5}},
        {"simulation": Simulation(step=0.02)},
        {"parts": []},
        {"parts": [Simulation(step=0.02)]},
    ],
    ids=str,
)
def test_every_result_field_counts(change: dict[str, Any]) -> None:
    assert signature("stage", 1, replace(Config(), **change), {"demos": "0" * 16}) != BASE


@pytest.mark.parametrize(
    "other",
    [
        signature("other", 1, Config(), {"demos": "0" * 16}),
        signature("stage", 2, Config(), {"demos": "0" * 16}),
        signature("stage", 1, Config(), {"demos": "1" * 16}),
        signature("stage", 1, Config(), {"demonstrations": "0" * 16}),
        signature("stage", 1, Config()),
        signature("stage", 1, Config(), {"demos": "0" * 16}, {"simulation": 1}),
    ],
)
def test_stage_versions_and_inputs_count(other: str) -> None:
    assert other != BASE


@pytest.mark.parametrize(
    "change",
    [
        {"device": "cuda"},
        {"logging": {"level": "debug"}},
        {"simulation": Simulation(threads=16)},
        {"parts": [Simulation(threads=16)]},
        {"weights": {"y": 2.0, "x": 1.0}},
    ],
    ids=str,
)
def test_what_cannot_change_the_result_does_not_count(change: dict[str, Any]) -> None:
    assert signature("stage", 1, replace(Config(), **change), {"demos": "0" * 16}) == BASE


def test_the_version_of_a_package_counts() -> None:
    one, other = (signature("s", 1, Config(), {}, {"simulation": version}) for version in (1, 2))
    assert one != other


def test_order_of_fields_does_not_count() -> None:
    forth = make_dataclass("Forth", [("a", int), ("b", float)])(1, 2.0)
    back = make_dataclass("Back", [("b", float), ("a", int)])(2.0, 1)
    assert signature("s", 1, forth) == signature("s", 1, back)


def test_types_of_numbers_and_text_count() -> None:
    values: list[Any] = [1, 1.0, True, "1", None, "None", [1]]
    one = make_dataclass("One", [("value", Any)])
    assert len({signature("s", 1, one(value)) for value in values}) == len(values)


def test_fixed_for_ever() -> None:
    # This value was computed once: another one here means that every stored output is lost.
    assert BASE == "01bb9864e65e1e06"


def test_same_in_another_process() -> None:
    program = (
        "from knotflow.workflow.signature import signature; from dataclasses import make_dataclass;"
        "print(signature('s', 1, make_dataclass('C', ['a', 'b'])({'x', 'y', 'z'}, {2: .1, 1: 1e30})"
        ", {'q': 'r', 'p': 's'}))"
    )
    source = str(Path(__file__).parents[2] / "src")
    found = {
        subprocess.run(
            [sys.executable, "-c", program],
            env=os.environ | {"PYTHONHASHSEED": seed, "PYTHONPATH": source},
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        for seed in ("1", "2")
    }
    assert len(found) == 1


def test_value_without_canonical_form_is_named() -> None:
    bad = Config(simulation=Simulation(step=object()))  # type: ignore[arg-type]
    with pytest.raises(TypeError, match=r"simulation\.step is <object.*of type object"):
        signature("s", 1, bad)


def test_runtime_fields_are_listed_by_dotted_key() -> None:
    assert runtime_fields(Config()) == {
        "simulation.threads": 1,
        "parts.0.threads": 1,
        "device": "cpu",
        "logging": {},
    }
    here = str(Path(knotflow.__file__).parent / "primitives" / "data")
    assert runtime_fields(Config(device=here))["device"] == "knotflow/primitives/data"
    assert runtime_fields(Config(device="/elsewhere/data"))["device"] == "/elsewhere/data"
    assert "device" not in plain(Config(), with_runtime=False)
    assert plain(Config())["simulation"] == {"step": 0.01, "threads": 1}
