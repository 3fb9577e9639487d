"""The `knotflow` command; `python -m knotflow` runs the experiments.

Heavy modules are imported inside the commands, so that help and errors appear at once.

Exit codes: 0 success; 1 not tied, out of the arm's reach, in doubt, stale, or no viewer; 2 invalid
input.
"""

from __future__ import annotations

import itertools
import re
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import App, CycloptsError, Parameter
from cyclopts.validators import Number

from knotflow import planning  # its names are loaded when they are used
from knotflow.apps import outputs, search
from knotflow.apps.search import NO_ARM, ArmOptions
from knotflow.planning.config import RopeOptions, plan_name

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from knotflow.perception.photo.estimate import PhotoEstimate
    from knotflow.simulation import RopeConfig

EXAMPLES = """\
Examples:
  knotflow plan overhand                               for a random rope
  knotflow plan figure_eight --rope measured.csv       for rows of x, y, z
  knotflow next overhand --rope measured.csv           only the next action
  knotflow explain "C(0,2,-1)" --state 3o1-2o4-        one action in a state
  knotflow view plans/overhand-random-0/plan.mcap      in Rerun
  knotflow studio                                      plan, watch, demonstrate
  knotflow see image.png depth.png --camera camera.yaml --out rope.csv
  knotflow see photograph.jpg --length 0.9m --out rope.csv
  knotflow run overhand --robot twin                   look, plan, act, repeat
  knotflow export plans/overhand-random-0 --arm panda  joint trajectories

Exit codes: 0 success; 1 not tied, in doubt or out of reach; 2 invalid input.
Experiments: python -m knotflow +experiment=NAME"""

app = App(
    name="knotflow",
    help="Robots that tie knots: from a rope as it lies to a tied knot.",
    help_epilogue=EXAMPLES,
    help_format="plaintext",
    version=outputs.version_text,
    default_parameter=Parameter(negative=()),
)
app.register_install_completion_command()

Rope = Annotated[str, Parameter(help="straight, arc, random, or a file of x, y, z, head first.")]
Options = Annotated[RopeOptions, Parameter(name="*")]
Seed = Annotated[int, Parameter(validator=Number(gte=0))]
Seconds = Annotated[float, Parameter(validator=Number(gt=0), help="Time limit of the search.")]
Worlds = Annotated[int, Parameter(validator=Number(gte=0))]
OfArm = Annotated[ArmOptions, Parameter(name="*")]

MARGIN = 0.03  # least length between crossings of `next` and `run`, metres; a share of short ropes
GRIPPER_ERROR = 0.005  # standard deviation in the worlds of `next`, metres
NO_DEPTH = "--depth-unit is of a depth image, of which there is none"


@app.command(help_epilogue="")
def plan(
    knot: str,
    /,
    *,
    rope: Rope = "random",
    options: Options | None = None,
    out: Path | None = None,
    seed: Seed = 0,
    max_seconds: Seconds = 60.0,
    margin: str = "0",
    worlds: Worlds = 16,
    arm: OfArm = NO_ARM,
    overwrite: bool = False,
) -> int:
    """Plan how to tie a knot into a rope as it lies.

    Args:
        knot: overhand, figure_eight, ...; crossings (4o1+2o5+6o3+); actions ("R1(0,1,1) C(0,1,1)").
        out: Folder for pictures, recording and waypoints; plans/KNOT-ROPE-SEED by default.
        seed: Seed of the random rope and of the search.
        margin: Least length of each piece of rope between crossings, such as 3cm.
        worlds: Search until a plan ties in 3/4 of N perturbed worlds and 2 N others; 0: the first.
        overwrite: Replace the plan in that folder; other files there are kept.
    """
    from knotflow.planning.plan import STOPPED

    measured = search.read_rope(rope, options, seed)
    folder = out if out is not None else Path("plans") / plan_name(knot, rope, seed)
    what = outputs.digest(Path(rope)) if Path(rope).is_file() else rope
    least = _margin(margin, knot, measured.rope)
    request: dict[str, Any] = {"knot": knot, "rope": what, "seed": seed}
    request |= {"max_seconds": max_seconds, "margin": least, "worlds": worlds}
    request |= vars(options or RopeOptions()) | outputs.provenance()
    if arm.arm is not None:
        arm.check()  # before a stored plan is asked
        request |= {key: str(one) for key, one in vars(arm).items() if one is not None}
        request["arm_code"] = outputs.arm_digest(arm.arm, arm.base)
    another = _cure(max_seconds, least, "--overwrite ") + "; another search: --seed N"
    stored = outputs.stored_outcome(folder, request, overwrite)
    if stored is not None:
        print(f"{stored['text']}\n{folder}: already planned; --overwrite plans again")
        if (file := folder / "plan.json").is_file():
            _advise(search.load_plan(file), another)
        return 0 if stored["success"] else 1
    found, last = search.find_plan(
        knot, measured, seed=seed, max_seconds=max_seconds, margin=least, worlds=worlds, arm=arm
    )
    found = found.placed(measured.placement, measured.frame)
    last = last and measured.placement.attempts(last)
    if found.reason == STOPPED:  # by Ctrl-C, so that this was not what was asked for
        request["stopped"] = True
    outputs.write_plan(folder, found, last, measured.rope, request)
    print(f"{found.summary()}\n{folder}: plan.png, plan.gif, plan.mcap, waypoints.csv and others")
    _advise(found, another)
    return 0 if found.solved else 1


