"""The `knotflow` command, for people with a rope; `python -m knotflow` runs the experiments.

Cyclopts reads the commands off the functions' types and docstrings, suggests what was meant, and
completes in bash, zsh and fish (`knotflow --install-completion`). Everything heavy is imported
inside the commands: help and errors are there at once.

Exit codes: 0 done, or tied; 1 not tied, out of the arm's reach, or the viewer found problems;
2 wrong input.
"""

from __future__ import annotations

import re
import sys
import tempfile
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import App, CycloptsError, Parameter
from cyclopts.validators import Number

EXAMPLES = """\
Examples:
  knotflow plan overhand                               for a random rope
  knotflow plan figure_eight --rope measured.csv       for yours: x, y, z rows
  knotflow next overhand --rope measured.csv           only the next action
  knotflow explain                                     the notation in pictures
  knotflow explain "C(0,2,-1)" --state 3o1-2o4-        one action in a state
  knotflow explain overhand                            every way to a knot
  knotflow view plans/overhand-random-0/plan.mcap      in Rerun, or with --web
  knotflow studio                                      plan, watch, demonstrate
  knotflow see image.png depth.png --camera camera.yaml --out rope.csv
  knotflow export plans/overhand-random-0 --arm panda  joint trajectories

Exit codes: 0 tied, 1 not tied, 2 wrong input.
Experiments: python -m knotflow +experiment=NAME"""


def _version() -> str:
    try:
        return version("knotflow")
    except PackageNotFoundError:
        return "unknown: run from a source tree that is not installed"


app = App(
    name="knotflow",
    help="Robots that tie knots: from a rope as it lies to a knot.",
    help_epilogue=EXAMPLES,
    help_format="plaintext",
    version=_version,
    default_parameter=Parameter(negative=()),
)
app.register_install_completion_command()

Unit = Literal["m", "cm", "mm"]
Rope = Annotated[
    str,
    Parameter(help="straight, arc, random, or a CSV or NPY file of x, y, z rows, head first."),
]


@app.command
def plan(
    knot: str,
    /,
    *,
    rope: Rope = "random",
    rope_unit: Unit | None = None,
    out: Path | None = None,
    seed: int = 0,
    max_seconds: float = 60.0,
    margin: float = 0.0,
    overwrite: bool = False,
) -> int:
    """Plan how to tie a knot into a rope as it lies.

    Parameters
    ----------
    knot
        overhand, figure_eight, ...; crossings (4o1+2o5+6o3+); or actions ("R1(0,1,1) C(0,1,1)").
    rope_unit
        Of the numbers in the rope's file; the one in its header, such as "x [mm]", or metres.
    out
        Folder for picture, animation, recording and waypoints; plans/KNOT-ROPE-SEED by default.
    seed
        Of a random rope and of the search.
    max_seconds
        Give up after this time.
    margin
        Metres of rope that every step leaves between passages; 0.05 for a real rope.
    overwrite
        Replace another plan in that folder, or plan the same anew.
    """
    from knotflow.apps import tie

    request = tie.Request(knot, rope, rope_unit, seed, max_seconds, margin)
    task = tie.prepare(request)

    from knotflow.config import plan_name  # slower than refusing a wrong knot or rope

    folder = out if out is not None else Path("plans") / plan_name(knot, rope, seed)
    before = tie.recall(folder, request, overwrite)
    if before is not None:
        print(f"{before['text']}\n{folder}: planned before; --overwrite plans it anew")
        return _outcome(before["success"], max_seconds)
    _check_writable(folder)
    found, last = tie.search(task)
    tie.write(folder, task, found, last)
    print(f"{found.summary()}\n{folder}: plan.png, plan.gif, plan.mcap, waypoints.csv and others")
    return _outcome(found.solved, max_seconds)


