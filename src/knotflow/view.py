"""``python -m knotflow.view RECORDING``: look at recorded rollouts in Rerun."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from knotflow.viz.viewer import (
    ViewerError,
    find_recording,
    open_recording,
    save_rerun,
    serve_recording,
)

PICTURE_SETTLE_S = 6.0  # Rerun's greeting notices are gone from the screenshot after that


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; 0 when all went well, 1 when the recording could not be shown."""
    options = _parser().parse_args(arguments)
    try:
        return show(
            options.recording, options.number, options.save, options.headless_check, options.web
        )
    except (OSError, ValueError, ViewerError) as error:
        print(f"knotflow.view: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 130  # the usual way to close what was opened from a terminal


def show(
    recording: Path,
    number: int | None = None,
    save: Path | None = None,
    headless_check: str | None = None,
    web: bool = False,
) -> int:
    """Show a recording; the arguments are the command's. 1 when Rerun complains about it, else 0.

    Raises:
        OSError, ValueError: no such recording, or a damaged one.
        ViewerError: no viewer can be opened.
    """
    source = find_recording(recording, number)
    _say_which(recording, source)
    if save is not None:
        print(f"saved {save_rerun(source, save, number=number)}")
    if headless_check is not None:
        return _check(source, number, headless_check)
    if web:
        serve_recording(source, number=number)
    elif save is None:
        open_recording(source, number=number)
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m knotflow.view", description="Show recorded rollouts in the Rerun viewer."
    )
    parser.add_argument(
        "recording", type=Path, metavar="RECORDING", help="an .mcap file or a folder of them"
    )
    parser.add_argument("--number", type=int, help="show only the rollout of this number")
    parser.add_argument(
        "--save", type=Path, metavar="OUT.rrd", help="write a Rerun file instead of opening it"
    )
    parser.add_argument(
        "--web", action="store_true", help="serve it to web browsers instead of opening a window"
    )
    parser.add_argument(
        "--headless-check",
        nargs="?",
        const="",
        metavar="OUT.png",
        help="open it without a window, report what Rerun complains about, keep a screenshot",
    )
    return parser


def _say_which(asked: Path, source: Path) -> None:
    others = sorted(file.name for file in asked.glob("*.mcap")) if asked.is_dir() else []
    if len(others) > 1:
        print(f"showing {source.name} of {len(others)} recordings: {', '.join(others)}")


def _check(source: Path, number: int | None, picture: str) -> int:
    from knotflow.viz.headless import check_recording, why_not_headless

    if missing := why_not_headless():
        raise ViewerError(f"no headless viewer can run here: {missing}")
    report = check_recording(source, number=number, settle_s=PICTURE_SETTLE_S if picture else 0.0)
    if picture:
        Path(picture).write_bytes(report.screenshot)
    for problem in report.problems:
        print(problem, file=sys.stderr)
    print(f"{source}: {len(report.problems)} problems; shows {', '.join(report.entities)}")
    return 1 if report.problems else 0


if __name__ == "__main__":
    sys.exit(main())
