"""What tests of several rooms share."""

import sys
from collections import Counter
from contextlib import contextmanager
from itertools import islice
from subprocess import CompletedProcess

import numpy as np
import pytest
from hydra.core.singleton import Singleton
from joblib.externals.loky import get_reusable_executor

from knotflow.__main__ import HOME, main
from knotflow.config import register
from knotflow.overrides import OverrideError, checked
from knotflow.simulation import RopeSimulator, SimulationConfig


def pytest_collection_modifyitems(items):
    """Files of slow tests first, so that the last ones spread evenly over the workers."""
    tests = Counter(item.path for item in items)
    slow = Counter(item.path for item in items if item.get_closest_marker("slow"))
    items.sort(key=lambda item: -slow[item.path] / tests[item.path])


@pytest.fixture(scope="session")
def simulator():
    """The default simulator; building it is slower than using it."""
    return RopeSimulator(SimulationConfig(threads=2))


@pytest.fixture(scope="session", autouse=True)
def no_worker_outlives_the_tests():
    """loky's idle workers live on for minutes, and the interpreter may wait for them at its end."""
    yield
    get_reusable_executor(reuse=True).shutdown(wait=True, kill_workers=True)


@pytest.fixture
def rng():
    return np.random.default_rng(7)


@pytest.fixture
def interrupted_training(monkeypatch):
    """A context manager in which trainings are interrupted after so many rounds, once the driver
    has had its time to save them."""
    from knotflow.training.trainer import Trainer

    @contextmanager
    def interrupted(rounds):
        whole = Trainer.__iter__

        def some(self):
            yield from islice(whole(self), rounds)
            raise KeyboardInterrupt

        with pytest.raises(KeyboardInterrupt), monkeypatch.context() as patch:
            patch.setattr(Trainer, "__iter__", some)
            yield

    return interrupted


@pytest.fixture
def two_threads():
    """PyTorch on two threads, so that it is seen who computes on one and puts the two back."""
    import torch

    before = torch.get_num_threads()
    torch.set_num_threads(2)
    yield
    torch.set_num_threads(before)


@pytest.fixture
def command(monkeypatch, capfd):
    """`python -m knotflow` with arguments, in this process, which has its imports behind it."""

    def run(*arguments, results):
        hydra = Singleton.get_state()
        monkeypatch.setenv("KNOTFLOW_HOME", str(HOME))
        register()
        capfd.readouterr()
        code, why = 0, ""
        try:
            asked = checked([*map(str, arguments), f"results_dir={results}"], HOME)
            monkeypatch.setattr(sys, "argv", ["knotflow", *asked])
            main()
        except SystemExit as end:
            code, why = (end.code, "") if isinstance(end.code, int) else (1, str(end.code))
        except OverrideError as error:
            code, why = 1, f"error: {error}"
        finally:
            Singleton.set_state(hydra)
        out, err = capfd.readouterr()
        return CompletedProcess(arguments, code, out, err + why)

    return run
