"""Runs of gradient steps, of one learner or of several side by side."""

from __future__ import annotations

import os
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from threading import Event

from knotflow.threads import one_thread
from knotflow.training.learner import Learner


def fit(
    learner: Learner, steps: int, settling: bool = False, stop: Event | None = None
) -> dict[str, float]:
    """Make gradient steps; gives the mean losses, and what goes with them.

    Args:
        learner: what learns.
        steps: how many.
        settling: let the critic begin anew, and the learning rate fall evenly to 0.
        stop: once it is set, no further step is made.
    """
    means: dict[str, float] = {}
    if settling and steps:
        learner.restart_critic()
    for step in range(steps):
        if stop is not None and stop.is_set():
            break
        losses = learner.update(1 - step / steps if settling else 1.0, settling)
        for key, value in losses.items():
            means[key] = means.get(key, 0.0) + value / steps
    return means


def settles(done: int, every: int, rounds: int) -> bool:
    """Whether learners settle after the round number `done`, counted from 1: after every so many
    rounds, and after the last, but not shortly before it."""
    return done == rounds or (done % every == 0 and rounds - done >= every)


def fit_each(
    learners: Mapping[int, Learner],
    steps: int | Mapping[int, int],
    settling: bool = False,
    threads: int | None = None,
) -> dict[int, dict[str, float]]:
    """`fit` each of several learners, side by side; gives what it gives, by learner.

    PyTorch lets other Python threads run while it computes. Learners share neither weights nor
    random generators, so the number of threads changes nothing.

    Args:
        learners: those that learn.
        steps: how many steps each makes, or how many all make.
        settling: let the critics begin anew, and the learning rates fall evenly to 0.
        threads: learners at once; None takes a CPU each: more of them wait for Python's lock.
    """
    if not learners:
        return {}
    stop = Event()
    with one_thread(), ThreadPoolExecutor(threads or os.cpu_count()) as pool:
        running = {
            number: pool.submit(
                fit, learner, steps if isinstance(steps, int) else steps[number], settling, stop
            )
            for number, learner in learners.items()
        }
        try:
            return {number: future.result() for number, future in running.items()}
        except BaseException:
            stop.set()  # one failed, or the user interrupts: the others need not go to the end
            raise