@app.command(name="next", help_epilogue="")
def next_step(
    knot: str,
    /,
    *,
    rope: Rope | None = None,
    options: Options | None = None,
    image: Annotated[list[Path] | None, Parameter(consume_multiple=True)] = None,
    camera: Path | None = None,
    depth_unit: str | None = None,
    rope_color: str | None = None,
    head_color: str | None = None,
    plan: Path | None = None,
    out: Path | None = None,
    seed: Seed = 0,
    max_seconds: Seconds = 60.0,
    margin: str | None = None,
    worlds: Worlds = 16,
    arm: OfArm = NO_ARM,
) -> int:
    """Plan only the next action: its grasp and path, its success, and the state to check.

    Args:
        knot: As in `knotflow plan`.
        image: Colour and depth image, or a photograph, in place of --rope: as in `knotflow see`.
        camera: With --image, as in `knotflow see`.
        depth_unit: With --image, as in `knotflow see`.
        rope_color: With --image, as in `knotflow see`.
        head_color: With --image, as in `knotflow see`.
        plan: JSON file that keeps the whole plan, to go on with it after this action.
        out: CSV file for the gripper's waypoints of this action.
        seed: Seed of the search.
        margin: Least length of each piece of rope between crossings; 3cm by default.
        worlds: As in `knotflow plan`, but less perturbed (level 1) and with gripper errors.
    """
    if out is not None:
        outputs.check_free(out)
    if plan is not None:
        outputs.check_writable(plan)
    files, size_of = image or [], (options or RopeOptions()).length
    colours = rope_color, head_color
    apart = (rope is None) != (not files) and (files or not camera)
    if not apart or len(files) > 2 or (len(files) == 2 and not camera):
        raise ValueError(
            "next takes either --rope, or --image COLOUR DEPTH with --camera, or --image "
            "PHOTOGRAPH with --length"
        )
    if not files and any(colours):
        raise ValueError("--rope-color and --head-color are of an image, not of --rope")
    if len(files) < 2 and depth_unit:
        raise ValueError(NO_DEPTH)
    shape: str | planning.RopeTable = rope or ""
    ambiguous = False
    if len(files) == 1:
        photo, _, xy = _see_photo(files[0], camera, size_of, colours, scaled=True)
        assert xy is not None
        shape = planning.RopeTable(xy, "m", photo.over, name=str(files[0]))
        ambiguous = bool(photo.doubts)
    elif camera and files:
        from knotflow.perception import io
        from knotflow.planning.rope.size import RopeSize

        size = RopeSize.of_options(options or RopeOptions()).rope()
        depth = files[1], camera, size, _depth_unit(depth_unit)
        seen, capture = io.see(files[0], *depth, colours, max_seconds)
        print(io.describe(seen, capture))
        shape = planning.RopeTable(seen.points, "m", name=str(files[0]))
        ambiguous = seen.ambiguous
    if ambiguous:
        print("the rope is ambiguous: take an image of all of it, its crossings spread apart")
        return 1
    measured = search.read_rope(shape, options, seed)
    earlier = None if plan is None else search.kept_plan(plan, knot, measured)
    least = _margin(margin, knot, measured.rope)
    state = measured.state
    if state in planning.parse_goal(knot, measured.rope).states:
        print(f"tied: the rope is in the state {state}, which is {knot}")
        return 0
    found, _ = search.find_plan(
        knot, measured, earlier, seed=seed, max_seconds=max_seconds, margin=least, worlds=worlds,
        error=GRIPPER_ERROR, arm=arm,
    )  # fmt: skip
    if not found.solved:
        print(f"{found.summary()}\n{_cure(max_seconds, least)}")
        return 1
    from knotflow.topology.action_text import describe

    found = found.placed(measured.placement, measured.frame)
    if plan is not None:
        with outputs.atomic(plan) as path:
            path.write_text(found.to_json(trajectories=False), encoding="utf-8")
    step = found.steps[0]
    unit, digits = found.frame.unit, {"m": 3, "cm": 1, "mm": 0}[found.frame.unit]
    grasp, middle, end = (
        f"x {x:+.{digits}f}  y {y:+.{digits}f}  z {z:.{digits}f} {unit}"
        for x, y, z in found.frame.to_file(found.controls[0])
    )
    success = ""
    if found.worlds:
        success = f"success  in {found.survived[0]} of {found.worlds} worlds, of the whole plan in "
        success += f"{found.survived[-1]}, with gripper errors of {GRIPPER_ERROR * 1000:g} mm\n"
    print(
        f"{len(found.steps)} actions to {knot}; the next is\n"
        f"  {describe(step.action, step.start_state)}\n"
        f"grasp    {grasp}, {step.spline[0]:.0%} of the rope from its head\n"
        f"through  {middle} (middle control point)\n"
        f"release  {end}\n"
        f"{success}"
        f"check    the rope must then be in the state {step.end_state}; measure it and ask again"
    )
    if out is not None:
        with outputs.atomic(out) as path:
            replace(found, steps=found.steps[:1]).waypoints().to_csv(path, found.frame)
        print(out)
    return 0


