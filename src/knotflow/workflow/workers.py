"""Shards on worker processes, through joblib: the cores of one machine, or a Ray cluster.

A stage whose shards do not depend on each other hands them to `StageContext.each`. How many run at
once, and where, cannot change what they make, so it is no part of any signature.
"""

from __future__ import annotations

import logging
import os
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from .errors import WorkflowError

BACKENDS = ("loky", "ray")
# joblib's threading is not among them: threads share PyTorch's random state, so shards that run
# side by side would not make what they make one after the other.


@dataclass
class WorkersConfig:
    """Where shards run."""

    backend: str = "loky"
    """joblib's: loky (processes of this machine) or ray (a cluster; `ray.init` finds it by the
    variable RAY_ADDRESS, and starts one on this machine where there is none). The machines of a
    cluster need the results folder in common, under the same path, and knotflow installed."""
    jobs: int = -1
    """Shards at once; -1 takes every core, or every CPU of the cluster. 1 runs one after the other
    in the process itself, whose simulator then has all cores."""

    def __post_init__(self) -> None:
        """Refuse what runs nothing.

        Raises:
            ValueError: an unknown backend, or no job at all.
        """
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

    On Ray it yields for all of them at the end: joblib's Ray backend reports no earlier.

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
    if config.jobs == 1 or len(shards) <= 1:
        for shard in shards:
            work(shard)
            yield
        return
    how, parent = "generator_unordered", os.getpid()
    watched: int | None = parent
    if config.backend == "ray":
        _start_ray()
        how, watched = "list", None  # Ray itself ends the workers of a driver that is gone
    jobs = min(config.jobs, len(shards)) if config.jobs > 0 else config.jobs
    import joblib

    with joblib.parallel_config(backend=config.backend, n_jobs=jobs), _meanwhile(meanwhile):
        parallel = joblib.Parallel(return_as=how, batch_size=1, pre_dispatch="all")
        for _ in parallel(joblib.delayed(_work)(work, shard, watched) for shard in shards):
            yield


def _work(work: Callable[[Any], None], shard: Any, parent: int | None = None) -> None:
    """In the worker: it ends with the process `parent` that started it, even one that was killed.

    Else it would finish its shard and go on with those in its queue, beside the workers of the
    same command called again.
    """
    if parent in (None, os.getpid()):  # a worker that others look after; or none, on one core
        work(shard)
        return
    done = threading.Event()

    def watch() -> None:
        while os.getppid() == parent:
            if done.wait(1.0):
                return
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
    try:
        work(shard)
    finally:
        done.set()


@contextmanager
def _meanwhile(call: Callable[[], None] | None) -> Iterator[None]:
    """Calls every two seconds, from a thread, while the block runs.

    Raises:
        Exception: what the call raised, after a block that ended well.
    """
    over, failures = threading.Event(), []

    def repeat() -> None:
        try:
            while call is not None and not over.wait(2.0):
                call()
        except Exception as error:  # raised below: a thread has no caller
            failures.append(error)

    thread = threading.Thread(target=repeat, daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()
    if failures:
        raise failures[0]


def _start_ray() -> None:
    try:
        import ray
        from ray.util.joblib import register_ray
    except ImportError:
        raise WorkflowError(
            "workers.backend=ray needs Ray, which is not installed: pip install 'knotflow[ray]'"
        ) from None
    if not ray.is_initialized():
        ray.init(logging_level=logging.WARNING)
    register_ray()
