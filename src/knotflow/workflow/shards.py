"""What a stage is given: its folder, and shards of its work on worker processes, through joblib.

How many shards run at once, and where, cannot change what they make, so it is part of no key.
"""

from __future__ import annotations

import logging
import os
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tqdm import tqdm

from knotflow.threads import one_thread
from knotflow.workflow import store

if TYPE_CHECKING:
    import pandas as pd

BACKENDS = ("loky", "ray")
"""joblib's threads are not among them: they share PyTorch's random state."""
LINE_EVERY = 10.0  # seconds between two lines of progress where there is no terminal


@dataclass
class WorkersConfig:
    """Where shards run."""

    backend: str = "loky"
    """loky (processes of this machine) or ray (a cluster, found by RAY_ADDRESS, else this machine).
    The machines of a cluster need the results folder in common, under the same path."""
    jobs: int = -1
    """Shards at once; -1 takes every CPU. 1 runs one after the other in the process itself, whose
    simulator then has all cores."""

    def __post_init__(self) -> None:
        if self.backend not in BACKENDS:
            raise ValueError(f"workers.backend is {self.backend!r}, not {' or '.join(BACKENDS)}")
        if self.jobs == 0:
            raise ValueError("workers.jobs is a number of shards at once, or -1, but not 0")


@dataclass
class StageRun:
    """A stage's folder and its ways to write there so that a kill never costs finished work.

    `StageRun(folder)` is enough to call a stage by hand, for example in a test.
    """

    out: Path
    """Working folder; it is renamed when the stage is complete, so keep no path into it."""
    key: str = ""
    """Of the output that is being made."""
    workers: WorkersConfig = field(default_factory=lambda: WorkersConfig(jobs=1))
    """Where shards run; by default here, one after the other."""
    _began: float = field(default_factory=time.monotonic)
    _before: float = 0.0

    def alone(self) -> StageRun:
        """The same with shards one after the other, for work that uses all cores by itself."""
        return replace(self, workers=WorkersConfig(jobs=1))

    def progress(
        self, iterable: Iterable[Any] | None = None, *, total: int | None = None,
        desc: str = "", initial: int = 0,
    ) -> Any:  # fmt: skip
        """A bar on a terminal, else a line every ten seconds at most."""
        how: dict[str, Any] = {"total": total, "desc": desc, "initial": initial}
        if not sys.stderr.isatty():
            how |= {"mininterval": LINE_EVERY, "maxinterval": LINE_EVERY}
            how |= {"ascii": True, "ncols": 80, "position": 0}
        return tqdm(iterable, **how)

    def pending(self, names: Sequence[str], suffix: str = "") -> list[str]:
        """Those of `names` without a file `out/name+suffix`; sound for files of `atomic` alone.

        Raises:
            ValueError: a name occurs twice, so one shard would overwrite another.
        """
        if doubled := sorted(name for name, count in Counter(names).items() if count > 1):
            raise ValueError(f"shard names must differ; these occur more than once: {doubled}")
        return [name for name in names if not (self.out / f"{name}{suffix}").exists()]

    def each(self, work: Callable[[Any], Any], shards: Sequence[Any], desc: str) -> None:
        """Run `work(shard)` for every shard, on the workers; `work` may be a nested function."""
        with self.progress(total=len(shards), desc=desc) as bar:
            for _ in _side_by_side(work, shards, self.workers):
                bar.update()
                self.save_seconds()

    def table(
        self, file: str, work: Callable[[str], pd.DataFrame], names: Sequence[str], desc: str
    ) -> None:
        """Make a table of the rows that `work(name)` returns for every name, each a shard.

        Until the stage is finished, rows are kept in rows/NAME.csv as soon as they are made; they
        join the table as they are written there.

        Raises:
            ValueError: a name occurs twice, or there is none.
        """
        import pandas as pd  # takes half a second

        if not names:
            raise ValueError(f"{file} would have no rows: the counts ask for nothing")

        def make(part: str) -> None:
            self.save_table(f"{part}.csv", work(part.removeprefix(f"{store.ROWS}/")))

        parts = [f"{store.ROWS}/{name}" for name in names]
        self.each(make, self.pending(parts, ".csv"), desc)
        files = [self.out / f"{part}.csv" for part in parts]
        rows = [pd.read_csv(path, dtype=str, keep_default_na=False) for path in files]
        self.save_table(file, pd.concat(rows))

    def save_table(self, file: str, table: pd.DataFrame, float_format: str | None = None) -> None:
        """Write a table without its index."""
        with self.atomic(file) as path:
            table.to_csv(path, index=False, float_format=float_format)

    @contextmanager
    def atomic(self, path: str | Path) -> Iterator[Path]:
        """A temporary path to write to; it becomes `out/path`, whole, when the block ends well.

        Raises:
            ValueError: `path` is outside of `out`.
        """
        target = self.out / path
        if not target.resolve().is_relative_to(self.out.resolve()):
            raise ValueError(f"a stage writes into its own folder {self.out} only, not to {target}")
        with store.atomic(target) as temporary:
            yield temporary

    def seconds(self) -> float:
        """Wall time of this attempt and of earlier ones, as far as those noted it."""
        return self._before + time.monotonic() - self._began

    def save_seconds(self) -> None:
        """Note the time so far, for an attempt that goes on after this one."""
        with self.atomic(store.CLOCK) as path:
            path.write_text(f"{self.seconds():.3f}", "utf-8")

    def load_seconds(self) -> None:
        """Go on from the time that earlier attempts noted."""
        file = self.out / store.CLOCK
        self._before = float(file.read_text("utf-8")) if file.is_file() else 0.0


def _side_by_side(
    work: Callable[[Any], Any], shards: Sequence[Any], config: WorkersConfig
) -> Iterator[None]:
    """Run `work(shard)` for every shard; yields for each that is finished, on Ray for all at the
    end. The first exception gives up the others."""
    if config.jobs == 1 or len(shards) <= 1:
        for shard in shards:
            _call(work, shard, 0)
            yield
        return
    how, watched = "generator_unordered", os.getpid()
    if config.backend == "ray":
        _start_ray()
        how, watched = "list", 0  # Ray ends the workers of a driver that is gone
    jobs = min(config.jobs, len(shards)) if config.jobs > 0 else config.jobs
    import joblib

    with joblib.parallel_config(backend=config.backend, n_jobs=jobs):
        parallel = joblib.Parallel(return_as=how, batch_size=1, pre_dispatch="all")
        for _ in parallel(joblib.delayed(_call)(work, shard, watched) for shard in shards):
            yield


def _call(work: Callable[[Any], Any], shard: Any, parent: int) -> None:
    """Run a shard on one thread; a worker ends with the process `parent` that started it, even a
    killed one, else it would go on beside the workers of the same command called again."""
    done = threading.Event()

    def watch() -> None:
        while os.getppid() == parent:
            if done.wait(1.0):
                return
        os._exit(1)

    if parent not in (0, os.getpid()):
        threading.Thread(target=watch, daemon=True).start()
    try:
        with one_thread():
            work(shard)
    finally:
        done.set()


def _start_ray() -> None:
    try:
        import ray
        from ray.util.joblib import register_ray
    except ImportError:
        raise ModuleNotFoundError(
            "workers.backend=ray needs Ray: pip install 'knotflow[ray]'"
        ) from None
    if not ray.is_initialized():
        ray.init(logging_level=logging.WARNING)
    register_ray()
