"""What the command and the package load before there is anything to do."""

from __future__ import annotations

import subprocess
import sys

import pytest

HEAVY = {"torch", "torchrl", "mujoco", "rerun", "matplotlib", "pandas", "scipy", "networkx"}
"""Libraries that take a good part of a second each, or several."""

LOADED = """
import atexit, sys
atexit.register(lambda: print("loaded:", *sys.modules))
"""


def interpreted(code: str) -> subprocess.CompletedProcess[str]:
    """A fresh interpreter that ran the code."""
    return subprocess.run([sys.executable, "-c", LOADED + code], capture_output=True, text=True)


def loaded(done: subprocess.CompletedProcess[str]) -> set[str]:
    """Modules that an interpreter had loaded when it ended, however it ended."""
    (line,) = [line for line in done.stdout.splitlines() if line.startswith("loaded: ")]
    return set(line.split()[1:])


def command(*arguments: str) -> str:
    """Code that calls the command in this interpreter."""
    return (
        f"import runpy, sys; sys.argv = ['knotflow', *{arguments!r}]\n"
        "runpy.run_module('knotflow', run_name='__main__')"
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    "code",
    [
        "import knotflow, knotflow.planning, knotflow.samplers.primitives, knotflow.training",
        "import knotflow.experiments.config",
        command("+experiment=knost"),
        command("+experiment=knots", "knost=1"),
        command("+experiment=knots", "planner.batch=many"),
        command("--help"),
    ],
)
def test_heavy_libraries_are_loaded_only_where_there_is_work(code):
    modules = loaded(interpreted(code))
    assert "knotflow" in modules
    assert not HEAVY & modules


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "used", "unused"),
    [
        ("planning", set(), {"torch"}),
        ("samplers.primitives", {"torch", "knotflow.samplers.primitives.library"}, {"tensordict"}),
        ("training", {"torch", "torchrl"}, set()),
    ],
)
def test_every_name_of_a_package_can_be_had_and_loads_what_it_uses(name, used, unused):
    code = f"from knotflow.{name} import *; import knotflow.{name} as package; package.__all__"
    done = interpreted(code)
    assert done.returncode == 0, done.stderr
    modules = loaded(done)
    assert used <= modules
    assert not unused & modules
