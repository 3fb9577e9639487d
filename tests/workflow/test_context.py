"""What a stage can do with its folder."""

from __future__ import annotations

import pickle
from pathlib import Path

import pandas as pd
import pytest

from knotflow.workflow import StageContext


def test_pending_are_those_without_a_file(tmp_path: Path) -> None:
    context = StageContext(tmp_path)
    assert context.pending(["a", "b"], ".npz") == ["a", "b"]
    with context.atomic("b.npz") as path:
        path.write_bytes(b"x")
    assert context.pending(["a", "b"], ".npz") == ["a"]
    assert context.pending(["a", "b"], ".mcap") == ["a", "b"]


def test_half_written_shard_stays_pending(tmp_path: Path) -> None:
    context = StageContext(tmp_path)
    with pytest.raises(KeyboardInterrupt), context.atomic("a.npz") as path:
        path.write_bytes(b"half")
        raise KeyboardInterrupt
    assert context.pending(["a"], ".npz") == ["a"]


def test_doubled_names_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"more than once: \['b'\]"):
        StageContext(tmp_path).pending(["b", "a", "b"])


@pytest.mark.parametrize("path", ["../x", "/x", "a/../../x"])
def test_writes_into_its_own_folder_only(tmp_path: Path, path: str) -> None:
    with pytest.raises(ValueError, match="own folder"), StageContext(tmp_path).atomic(path):
        pytest.fail("no path must be given")


def test_saving_is_told(tmp_path: Path) -> None:
    told: list[bool] = []
    context = StageContext(tmp_path, after_save=lambda: told.append((tmp_path / "a").exists()))
    with context.atomic("a") as path:
        path.write_text("a")
    assert told == [True]


def test_goes_to_worker_processes(tmp_path: Path) -> None:
    context = StageContext(tmp_path, "abc", {"demos": "123"}, after_save=lambda: None)
    context.logger.log_scalar("loss", 1.0, 0)
    copy = pickle.loads(pickle.dumps(context))
    assert copy.inputs_signatures == {"demos": "123"}
    with copy.atomic("deep/er/a") as path:
        path.write_text("a")
    assert context.pending(["deep/er/a", "deep/b"]) == ["deep/b"]


def test_logger_opens_once_and_closes(tmp_path: Path) -> None:
    context = StageContext(tmp_path, metrics="none")
    first = context.logger
    assert context.logger is first
    context.close()
    assert context.logger is not first


def test_shards_that_could_run_side_by_side_are_counted_the_finished_ones_too(tmp_path):
    context = StageContext(tmp_path)
    (tmp_path / "a.txt").touch()
    context.each(_nothing, context.pending(["a", "b", "c"], ".txt"), "three")
    assert context.shards == 3
    context.each(_nothing, range(5), "five more")
    assert context.shards == 8


def _nothing(context, shard):
    pass


def test_a_table_goes_on_after_the_rows_that_are_kept(tmp_path: Path) -> None:
    made: list[str] = []

    def rows(_context: StageContext, name: str) -> pd.DataFrame:
        made.append(name)
        if name == "c" and made.count("c") == 1:
            raise KeyboardInterrupt
        return pd.DataFrame({"name": [name] * 2, "share": [0.5, None], "note": ["", "NA"]})

    context = StageContext(tmp_path)
    with pytest.raises(KeyboardInterrupt):
        context.table("all.csv", rows, ["b", "a", "c"], "rows")
    assert not (tmp_path / "all.csv").exists()
    context.table("all.csv", rows, ["b", "a", "c"], "rows")
    assert made == ["b", "a", "c", "c"] and context.shards == 6
    text = "name,share,note\n" + "".join(f"{one},0.5,\n{one},,NA\n" for one in "bac")
    assert (tmp_path / "all.csv").read_text("utf-8") == text
