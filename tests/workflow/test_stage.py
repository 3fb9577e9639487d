"""Registration of stages."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import pytest

from knotflow.workflow import StageContext, UnknownStageError, get_stage, stage
from knotflow.workflow.stage import STAGES


@dataclass
class Config:
    """A config."""

    count: int = 1


def simulate(config: Config, inputs: Mapping[str, Path], context: StageContext) -> None:
    """A stage function."""


@pytest.fixture(autouse=True)
def _empty_registry() -> Iterator[None]:
    before = dict(STAGES)
    STAGES.clear()
    yield
    STAGES.clear()
    STAGES.update(before)


def test_registers_and_returns_the_function() -> None:
    assert stage("toy", version=3, inputs=["demos"])(simulate) is simulate
    found = get_stage("toy")
    assert (found.version, found.config_type, found.inputs) == (3, Config, ("demos",))
    assert found.function is simulate
    assert found.packages == {}  # this file imports none that computes


def test_unknown_stage_lists_the_valid_ones() -> None:
    stage("second", version=1)(simulate)
    stage("first", version=1)(simulate)
    with pytest.raises(UnknownStageError, match="unknown stage 'thrid'.*first, second"):
        get_stage("thrid")


def test_one_name_one_function() -> None:
    def other(config: Config, inputs: Mapping[str, Path], context: StageContext) -> None: ...

    stage("toy", version=1)(simulate)
    stage("toy", version=1)(simulate)  # a module that is imported again
    with pytest.raises(ValueError, match=r"two stages are named 'toy'.*simulate and .*other"):
        stage("toy", version=1)(other)


def test_wrong_functions_are_refused() -> None:
    def untyped(config, inputs, context): ...

    def plain_dict(config: dict, inputs: Mapping, context: StageContext) -> None: ...

    def short(config: Config) -> None: ...

    with pytest.raises(TypeError, match="annotate its first parameter"):
        stage("toy", version=1)(untyped)
    with pytest.raises(TypeError, match="not <class 'dict'>"):
        stage("toy", version=1)(plain_dict)
    with pytest.raises(TypeError, match=r"must take \(config, inputs, context\)"):
        stage("toy", version=1)(short)
    with pytest.raises(ValueError, match="folder's name"):
        stage("../toy", version=1)
    assert not STAGES
