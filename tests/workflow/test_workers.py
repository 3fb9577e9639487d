"""Shards on workers: wherever they are made they are the same, and none outlives the command."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from knotflow.samplers.demonstrations import load_demonstrations, save_demonstrations
from knotflow.workflow import StageContext, WorkersConfig, WorkflowError
from knotflow.workflow.stages.demonstrations import DemonstrationsConfig, simulate_demonstrations
from knotflow.workflow.workers import each

pytestmark = pytest.mark.slow

PATIENCE = 240.0  # seconds until something is taken for not happening at all


@pytest.fixture(scope="module")
def ray() -> Iterator[None]:
    """A Ray cluster of two CPUs on this machine, whatever it has."""
    ray = pytest.importorskip("ray")
    ray.init(num_cpus=2, include_dashboard=False, log_to_driver=False, logging_level="ERROR")
    yield
    ray.shutdown()


@pytest.fixture(params=["loky", "ray"])
def workers(request: pytest.FixtureRequest) -> WorkersConfig:
    """Two of each kind."""
    if request.param == "ray":
        request.getfixturevalue("ray")
    return WorkersConfig(request.param, 2)


@pytest.fixture(scope="module")
def few(tmp_path_factory: pytest.TempPathFactory) -> DemonstrationsConfig:
    """A bulk stage of three shards, in small."""
    path = tmp_path_factory.mktemp("few") / "few.jsonl"
    save_demonstrations(path, load_demonstrations()[:3])
    return DemonstrationsConfig(copies=3, copies_untangled=3, seed=2, file=str(path))


def simulated(config: DemonstrationsConfig, folder: Path, workers: WorkersConfig) -> dict:
    """Every file of the stage's output, simulated on these workers; index times its folder."""
    folder.mkdir()
    simulate_demonstrations(config, {}, StageContext(folder, "0123456789abcdef", workers=workers))
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file() and path.suffix != ".parquet"  # which holds modification times
    }


@pytest.fixture(scope="module")
def in_process(few: DemonstrationsConfig, tmp_path_factory: pytest.TempPathFactory) -> dict:
    """What the stage makes without workers."""
    made = simulated(few, tmp_path_factory.mktemp("one") / "out", WorkersConfig(jobs=1))
    assert len(made) == 3 + 3 + 1  # recordings, trials and their table
    return made


def test_a_stage_makes_the_same_on_any_workers(
    few: DemonstrationsConfig, in_process: dict, workers: WorkersConfig, tmp_path: Path
) -> None:
    assert simulated(few, tmp_path / "out", workers) == in_process


def test_every_shard_is_told_of_once(workers: WorkersConfig, tmp_path: Path) -> None:
    folders = [tmp_path / name for name in "abcde"]
    assert len(list(each(os.mkdir, folders, workers))) == 5
    assert sorted(tmp_path.iterdir()) == folders
    assert list(each(os.mkdir, [], workers)) == []


def test_a_shards_failure_reaches_the_caller_and_the_next_call_is_whole(
    workers: WorkersConfig,
) -> None:
    with pytest.raises(ValueError, match="'no number'"):
        list(each(int, ["1", "no number", "3"], workers))
    assert len(list(each(int, ["1", "2", "3"], workers))) == 3


def test_what_happens_meanwhile_may_fail_too(monkeypatch: pytest.MonkeyPatch) -> None:
    def full() -> None:
        raise OSError(28, "No space left on device")

    with pytest.raises(OSError, match="No space left"):
        list(each(time.sleep, [1.5, 1.5, 1.5], WorkersConfig("loky", 2), full))


def test_an_unknown_backend_names_those_there_are() -> None:
    with pytest.raises(ValueError, match=r"'dask'; there are loky, ray"):
        WorkersConfig("dask")
    with pytest.raises(ValueError, match="not 0"):
        WorkersConfig(jobs=0)


def test_without_ray_it_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "ray", None)  # as if it were not installed
    with pytest.raises(WorkflowError, match=r"pip install 'knotflow\[ray\]'"):
        list(each(int, ["1", "2"], WorkersConfig("ray", 2)))


def test_the_workers_of_a_killed_process_end(tmp_path: Path) -> None:
    source = str(Path(__file__).parents[2] / "src")
    process = subprocess.Popen(
        [sys.executable, str(Path(__file__).with_name("killable_workers.py")), str(tmp_path)],
        env=os.environ | {"PYTHONPATH": source},
    )
    wait_until(lambda: len(list(tmp_path.iterdir())) == 2)
    process.send_signal(signal.SIGKILL)
    process.wait()
    ids = [int(path.name) for path in tmp_path.iterdir()]
    wait_until(lambda: not any(map(is_running, ids)))
    assert len(list(tmp_path.iterdir())) == 2  # and began no other shard


def wait_until(happens) -> None:
    """Waits; fails if it does not happen at all."""
    end = time.monotonic() + PATIENCE
    while not happens():
        assert time.monotonic() < end
        time.sleep(0.05)


def is_running(process: int) -> bool:
    """Whether there is such a process that has not ended (one nobody has asked about is a Z)."""
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False