@app.command(name="next")
def next_step(
    knot: str,
    /,
    *,
    rope: Rope | None = None,
    rope_unit: Unit | None = None,
    image: tuple[Path, Path] | None = None,
    camera: Path | None = None,
    out: Path | None = None,
    seed: int = 0,
    max_seconds: float = 60.0,
    margin: float = 0.05,
) -> int:
    """The next action, how sure it is, what to check.

    Parameters
    ----------
    knot
        As in `knotflow plan`.
    rope_unit
        Of the numbers in the rope's file; the one in its header, such as "x [mm]", or metres.
    image
        Colours and depth, in place of a rope: as in `knotflow see`.
    camera
        Of the image: as in `knotflow see`.
    out
        CSV for the gripper's waypoints of this action alone.
    seed
        Of the search.
    max_seconds
        Give up after this time.
    margin
        Metres of rope that every step leaves between passages, as your rope is not the planner's.
    """
    from dataclasses import replace

    from knotflow.apps import tie
    from knotflow.topology.action_text import describe

    if out is not None:
        _check_free(out)
    if (rope is None) == (image is None) or (image is None) != (camera is None):
        raise ValueError("next takes either --rope, or --image COLOURS DEPTH with --camera")
    if image is not None and camera is not None:
        from knotflow.perception import seeing

        seen, *_ = seeing.see(*image, camera)
        print(seeing.describe(seen))
        if seen.doubtful:
            print("nothing is planned for a rope in doubt: lay its crossings apart, look again")
            return 1
        with tempfile.TemporaryDirectory() as folder:
            seeing.write_rope(measured := Path(folder) / "seen.csv", seen.points)
            task = tie.prepare(tie.Request(knot, str(measured), None, seed, max_seconds, margin))
    else:
        assert rope is not None
        task = tie.prepare(tie.Request(knot, rope, rope_unit, seed, max_seconds, margin))
    found, _ = tie.search(task)
    if not found.solved:
        tighter = f"; with tighter loops: --margin {margin / 2:g}" if margin else ""
        print(f"{found.summary()}\nlonger: --max-seconds {2 * max_seconds:g}{tighter}")
        return 1
    step = found.steps[0]
    low, middle, end = found.controls[0]
    share = tie.certainty(task, step)
    print(
        f"{len(found.steps)} actions to {knot}; the next is\n"
        f"  {describe(step.action, step.start_state)}\n"
        f"grasp    {_place(low)}, {step.spline[0]:.0%} of the rope from its head\n"
        f"through  {_place(middle)} (middle control point)\n"
        f"release  {_place(end)}\n"
        f"sure     {share:.0%} of {tie.REPEATS} repetitions with a gripper 5 mm off reach it\n"
        f"check    the rope must then read {step.end_state}; measure it and ask again"
    )
    if out is not None:
        out.parent.mkdir(parents=True, exist_ok=True)
        replace(found, steps=found.steps[:1]).waypoints().to_csv(out)
        print(out)
    return 0


@app.command
def explain(
    what: str = "", /, *, state: str = "trivial", out: Path | None = None, overwrite: bool = False
) -> int:
    """Draw an action, a state, or the ways to a knot.

    Parameters
    ----------
    what
        An action such as "C(0,2,-1)", a state such as 4o1+2o5+6o3+, or a knot's name; without it,
        one action of each kind.
    state
        Before the action.
    out
        PNG, SVG or PDF; explain-WHAT.png here by default.
    overwrite
        Replace a file of that name.
    """
    from knotflow.topology import KNOT_NAMES, TopologicalState, knot, parse_action
    from knotflow.topology.action_text import describe

    path = out if out is not None else Path(f"explain-{_word(what + _after(state)) or 'all'}.png")
    if path.suffix not in (".png", ".svg", ".pdf"):
        raise ValueError(f"--out {path}: a picture is a .png, .svg or .pdf file")
    if out is not None and not overwrite:
        _check_free(path)
    if what in KNOT_NAMES:
        from knotflow.planning.dag import SolutionDag
        from knotflow.viz.dag import draw_dag

        states = sorted(knot(what))
        draw_dag(SolutionDag.to(states[-1]), [path])
        print(f"every way to {states[-1]}, one of {len(states)} states of {what}")
    elif not what:
        from knotflow.viz.action import draw_notation

        draw_notation(path)
    elif "(" in what:
        action, before = parse_action(what), TopologicalState.parse(state)
        print(describe(action, before))
        from knotflow.viz.action import draw_action

        draw_action(action, before, path)
    elif what[0].isdigit() or what == "trivial":
        shown = TopologicalState.parse(what)
        from knotflow.viz.action import draw_state

        draw_state(shown, path)
        print(f"{shown}: {shown.num_crossings} crossings, segments 0 to {shown.num_segments - 1}")
    else:
        raise ValueError(
            f"cannot explain {what!r}: give a knot ({', '.join(KNOT_NAMES)}), an action such as "
            "'C(0,2,-1)', or a state such as 4o1+2o5+6o3+"
        )
    print(path)
    return 0


