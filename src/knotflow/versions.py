"""The version of what each component computes.

A component whose behaviour changes (physics, start generation, encoding, search) raises its own
number here, and nothing else: every stage that uses the component, directly or through another one,
has the number in its key (`workflow.dependencies`). tests/test_golden.py fails when behaviour
changed and the number did not. Changes of speed, names or errors raise none.
"""

from __future__ import annotations

from typing import NamedTuple


class Component(NamedTuple):
    """A part of knotflow that computes something."""

    version: int
    modules: tuple[str, ...]
    """Modules and packages below knotflow that it consists of; the longest match owns a module."""


COMPONENTS = {
    "topology": Component(1, ("topology",)),
    "simulation": Component(3, ("simulation",)),
    "demonstrations": Component(3, ("samplers.demonstrations",)),
    "baselines": Component(2, ("samplers.random", "samplers.icp")),
    "causal_infogan": Component(2, ("samplers.causal_infogan", "training.causal_infogan")),
    "primitives": Component(5, ("samplers.primitives",)),
    "trainer": Component(1, ("training.trainer",)),
    "training": Component(8, ("training",)),
    "planning": Component(10, ("planning",)),
    "perception": Component(13, ("perception",)),
    "crossings": Component(1, ("perception.estimation.crossings",)),
    "tracking": Component(2, ("perception.tracking",)),
    "execution": Component(9, ("execution",)),
    "control": Component(1, ("execution.closed_loop", "execution.mppi", "execution.step_executor")),
    "twin": Component(1, ("execution.twin",)),
    "export": Component(1, ("execution.arm.export", "execution.arm.timing")),
    "recording": Component(1, ("recording",)),
}
"""Names are independent of folders, so moving a file invalidates no stage."""

LIBRARIES = (
    *("mujoco", "numba", "numpy", "pytorch_mppi", "scipy", "skimage"),
    *("mink", "tensordict", "torch", "torchrl"),
)
"""Import names of libraries whose minor version may change a result."""