@app.command(help_epilogue="")
def run(
    knot: str,
    /,
    *,
    robot: str = "twin",
    camera: Path | None = None,
    length: str | None = None,
    diameter: str | None = None,
    stiffness: str | None = None,
    out: Path = Path("runs"),
    seed: Seed = 0,
    max_seconds: Seconds = 60.0,
    margin: str | None = None,
    worlds: Worlds = 16,
    max_actions: Annotated[int, Parameter(validator=Number(gte=1))] = 20,
    level: Literal[0, 1, 2] | None = None,
    yes: bool = False,
    arm: OfArm = NO_ARM,
) -> int:
    """Tie a knot with a robot: look, plan the next action, ask, act, and look again.

    Args:
        knot: As in `knotflow plan`.
        robot: twin (simulated), or a driver such as my_lab.robots:Arm, see docs/your_arm.md.
        camera: File of the robot's camera, with its pose, see docs/your_camera.md; not for a twin.
        length: As in `knotflow plan`, but 1m by default.
        diameter: As in `knotflow plan`.
        stiffness: As in `knotflow plan`.
        out: Folder for the log (MCAP) of all images and motions.
        seed: Seed of the search and of the twin.
        margin: Least length of each piece of rope between crossings; 3cm by default.
        worlds: As in `knotflow next`.
        max_actions: Give up after this many actions.
        level: Level of the twin's errors in rope, gripper and camera; 1 by default.
        yes: Execute without asking.
    """
    from knotflow.apps import lab
    from knotflow.execution import ExecutionConfig
    from knotflow.perception import Calibration, Camera
    from knotflow.planning.rope.size import RopeSize
    from knotflow.recording import RunLog
    from knotflow.simulation import ShapeError

    options = RopeOptions(length=length, diameter=diameter, stiffness=stiffness)
    rope = RopeSize.of_options(options).rope()
    planning.parse_goal(knot, rope)  # refuses it before a robot is asked for
    search.check_thickness(rope)
    least = _margin(margin, knot, rope)
    arm.check()
    if not yes and not sys.stdin.isatty():
        raise ValueError("run asks before every action: use a terminal, or --yes")
    if robot == "twin" and camera is not None:
        raise ValueError(f"--camera {camera} is not for the simulated robot; name yours by --robot")
    if robot != "twin" and level is not None:
        raise ValueError(f"--level {level} is for the simulated robot")
    if robot == "twin":
        eye = Camera.overhead()
        driver = lab.make_twin(rope, eye, 1 if level is None else level, seed)
    elif camera is None:
        raise ValueError(f"--robot {robot} needs --camera FILE, with its pose")
    else:
        eye, driver = Calibration.load(camera).camera(), lab.load_robot(robot)

    found: planning.KnotPlan | None = None
    seeds = itertools.count(seed)

    def replan(points: NDArray) -> planning.KnotPlan:
        nonlocal found
        try:
            measured = search.read_rope(planning.RopeTable(points, "m"), options, seed)
        except planning.RopeInputError as error:
            raise ShapeError(str(error)) from error
        if found is not None:
            found = search.resampled(found, measured)
        found, _ = search.find_plan(
            knot, measured, found, seed=next(seeds), max_seconds=max_seconds, margin=least,
            worlds=worlds, error=GRIPPER_ERROR, arm=arm,
        )  # fmt: skip
        return found.placed(measured.placement, measured.frame)

    path = lab.log_path(out, knot)
    with RunLog(path, {"knot": knot, "robot": robot}) as log:
        config = ExecutionConfig(max_actions=max_actions)
        allow = lab.ask(yes)
        show = lab.show(allow)
        done = lab.tie(knot, driver, eye, rope, replan, show, log, config, allow)
    print(f"{'tied' if done.tied else 'not tied'}: {done.reason}\n{path}")
    return 0 if done.tied else 1


