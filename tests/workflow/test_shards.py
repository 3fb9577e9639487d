import os
import time

import pandas as pd
import pytest

from knotflow.workflow import StageRun, WorkersConfig


def rows(name):
    """A row a shard, in a process of its own."""
    return pd.DataFrame([{"name": name, "square": int(name) ** 2, "pid": os.getpid()}])


def fail(name):
    """Fails on one of the shards."""
    if name == "1":
        raise ValueError("shard 1")


@pytest.mark.parametrize("jobs", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_a_table_has_the_rows_of_all_shards_in_order(tmp_path, jobs):
    run = StageRun(tmp_path, workers=WorkersConfig(jobs=jobs))
    run.table("squares.csv", rows, ["3", "1", "2"], "squares")
    table = pd.read_csv(tmp_path / "squares.csv")
    assert table["square"].tolist() == [9, 1, 4]
    assert (table["pid"] == os.getpid()).all() == (jobs == 1)
    assert run.pending(["rows/3", "rows/4"], ".csv") == ["rows/4"]


@pytest.mark.parametrize("jobs", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_the_first_failure_is_raised(tmp_path, jobs):
    run = StageRun(tmp_path, workers=WorkersConfig(jobs=jobs))
    with pytest.raises(ValueError, match="shard 1"):
        run.each(fail, ["0", "1", "2"], "failing")


@pytest.mark.slow
def test_shards_run_on_ray(tmp_path):
    ray = pytest.importorskip("ray")
    run = StageRun(tmp_path, workers=WorkersConfig("ray", 2))

    def slow(name):
        (run.out / f"{name}.pid").write_text(str(os.getpid()))
        time.sleep(0.05)

    try:
        run.each(slow, ["a", "b"], "on Ray")
    finally:
        ray.shutdown()
    assert {path.name for path in tmp_path.glob("*.pid")} == {"a.pid", "b.pid"}


def test_names_that_occur_twice_are_refused(tmp_path):
    with pytest.raises(ValueError, match="more than once: \\['a'\\]"):
        StageRun(tmp_path).pending(["a", "b", "a"])


def test_a_stage_writes_into_its_own_folder_only(tmp_path):
    with pytest.raises(ValueError, match="own folder"), StageRun(tmp_path / "a").atomic("../b"):
        pass


@pytest.mark.parametrize(
    ("values", "message"), [({"backend": "dask"}, "loky or ray"), ({"jobs": 0}, "not 0")]
)
def test_workers_that_run_nothing_are_refused(values, message):
    with pytest.raises(ValueError, match=message):
        WorkersConfig(**values)


def test_seconds_add_up_over_attempts(tmp_path):
    first = StageRun(tmp_path)
    time.sleep(0.02)
    first.save_seconds()
    second = StageRun(tmp_path)
    second.load_seconds()
    assert second.seconds() > 0.02


def test_a_table_of_nothing_is_refused(tmp_path):
    with pytest.raises(ValueError, match="rows.csv would have no rows"):
        StageRun(tmp_path).table("rows.csv", lambda name: None, [], "rows")
