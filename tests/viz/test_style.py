"""The style is ours, whatever the user's; and the package is cheap to import."""

import subprocess
import sys

import matplotlib

from knotflow.viz.style import styled


def test_the_user_s_settings_have_no_say_and_come_back():
    before = matplotlib.rcParams["lines.linewidth"]
    matplotlib.rcParams["lines.linewidth"] = 7.0
    try:
        with styled():
            assert matplotlib.rcParams["lines.linewidth"] == 1.5
            assert matplotlib.rcParams["svg.hashsalt"] == "knotflow"
        assert matplotlib.rcParams["lines.linewidth"] == 7.0
    finally:
        matplotlib.rcParams["lines.linewidth"] = before


def test_drawing_is_imported_without_matplotlib_and_simulation():
    modules = ("palette", "rope", "spline", "style")
    imports = "; ".join(f"import knotflow.viz.{module}" for module in modules)
    check = f"{imports}; import sys; print(sorted({{'matplotlib', 'mujoco'}} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", check], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