@app.command
def knots(*, out: Path | None = None) -> None:
    """List the knots that have a name.

    Args:
        out: File for a picture of them all: PNG, SVG or PDF.
    """
    from knotflow.topology import CATALOGUE, knot

    if out is not None:
        _check_picture(out)
        outputs.check_free(out)
    for one in CATALOGUE:
        states = sorted(knot(one.name))
        known = f" ({', '.join(one.aliases)})" if one.aliases else ""
        plural = "s" * (len(states) > 1)
        count = f"{states[0].num_crossings} crossings, {len(states)} state{plural}"
        print(f"{one.name + known:38}{count:26}{one.use}")
    if out is not None:
        from knotflow.viz.notation import draw_knots

        out.parent.mkdir(parents=True, exist_ok=True)
        draw_knots(out)
        print(out)


@app.command
def explain(what: str = "", /, *, state: str = "trivial", out: Path | None = None) -> None:
    """Draw an action, a state, or the paths to a knot.

    Args:
        what: Action "C(0,2,-1)", state 4o1+2o5+6o3+ or knot; by default every kind of action.
        state: The state before the action.
        out: PNG, SVG or PDF; explain-WHAT.png here by default.
    """
    from knotflow.topology import KNOT_NAMES, TopologicalState, is_knot_name, knot, parse_action
    from knotflow.topology.action_text import describe
    from knotflow.viz.notation import draw_action, draw_notation, draw_state

    if state != "trivial" and "(" not in what:
        raise ValueError("--state is for an action, as in: explain 'C(0,2,-1)' --state 3o1-2o4-")
    name = what if state == "trivial" else f"{what} after {state}"
    # Signs stay distinct in the name of the file.
    word = re.sub(r"[^A-Za-z0-9]+", "_", name.replace("+", "p").replace("-", "m")).strip("_")
    path = out if out is not None else Path(f"explain-{word or 'all'}.png")
    _check_picture(path)
    if out is not None:
        outputs.check_free(out)
        out.parent.mkdir(parents=True, exist_ok=True)
    if is_knot_name(what):
        from knotflow.viz.dag import draw_dag

        states = sorted(knot(what))
        draw_dag(planning.SolutionDag.to(states[-1]), [path])
        print(f"every path to {states[-1]}, one of {len(states)} states of {what}")
    elif not what:
        draw_notation(path)
    elif "(" in what:
        action, before = parse_action(what), TopologicalState.parse(state)
        print(describe(action, before))
        draw_action(action, before, path)
    elif what[0].isdigit() or what == "trivial":
        shown = TopologicalState.parse(what)
        draw_state(shown, path)
        print(f"{shown}: {shown.num_crossings} crossings, segments 0 to {shown.num_segments - 1}")
    else:
        raise ValueError(
            f"cannot explain {what!r}: give a knot ({', '.join(KNOT_NAMES)}), an action such as "
            "'C(0,2,-1)', or a state such as 4o1+2o5+6o3+"
        )
    print(path)


