"""The style is ours, whatever the user's; and the package is cheap to import."""

import subprocess
import sys

import matplotlib

from knotflow.viz.style import styled


def test_styled_ignores_and_restores_user_settings():
    before = matplotlib.rcParams["lines.linewidth"]
    matplotlib.rcParams["lines.linewidth"] = 7.0
    try:
        with styled():
            assert matplotlib.rcParams["lines.linewidth"] == 1.5
            assert matplotlib.rcParams["svg.hashsalt"] == "knotflow"
        assert matplotlib.rcParams["lines.linewidth"] == 7.0
    finally:
        matplotlib.rcParams["lines.linewidth"] = before


def test_import_needs_neither_matplotlib_nor_mujoco():
    modules = ("rope", "spline", "style")
    imports = "; ".join(f"import knotflow.viz.{module}" for module in modules)
    check = f"{imports}; import sys; print(sorted({{'matplotlib', 'mujoco'}} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", check], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