@app.command
def view(
    recording: Path,
    /,
    *,
    number: int | None = None,
    save: Path | None = None,
    headless_check: Path | None = None,
    web: bool = False,
) -> int:
    """Show recorded rollouts in Rerun.

    Parameters
    ----------
    recording
        An .mcap file, or a folder of them.
    number
        Show only the rollout of this number.
    save
        Write a Rerun file (.rrd) instead of opening it.
    headless_check
        Open it without a window, report what Rerun complains about, keep a screenshot (PNG).
    web
        Serve it to web browsers instead of opening a window, until Ctrl-C; prints the address.
    """
    from knotflow.view import show
    from knotflow.viz.viewer import ViewerError

    picture = None if headless_check is None else str(headless_check)
    try:
        return show(recording, number, save, picture, web)
    except ViewerError as error:
        print(f"knotflow: {error}", file=sys.stderr)
        return 1


@app.command
def export(
    plan: Path,
    /,
    *,
    arm: str = "panda",
    base: Path | None = None,
    tip: str | None = None,
    max_speed: float = 0.25,
    format: Literal["csv", "ros2"] = "csv",
    space: Literal["joint", "cartesian"] = "joint",
    out: Path | None = None,
) -> int:
    """A plan as a trajectory for an arm.

    Parameters
    ----------
    plan
        A plan's folder, or its plan.json.
    arm
        panda, or an MJCF file.
    base
        YAML with position (metres) and rpy_deg of the arm's base in the rope's frame.
    tip
        Site between the fingers of an arm from a file.
    max_speed
        Of the tip, metres per second.
    format
        Rows of numbers, or a ROS 2 trajectory_msgs message as YAML.
    space
        Of the arm's joints, or of its tip.
    out
        File to write; beside the plan by default.
    """
    from knotflow.execution import export_plan
    from knotflow.planning import KnotPlan

    source = plan / "plan.json" if plan.is_dir() else plan
    suffix = "csv" if format == "csv" else "yaml"
    path = out if out is not None else source.with_name(f"{Path(arm).stem}-{space}.{suffix}")
    _check_free(path)
    found = KnotPlan.from_json(source.read_text(encoding="utf-8"))
    exported = export_plan(found, arm, base, max_speed, format, space, tip=tip)
    path.write_text(exported.text, encoding="utf-8")
    print(f"{exported.summary()}\n{path}")
    return 0 if exported.reachable else 1


@app.command
def studio(
    *,
    rope: Rope = "random",
    demonstrations: Path = Path("demonstrations.jsonl"),
    host: str = "localhost",
    port: Annotated[int, Parameter(validator=Number(gte=1, lte=65535))] = 8080,
) -> int:
    """Lay ropes, plan, watch and demonstrate in the browser.

    Parameters
    ----------
    rope
        On the table at first.
    demonstrations
        File that kept demonstrations are added to.
    host
        Address to listen on; 0.0.0.0 lets other machines in.
    port
        Port of the page, or the next that is free. Over ssh: ssh -L 8080:localhost:8080 MACHINE.
    """
    _check_writable(demonstrations)
    try:
        from knotflow.apps.studio.page import Page
    except ModuleNotFoundError as error:
        raise ImportError(
            f"the studio needs {error.name}: pip install 'knotflow[studio]'"
        ) from error
    from knotflow.apps.studio.session import Session

    page = Page(Session(rope, demonstrations), host, port)
    print(f"{page.url} (Ctrl-C ends it)")
    try:
        page.serve()
    finally:
        page.close()
    return 0