@app.command
def view(
    recording: Path, /, *, number: int | None = None, save: Path | None = None, web: bool = False
) -> int:
    """Show recorded rollouts in Rerun.

    Args:
        recording: An .mcap file, or a folder of them.
        number: Show only the rollout of this number.
        save: Write a Rerun file (.rrd) instead of opening a window.
        web: Serve web browsers until Ctrl-C instead of opening a window; prints the address.
    """
    from knotflow.viz.viewer import ViewerError, show

    if save is not None:
        outputs.check_free(save, "--save")
    try:
        show(recording, number, save, web)
    except ViewerError as error:
        print(f"knotflow: {error}", file=sys.stderr)
        return 1
    return 0


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
    """Export a plan as a trajectory for an arm.

    Args:
        plan: A plan's folder or its plan.json.
        arm: panda, ur5e, xarm7, or an MJCF or URDF file.
        base: YAML file with position (metres) and rpy_deg of the arm's base in the rope's frame.
        tip: Name of the site or link between the fingers, for a file.
        max_speed: Highest speed of the tip, metres per second.
        format: csv, or a ROS 2 trajectory_msgs message as YAML.
        space: Trajectory of the joints or of the tip.
        out: File to write; next to the plan by default.
    """
    from knotflow.execution import export_plan

    source = plan / "plan.json" if plan.is_dir() else plan
    suffix = "csv" if format == "csv" else "yaml"
    path = out if out is not None else source.with_name(f"{Path(arm).stem}-{space}.{suffix}")
    outputs.check_free(path)
    found = search.load_plan(source)
    exported = export_plan(found, arm, base, max_speed, format, space, tip=tip)
    with outputs.atomic(path) as temporary:
        temporary.write_text(exported.text, encoding="utf-8")
    print(f"{exported.summary()}\n{path}")
    if not found.solved:
        print(f"this is not a whole plan for {found.goal}: {found.reason}")
    return 0 if exported.reachable and found.solved else 1


@app.command
def studio(
    *,
    rope: Rope = "random",
    demonstrations: Path = Path("demonstrations.jsonl"),
    host: str = "localhost",
    port: Annotated[int, Parameter(validator=Number(gte=1, lte=65535))] = 8080,
) -> None:
    """Place ropes, plan, watch and demonstrate in the browser.

    Args:
        rope: Initial rope: straight, arc, random, or a file.
        demonstrations: File to which demonstrations are appended.
        host: Address to listen on; with 0.0.0.0 other machines need the token in the URL.
        port: Port of the page, or the next free one. Over ssh: ssh -L 8080:localhost:8080 MACHINE.
    """
    outputs.check_writable(demonstrations)
    try:
        from knotflow.apps.studio.page import Page
    except ModuleNotFoundError as error:
        raise ImportError(
            f"the studio needs {error.name}: pip install 'knotflow[studio]'"
        ) from error
    from knotflow.apps.studio.session import Session

    page = Page(Session(rope, demonstrations), host, port)
    print(f"{page.url} (Ctrl-C to stop)")
    try:
        page.serve()
    finally:
        page.close()


