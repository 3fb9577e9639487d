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


def loaded(code: str) -> set[str]:
    """Modules that a fresh interpreter has loaded when it ends, however it ends."""
    done = subprocess.run([sys.executable, "-c", LOADED + code], capture_output=True, text=True)
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
    modules = loaded(code)
    assert "knotflow" in modules
    assert not HEAVY & modules


@pytest.mark.slow
def test_what_is_used_is_loaded():
    assert {"torch", "knotflow.samplers.primitives.library"} <= loaded(
        "from knotflow.samplers.primitives import PrimitiveLibrary"
    )


@pytest.mark.slow
@pytest.mark.parametrize("name", ["planning", "samplers.primitives", "training"])
def test_every_name_of_a_package_can_be_had(name):
    code = f"from knotflow.{name} import *; import knotflow.{name} as package; package.__all__"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