@app.command
def merge(files: list[Path], /, *, out: Path) -> int:
    """Make one file of several people's demonstrations.

    Parameters
    ----------
    files
        JSON lines, as the studio keeps them; none may hold the same demonstration as another.
    out
        File to write.
    """
    from knotflow.samplers.demonstrations import merge_demonstrations, save_demonstrations

    _check_free(out)
    merged = merge_demonstrations(files)
    save_demonstrations(out, merged)
    people = sorted({one.who or one.source for one in merged})
    print(f"{out}: {len(merged)} demonstrations by {', '.join(people)}")
    return 0


@app.command
def see(
    image: Path,
    depth: Path,
    /,
    *,
    camera: Path,
    out: Path,
    picture: Path | None = None,
    length: float | None = None,
    radius: float | None = None,
    overwrite: bool = False,
) -> int:
    """The rope in an RGB-D image, as a file for `--rope`.

    Parameters
    ----------
    image
        Colours, as PNG.
    depth
        PNG of 16-bit millimetres, or NPY of metres; registered to the colours.
    camera
        YAML with intrinsics and pose; the table is at z = 0.
    out
        CSV of the rope's points, head first.
    picture
        Of the image with the rope drawn over it; beside the CSV by default.
    length
        Of the rope, metres; the model's by default.
    radius
        Of the rope, metres; the model's by default.
    overwrite
        Replace files of those names.
    """
    from dataclasses import replace

    drawing = picture if picture is not None else out.with_suffix(".png")
    for path in (out, drawing):
        (_check_writable if overwrite else _check_free)(path)

    from knotflow.perception import seeing  # slow to import
    from knotflow.simulation import RopeConfig

    rope = RopeConfig()
    rope = replace(rope, length=length or rope.length, radius=radius or rope.radius)
    found, seen, pinhole = seeing.see(image, depth, camera, rope)
    seeing.write_rope(out, found.points)
    seeing.draw_overlay(drawing, seen, pinhole, rope, found)
    print(f"{seeing.describe(found)}\n{out}, {drawing}")
    return 1 if found.doubtful else 0


@app.command
def report(*, results: Path = Path("results"), out: Path = Path("reports")) -> int:
    """Make the report from the results folder alone.

    Parameters
    ----------
    results
        Folder with a folder for each experiment.
    out
        Folder for report.md, index.html and figures/.
    """
    from knotflow.report import make

    written = make(results, out)
    print(f"{out / 'index.html'} and {len(written) - 1} other files")
    return 0


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; see the module for what it returns."""
    try:
        return app(arguments, exit_on_error=False, result_action="return_value") or 0
    except CycloptsError:
        return 2  # reported by cyclopts already
    except (ValueError, OSError, ImportError) as error:
        print(f"knotflow: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130


def _outcome(tied: bool, max_seconds: float) -> int:
    """The exit code of a plan; of one that ties nothing it is said what to try."""
    if not tied:
        print(f"longer: --overwrite --max-seconds {2 * max_seconds:g}; by another way: --seed N")
    return 0 if tied else 1


def _place(point: Sequence[float]) -> str:
    return "x {:+.3f}  y {:+.3f}  z {:.3f} m".format(*point)


def _after(state: str) -> str:
    return "" if state == "trivial" else f" after {state}"


def _word(text: str) -> str:
    """A text as part of a file's name; signs stay apart."""
    signs = text.replace("+", "p").replace("-", "m")
    return re.sub(r"[^A-Za-z0-9]+", "_", signs).strip("_")


def _check_free(path: Path) -> None:
    if path.exists():
        raise ValueError(f"{path} exists already; name another file with --out")
    _check_writable(path)


def _check_writable(path: Path) -> None:
    """Refuse early: a search whose plan cannot be written is lost."""
    import os

    folder = next(one for one in path.absolute().parents if one.exists())
    if not folder.is_dir() or not os.access(folder, os.W_OK):
        raise ValueError(f"cannot write {path}: {folder} is not a folder one may write to")


if __name__ == "__main__":
    sys.exit(main())