@app.command
def merge(files: list[Path], /, *, out: Path) -> None:
    """Merge demonstration files into one.

    Args:
        files: JSON lines files, as the studio writes them, without duplicates.
        out: File to write.
    """
    from knotflow.samplers.demonstrations import merge_demonstrations, save_demonstrations

    outputs.check_free(out)
    merged = merge_demonstrations(files)
    save_demonstrations(out, merged)
    people = sorted({one.who or one.source for one in merged})
    print(f"{out}: {len(merged)} demonstrations by {', '.join(people)}")


@app.command
def see(
    image: Path,
    depth: Path | None = None,
    /,
    *,
    camera: Path | None = None,
    depth_unit: str | None = None,
    out: Path | None = None,
    length: str | None = None,
    diameter: str | None = None,
    rope_color: str | None = None,
    head_color: str | None = None,
    max_seconds: Annotated[float, Parameter(validator=Number(gt=0))] = 60.0,
    overwrite: bool = False,
) -> int:
    """Estimate the rope in an RGB-D image, or in a photograph, and write a file for `--rope`.

    Args:
        image: Colour image.
        depth: Registered depth: 16-bit PNG or NPY.
        camera: YAML or JSON, also of OpenCV, ROS, RealSense and Open3D; its pose may be left out.
        depth_unit: mm, m, or a multiple such as 0.25mm; by default the camera file's or recognised.
        out: CSV file for the rope's points, head first; a picture of the estimate beside it.
        length: Length of the rope, such as 0.7m or 70cm; 1 m by default. Scales a photograph.
        diameter: Diameter of the rope, such as 6mm; a hundredth of its length by default.
        rope_color: Colour of the rope, red or #c08070; by default what differs from the table.
        head_color: Colour of the head's mark; by default (with depth) what differs from the rope.
        max_seconds: Time limit of a search with depth; it ends with the best estimate so far.
        overwrite: Replace existing files.
    """
    drawing = out and out.with_suffix(".png")
    for path in (out, drawing):
        if path:
            if overwrite:
                outputs.check_writable(path)
            else:
                outputs.check_free(path, "--out, or --overwrite it")
    if out is not None and out.suffix.lower() != ".csv":
        raise ValueError(f"--out {out}: the rope's file is a .csv, with a picture beside it")
    for given in (image, depth, camera):
        if given and given.resolve() in (one.resolve() for one in (out, drawing) if one):
            raise ValueError(f"--out {out} would replace {given}")
    colours = rope_color, head_color
    if depth is None:
        if depth_unit:
            raise ValueError(NO_DEPTH)
        if diameter:
            raise ValueError("--diameter is not for a photograph: it shows how thick the rope is")
        from knotflow.perception.photo import io as photo_io

        photo, rgb, xy = _see_photo(image, camera, length, colours, scaled=out is not None)
        if out is not None and drawing is not None and xy is not None:
            with outputs.atomic(out) as table, outputs.atomic(drawing) as picture:
                photo_io.write_photo_rope(table, xy, photo.over)
                photo_io.draw_photo(picture, rgb, photo)
            print(f"{out}, {drawing}")
        return 1 if photo.doubts else 0
    if camera is None or out is None or drawing is None:
        raise ValueError("with a depth image, see needs --camera FILE and --out FILE")

    from knotflow.perception import io  # slow to import
    from knotflow.planning.rope.size import RopeSize

    rope = RopeSize.of_options(RopeOptions(length=length, diameter=diameter)).rope()
    unit = _depth_unit(depth_unit)
    found, seen = io.see(image, depth, camera, rope, unit, colours, max_seconds)
    with outputs.atomic(out) as table, outputs.atomic(drawing) as picture:
        io.write_rope(table, found.points)
        io.draw_overlay(picture, seen.image, seen.camera, rope, found)
    print(f"{io.describe(found, seen)}\n{out}, {drawing}")
    return 1 if found.ambiguous else 0


