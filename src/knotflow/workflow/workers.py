"""Shards on worker processes, through joblib: the cores of one machine, or a Ray cluster.

A stage whose shards do not depend on each other hands them to `StageContext.each`. How many run at
once, and where, cannot change what they make, so it is no part of any signature.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import joblib

from .errors import WorkflowError

BACKENDS = ("loky", "ray", "threading")


@dataclass
class WorkersConfig:
    """Where shards run."""

    backend: str = "loky"
    """joblib's: loky (processes of this machine) or ray (a cluster; `ray.init` finds it by the
    variable RAY_ADDRESS, and starts one on this machine where there is none)."""
    jobs: int = -1
    """Shards at once; -1 takes every core, or every CPU of the cluster. 1 runs one after the other
    in the process itself, whose simulator then has all cores."""

    def __post_init__(self) -> None:
        if self.backend not in BACKENDS:
            raise ValueError(
                f"unknown workers.backend {self.backend!r}; there are {', '.join(BACKENDS)}"
            )
        if self.jobs == 0:
            raise ValueError("workers.jobs is a number of shards at once, or -1, but not 0")


def each(
    work: Callable[[Any], None],
    shards: Sequence[Any],
    config: WorkersConfig,
    meanwhile: Callable[[], None] | None = None,
) -> Iterator[None]:
    """Runs `work(shard)` for every shard; yields once for each that is finished.

    Args:
        work: can be pickled, unless everything runs in this process. It leaves what it makes in
            files, see `StageContext.atomic`.
        shards: what it is called with.
        config: where it runs.
        meanwhile: called every few seconds.

    Raises:
        WorkflowError: the backend is not installed.
        Exception: the first that a shard raised; the others that run are given up.
    """
    if config.jobs == 1 or len(shards) == 1:
        for shard in shards:
            work(shard)
            yield
        return
    if config.backend == "ray":
        _register_ray()
    jobs = min(config.jobs, len(shards)) if config.jobs > 0 else config.jobs
    with joblib.parallel_config(backend=config.backend, n_jobs=jobs), _meanwhile(meanwhile):
        parallel = joblib.Parallel(
            return_as="generator_unordered", batch_size=1, pre_dispatch="all"
        )
        for _ in parallel(joblib.delayed(_work)(work, shard) for shard in shards):
            yield


def _work(work: Callable[[Any], None], shard: Any) -> None:
    """In the worker: it ends with the process that started it, even one that was killed."""
    parent, done = os.getppid(), threading.Event()

    def watch() -> None:
        while not done.wait(1.0):
            if os.getppid() != parent:
                os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
    try:
        work(shard)
    finally:
        done.set()


@contextmanager
def _meanwhile(call: Callable[[], None] | None) -> Iterator[None]:
    """Calls every two seconds, from a thread, while the block runs."""
    over = threading.Event()

    def repeat() -> None:
        while call is not None and not over.wait(2.0):
            call()

    thread = threading.Thread(target=repeat, daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


def _register_ray() -> None:
    try:
        from ray.util.joblib import register_ray
    except ImportError:
        raise WorkflowError(
            "workers.backend=ray needs Ray, which is not installed: pip install 'knotflow[ray]'"
        ) from None
    register_ray()
