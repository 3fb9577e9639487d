from dataclasses import dataclass
from pathlib import Path

import pytest

from knotflow.workflow import StageRun, WorkflowError, get_stage, stage
from knotflow.workflow.stage import Stage

NAMES = ["a"]


@dataclass
class Part:
    length: float = 1.0


def toy(run: StageRun, *, source: Path, part: Part, names: list[str] = NAMES, count: int) -> None:
    """Makes nothing."""


def test_paths_are_inputs_and_the_rest_arguments():
    one = Stage(toy)
    assert [*one.inputs] == ["source"]
    assert one.arguments == ["part", "names", "count"]


def test_arguments_are_typed_and_layers_are_merged():
    bound = Stage(toy).bind({"part": [{"length": 2}, {}], "count": [3]})
    assert bound == {"part": Part(2.0), "names": ["a"], "count": 3}


def test_defaults_are_copied():
    one = Stage(toy)
    one.bind({"part": [{}], "count": [1]})["names"].append("b")
    assert one.bind({"part": [{}], "count": [1]})["names"] == ["a"]


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"part": [{"lenght": 2}], "count": [1]}, "lenght.*length"),
        ({"part": [{}], "count": ["many"]}, "many.*count"),
        ({"part": [{}]}, "count"),
    ],
)
def test_wrong_arguments_are_refused_with_the_valid_ones(values, message):
    with pytest.raises(WorkflowError) as error:
        Stage(toy).bind(values)
    for word in message.split(".*"):
        assert word in str(error.value)


def test_unknown_stages_are_refused_with_the_known_ones():
    with pytest.raises(WorkflowError, match="unknown stage 'toy_nothing'.*toy_numbers"):
        get_stage("toy_nothing")


def test_two_functions_of_one_name_are_refused():
    def toy_sum(run: StageRun) -> None:
        """Another."""

    toy_sum.__module__ = "elsewhere"
    with pytest.raises(ValueError, match="two stages are called 'toy_sum'"):
        stage(toy_sum)


def test_identity_counts_arguments_inputs_and_modules_of_values(monkeypatch):
    one = Stage(toy)
    arguments = one.bind({"part": [{}], "count": [1]})
    identity = one.identity(arguments, {"source": "abc"})
    assert identity["inputs"] == {"source": "abc"}
    assert identity["arguments"]["part"] == {"length": 1.0}
    assert identity != one.identity(arguments, {"source": "other"})
    monkeypatch.setattr(Part, "modules", lambda self: ("knotflow.planning.tree",), raising=False)
    assert "planning" in one.identity(arguments, {"source": "abc"})["components"]


def test_identity_counts_the_contents_of_files_that_arguments_name(tmp_path):
    file, one = tmp_path / "rope.csv", get_stage("toy_sum")
    arguments = {"cases": [{"goal": "overhand", "start": str(file)}]}
    absent = one.identity(arguments, {})
    assert "files" not in absent
    file.write_text("0,0,0")
    first = one.identity(arguments, {})
    file.write_text("1,0,0")
    assert absent != first != one.identity(arguments, {})