@app.command
def report(*, results: Path = Path("results"), out: Path | None = None, check: bool = False) -> int:
    """Make the report from the results folder.

    Args:
        results: Folder with one folder per experiment.
        out: Folder for report.md and figures/; reports/X for results/X by default.
        check: Make nothing; list committed results and weights that today's code would not make.
    """
    if check:
        from knotflow.experiments.run import stale

        for one in (found := [*stale(results)]):
            print(f"stale  {one.where}: {', '.join(one.reasons)}")
        print(f"{len(found)} stale")
        return 1 if found else 0
    from knotflow.report import make

    page, *figures = make(results, out)
    print(f"{page} and {len(figures)} figures")
    return 0


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command and return its exit code."""
    try:
        return app(arguments, exit_on_error=False, result_action="return_value") or 0
    except CycloptsError:
        return 2  # cyclopts has reported it
    except (ValueError, OSError, ImportError) as error:
        if isinstance(error, FileNotFoundError) and error.filename:
            error = ValueError(f"{error.filename}: no such file or folder")
        print(f"knotflow: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130


def _check_picture(path: Path) -> None:
    if path.suffix not in (".png", ".svg", ".pdf"):
        raise ValueError(f"--out {path}: a picture is a .png, .svg or .pdf file")


def _see_photo(
    image: Path,
    camera: Path | None,
    length: str | None,
    colours: tuple[str | None, str | None],
    scaled: bool,
) -> tuple[PhotoEstimate, NDArray, NDArray | None]:
    """The rope in a photograph, the photograph (H, W, 3), and the centre line (N, 2), metres, if
    its scale is known; `scaled` refuses it without."""
    from knotflow.perception import Calibration  # slow to import
    from knotflow.perception.photo import io
    from knotflow.planning.rope.centre_line import LENGTH_TOLERANCE
    from knotflow.planning.rope.size import parse_length
    from knotflow.topology.polyline import arc_lengths

    metres = parse_length(length) if length else None
    if scaled and metres is None and camera is None:
        raise ValueError(f"{image}: {io.NO_SCALE}")
    calibration = Calibration.load(camera) if camera else None
    found, rgb = io.see_photo(image, calibration, colours)
    eye = None
    if calibration is not None and (calibration.poses or (scaled and metres is None)):
        fitted = calibration.scaled(rgb.shape[1], rgb.shape[0])
        eye = replace(fitted, distortion=fitted.distortion[:0]).camera()
    xy = io.on_table(found, metres, eye) if metres or eye else None
    seen = None if xy is None else float(arc_lengths(xy)[-1])
    if eye and metres and seen and abs(seen / metres - 1.0) > LENGTH_TOLERANCE:
        raise ValueError(
            f"{image}: by the camera's pose the rope is {seen:.3g} m long, not {metres:.3g} m: "
            "check --length, and the pose's unit and height above the table"
        )
    print(io.describe_photo(found, seen))
    return found, rgb, xy


def _depth_unit(text: str | None) -> float | None:
    """A unit in metres: mm, m, or a number of them."""
    from knotflow.planning.frame import METRES
    from knotflow.planning.rope.size import parse_metres

    return parse_metres(f"1{text}" if text in METRES else text, "--depth-unit") if text else None


def _margin(given: str | None, knot: str, rope: RopeConfig) -> float:
    """Least length of rope between crossings, metres: as given, or `MARGIN`, less of a short
    rope."""
    from knotflow.planning.rope.size import parse_metres

    if given is None:
        return MARGIN * min(rope.length, 1.0)
    margin = parse_metres(given, "--margin", zero=True)
    pieces = min(state.num_segments for state in planning.parse_goal(knot, rope).states)
    if margin > rope.length / pieces:
        raise ValueError(
            f"--margin {given}: the crossings of {knot} leave {pieces} pieces of rope, of "
            f"{rope.length:.3g} m at most {rope.length / pieces:.2g} m for each"
        )
    return margin


def _advise(found: planning.KnotPlan, another: str) -> None:
    """Say what to try if a plan is not solved, or less sure than sought."""
    sure = planning.SurvivalConfig().least
    if not found.solved:
        print(another)
    elif found.worlds and found.survived[-1] < sure * found.worlds:
        print(f"in fewer than the {100 * sure:g} % sought; {another}")


def _cure(max_seconds: float, margin: float, again: str = "") -> str:
    """What to try where a search did not find enough."""
    tighter = f"; tighter loops: --margin {margin / 2:g}" if margin else ""
    return f"longer: {again}--max-seconds {2 * max_seconds:g}{tighter}"


if __name__ == "__main__":
    sys.exit(main())
