"""One contract for every registered sampler, and what a wrong configuration is told."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from knotflow.samplers.demonstrations import (
    TASKS,
    NoiseConfig,
    load_demonstrations,
    load_trials,
    noisy_copies,
)
from knotflow.samplers.primitives import (
    FILE,
    PRIMITIVES,
    CemConfig,
    NetworkConfig,
    PrimitiveConfig,
    PrimitiveLibrary,
    primitive_of,
)
from knotflow.samplers.sampler import (
    MODULES,
    SamplerConfig,
    build_sampler,
    capability,
    has_capability,
    sampler,
)
from knotflow.simulation import SPLINE_HIGH, SPLINE_LOW, RopeConfig, Trials, check_splines
from knotflow.training import Imitation, ImitationConfig, LearnerConfig

registry = sys.modules["knotflow.samplers.sampler"]
SMALL = PrimitiveConfig(
    network=NetworkConfig(lstm=8, attention=4, stream=8, feature=8, head=8),
    cem=CemConfig(population=16, critic_only_population=16, elites=4, iterations=2),
)


@pytest.fixture(scope="module")
def inputs(tmp_path_factory):
    """Outputs of a small `demonstrations` stage, its outcomes made up, and of `imitation` of it."""
    folder = tmp_path_factory.mktemp("demonstrations")
    (folder / "trials").mkdir()
    rng = np.random.default_rng(0)
    for number, one in enumerate(load_demonstrations()):
        splines = noisy_copies(one.spline, 12, rng, NoiseConfig())
        points, success = np.stack([one.points] * 12), rng.random(12) < 0.6
        trials = Trials(one.task.action, one.task.start_state, points, splines, success)
        trials.save(folder / "trials" / f"{number}.npz")
    library = tmp_path_factory.mktemp("imitation")
    imitated(load_trials(folder)).save(library / FILE)
    return {"demonstrations": folder, "primitives": library}


def imitated(trials):
    """A library of four small primitives after a few steps of imitation."""
    learner = LearnerConfig(demonstration_ropes=2, demonstration_trials=4)
    effort = ImitationConfig(learner, steps=2, validations=1)
    primitives, trained_on = {}, {}
    for number in PRIMITIVES:
        tasks = [t for t in TASKS if primitive_of(t.action, t.start_state.num_segments) == number]
        trained_on[number] = [task.action for task in tasks]
        training = Imitation(
            [trials[action] for action in trained_on[number]], SMALL, effort, number
        )
        assert len(list(training)) == 1
        primitives[number] = training.primitive
    return PrimitiveLibrary(primitives, trained_on, RopeConfig())


@pytest.fixture(scope="module")
def starts():
    return {one.task: one.points for one in load_demonstrations()}


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(MODULES))
@pytest.mark.parametrize("task", TASKS, ids=lambda task: task.name)
def test_sampler_contract(name, task, inputs, starts):
    built = build_sampler(SamplerConfig(name), inputs)
    points = starts[task]
    before = points.copy()
    for count in (0, 1, 7):
        splines = built.sample(points, task.action, count, np.random.default_rng(1))
        assert splines.shape == (count, 6)
        check_splines(splines)
        again = built.sample(points, task.action, count, np.random.default_rng(1))
        assert np.array_equal(splines, again)  # everything random comes from the generator
    assert len(np.unique(splines, axis=0)) == 7
    assert np.array_equal(points, before)


def test_random_sampler_is_uniform_over_the_range(starts):
    splines = build_sampler(SamplerConfig("random"), {}).sample(
        starts[TASKS[0]], TASKS[0].action, 4000, np.random.default_rng(0)
    )
    for q in (0.0, 0.25, 0.5, 0.75, 1.0):
        expected = SPLINE_LOW + q * (SPLINE_HIGH - SPLINE_LOW)
        np.testing.assert_allclose(np.quantile(splines, q, axis=0), expected, atol=0.04)


def test_unknown_names_and_settings_are_answered_with_the_valid_ones():
    for lookup in (SamplerConfig.modules, lambda config: build_sampler(config, {})):
        with pytest.raises(ValueError, match="unknown sampler 'best'; valid are .*icp.*random"):
            lookup(SamplerConfig("best"))
    with pytest.raises(ValueError, match="'icp'.*scale"):
        build_sampler(SamplerConfig("icp", {"length": 1}), {"demonstrations": Path()})


def test_a_module_that_does_not_register_its_name_is_named(monkeypatch):
    monkeypatch.setitem(MODULES, "mine", MODULES["random"])
    with pytest.raises(ValueError, match=r"knotflow.samplers.random registers no @sampler\('mine'"):
        SamplerConfig("mine").inputs()


def test_sampler_without_its_inputs_is_not_offered():
    with pytest.raises(ValueError, match="without it") as error:
        build_sampler(SamplerConfig("icp"), {})
    reason, _, offered = str(error.value).partition("without it there are ")
    assert "'icp' needs the output of the stage demonstrations" in reason
    assert {"aimed", "random"} <= set(offered.split(", "))
    assert "icp" not in offered


def test_own_sampler_is_one_function(monkeypatch):
    monkeypatch.setattr(registry, "_FACTORIES", dict(registry._FACTORIES))
    monkeypatch.setattr(registry, "_REQUIRED_INPUTS", dict(registry._REQUIRED_INPUTS))

    @sampler("constant")
    def build(config: SamplerConfig, inputs):
        return config.name

    assert build_sampler(SamplerConfig("constant", {"name": "mine"}), {}) == "mine"
    assert SamplerConfig("constant").modules() == (__name__,)


@pytest.mark.slow
def test_module_of_a_sampler_registers_it_and_is_found_without_import():
    code = (
        "import sys; from importlib import import_module\n"
        "from knotflow.samplers.sampler import _FACTORIES, MODULES, SamplerConfig\n"
        "modules = {name: SamplerConfig(name).modules() for name in MODULES}\n"
        "assert not {*MODULES.values()} & {*sys.modules}\n"
        "for name, (module,) in modules.items():\n"
        "    import_module(module)\n"
        "    assert name in _FACTORIES"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_capabilities_are_the_methods_unless_a_sampler_names_them():
    class Valuing:
        def values(self, points, actions, rng):
            return np.zeros(len(actions))

    every, none = Valuing(), Valuing()
    none.capabilities = frozenset()
    assert capability(every, "values") == every.values and has_capability(every, "undo")
    assert capability(every, "arrange") is None
    assert capability(none, "values") is None and not has_capability(none, "undo")
