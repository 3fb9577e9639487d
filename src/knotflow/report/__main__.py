"""`python -m knotflow.report`: make reports/ again from results/ alone."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from knotflow.report import ResultsError, make


def main(arguments: list[str] | None = None) -> int:
    """Make the report; 1 and a message where a table is not what the report expects."""
    parser = argparse.ArgumentParser(prog="python -m knotflow.report", description=__doc__)
    parser.add_argument("--results", type=Path, default=Path("results"), help="default: results")
    parser.add_argument("--out", type=Path, help="default: reports/X for results/X")
    options = parser.parse_args(arguments)
    try:
        page, *figures = make(options.results, options.out)
    except ResultsError as problem:
        print(f"knotflow.report: {problem}", file=sys.stderr)
        return 1
    print(f"{page} and {len(figures)} figures")
    return 0


if __name__ == "__main__":
    sys.exit(main())
