"""The version of what each package computes.

A package whose behaviour changes (physics, start generation, encoding, search) raises its own
number here, and nothing else: every stage that uses the package, directly or through another one,
has it in its signature (`workflow.packages`), so its outputs are reproduced. tests/test_golden.py
fails when behaviour changed and the number did not. Changes of speed, names or errors raise none.
"""

VERSIONS = {
    "topology": 1,
    "simulation": 2,
    "demonstrations": 2,
    "baselines": 1,
    "baselines.causal_infogan": 1,
    "primitives": 3,
    "training": 5,
    "planning": 9,
    "perception": 9,
    "execution": 6,
}
"""Package below knotflow -> its version. One inside another, with a number of its own, is not
covered by that of the outer one."""
