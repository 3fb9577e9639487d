"""Progress in a log file: lines, few of them, with the rate."""

from __future__ import annotations

import io

from knotflow.workflow.progress import progress


def test_lines_without_a_terminal() -> None:
    stream = io.StringIO()
    assert list(progress(range(3), desc="rollouts", stream=stream, every=0.0)) == [0, 1, 2]
    lines = stream.getvalue().splitlines()
    assert "\r" not in stream.getvalue()
    assert lines[0].startswith("rollouts: 0/3 [")
    assert lines[-1].startswith("rollouts: 3/3 [")
    assert lines[-1].endswith("it/s]")
    assert all(lines)


def test_few_lines_for_many_steps() -> None:
    stream = io.StringIO()
    for _ in progress(range(10_000), stream=stream):
        pass
    assert len(stream.getvalue().splitlines()) == 2  # the first and the last


def test_update_by_hand_from_where_it_stopped() -> None:
    stream = io.StringIO()
    with progress(total=100, initial=60, stream=stream, every=0.0) as bar:
        bar.update(40)
    assert "60/100" in stream.getvalue().splitlines()[0]
    assert "100/100" in stream.getvalue().splitlines()[-1]


def test_unknown_total() -> None:
    stream = io.StringIO()
    list(progress(iter("ab"), stream=stream, every=0.0))
    assert "2/?" in stream.getvalue()


def test_nested_bars_move_no_cursor() -> None:
    stream = io.StringIO()
    for _ in progress(range(2), desc="outer", stream=stream, every=0.0):
        list(progress(range(2), desc="inner", stream=stream, every=0.0))
    assert "\x1b" not in stream.getvalue()
    assert "\n\n" not in stream.getvalue()


class Terminal(io.StringIO):
    """A stream that says it is one."""

    def isatty(self) -> bool:
        """It is."""
        return True


def test_a_bar_on_a_terminal() -> None:
    stream = Terminal()
    list(progress(range(3), stream=stream))
    assert "\r" in stream.getvalue()
