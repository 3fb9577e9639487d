from __future__ import annotations

import warnings

import numpy as np
import pytest
import torch
from safetensors.torch import load_file, save_file

from knotflow.samplers.primitives import (
    FILE,
    LibraryError,
    PrimitiveLibrary,
    UnlikeRopeWarning,
    encode,
)
from knotflow.samplers.primitives.config import SHIPPED_PRIMITIVES
from knotflow.samplers.sampler import SamplerConfig, build_sampler
from knotflow.simulation import NOMINAL, ProportionsConfig, RopeConfig, rope_of
from knotflow.topology import parse_action

ACTION = parse_action("C(0,1,1)")


@pytest.fixture
def path(library, tmp_path):
    library.save(tmp_path / FILE)
    return tmp_path / FILE


def test_a_loaded_library_proposes_the_same(library, path, ropes):
    loaded = PrimitiveLibrary.load(path, RopeConfig())
    assert loaded.trained_on == library.trained_on
    one, other = (
        some.sample(ropes["loop"], ACTION, 3, np.random.default_rng(0))
        for some in (library, loaded)
    )
    np.testing.assert_array_equal(one, other)


def test_a_folder_of_parts_in_half_precision_proposes_nearly_the_same(library, ropes, tmp_path):
    for number, primitive in library.primitives.items():
        part = {number: primitive}
        trained_on = {number: library.trained_on[number]}
        one = PrimitiveLibrary(part, trained_on, library.rope)
        one.save(tmp_path / f"primitive-{number}.safetensors", half=True)
    loaded = PrimitiveLibrary.load(tmp_path, RopeConfig())
    assert loaded.trained_on == library.trained_on
    one, other = (
        some.sample(ropes["loop"], ACTION, 3, np.random.default_rng(0))
        for some in (library, loaded)
    )
    np.testing.assert_allclose(one, other, atol=0.02)


def test_a_folder_with_a_primitive_twice_is_refused(library, tmp_path):
    for name in "ab":
        library.save(tmp_path / f"{name}.safetensors")
    with pytest.raises(LibraryError, match="in two of them"):
        PrimitiveLibrary.load(tmp_path)


def test_sampler_is_built_from_a_stage_or_a_file(path, ropes):
    for source in (path.parent, path):
        built = build_sampler(SamplerConfig("primitives"), {"primitives": source})
        assert built.sample(ropes["loop"], ACTION, 2, np.random.default_rng(0)).shape == (2, 6)


def test_sampler_without_a_library_names_its_input():
    with pytest.raises(ValueError, match="needs the output of the stage primitives"):
        build_sampler(SamplerConfig("primitives"), {})


@pytest.mark.parametrize("place", [0.3, 0.9])
def test_a_flipped_bit_is_refused(path, place):
    content = bytearray(path.read_bytes())
    content[int(place * len(content))] ^= 4
    path.write_bytes(content)
    with pytest.raises(LibraryError, match="damaged"):
        PrimitiveLibrary.load(path)


def test_a_cut_file_is_refused(path):
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(LibraryError, match="damaged"):
        PrimitiveLibrary.load(path)


def test_some_other_safetensors_file_is_refused(path):
    save_file(load_file(path), path)
    with pytest.raises(LibraryError, match="unknown format"):
        PrimitiveLibrary.load(path)


def test_another_rope_is_refused_by_what_differs(path):
    with pytest.raises(LibraryError, match="links 40, not 30"):
        PrimitiveLibrary.load(path, RopeConfig(links=30))


def test_a_rope_of_another_size_is_warned_of_with_the_numbers(library):
    with pytest.warns(UnlikeRopeWarning, match=r"length 2 m \(trained with 1 m\), diameter 0.005 "):
        library.for_rope(RopeConfig(length=2.0))
    library.proportions = ProportionsConfig()
    with pytest.warns(UnlikeRopeWarning, match=r"length 0.15 lengths \(trained with 0.01 to 0.12 "):
        library.for_rope(rope_of(0.01, 0.15))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        library.for_rope(rope_of(0.02, 0.11))


def test_primitives_are_told_the_rope(library, ropes):
    thick, curve = rope_of(0.02, 0.11, NOMINAL.links), ropes["loop"]
    library.proportions = ProportionsConfig()
    seen = encode(curve[None], [ACTION], rope=thick).states["streams"][0, :, -2:]
    expected = np.log([[2.0, 0.11 / NOMINAL.bending_length]] * len(seen))
    np.testing.assert_allclose(seen, expected, rtol=1e-5)
    assert not encode(curve[None], [ACTION]).states["streams"][0, :, -2:].any()
    usual, other = (
        one.sample(curve, ACTION, 2, np.random.default_rng(0))
        for one in (library, library.for_rope(thick))
    )
    assert not np.allclose(usual, other)


def test_libraries_merge_and_do_not_overwrite_each_other(library):
    singles = [
        PrimitiveLibrary({n: library.primitives[n]}, {n: library.trained_on[n]}, library.rope)
        for n in (1, 2, 3, 4)
    ]
    assert PrimitiveLibrary.merged(singles).trained_on == library.trained_on
    with pytest.raises(ValueError, match=r"\[1\]"):
        PrimitiveLibrary.merged([library, singles[0]])


def test_next_values_are_known_where_the_file_says_so_or_to_older_ones_that_arrange(library, path):
    assert "sample_for_next" not in PrimitiveLibrary.load(path).capabilities
    knows = PrimitiveLibrary(library.primitives, library.trained_on, library.rope, True)
    knows.save(path)
    assert "sample_for_next" in PrimitiveLibrary.load(path).capabilities
    assert "sample_for_next" in PrimitiveLibrary.merged([knows]).capabilities
    shipped = PrimitiveLibrary.load(SHIPPED_PRIMITIVES)
    assert {"sample_for_next", "arrange"} <= shipped.capabilities


def test_proposals_for_many_ropes_come_in_their_order(library, ropes):
    points = np.stack([ropes["loop"], ropes["straight"], ropes["loop"]])
    actions = [ACTION, parse_action("R1(0,1,1)"), parse_action("C(1,2,1)")]
    splines = library.propose(points, actions, 2, np.random.default_rng(0))
    assert splines.shape == (3, 2, 6)
    rng = np.random.default_rng(0)
    # Primitive 1 is asked first, then 3, then 4: the same random numbers in this order.
    for row in (1, 0, 2):
        alone = library.sample(points[row], actions[row], 2, rng)
        np.testing.assert_allclose(splines[row], alone, atol=1e-5)


def test_the_value_is_the_probability_of_the_best_spline(library, ropes):
    (value,) = library.values(ropes["loop"][None], [ACTION], np.random.default_rng(0))
    seen = encode(ropes["loop"][None], [ACTION])
    primitive = library.primitives[3]
    (noise,) = primitive.value_noise(1, np.random.default_rng(0))
    splines = primitive.distribution(seen.states).draw(noise)
    values = primitive.scorer(seen.states)(splines).exp()
    assert values.shape == (1, primitive.config.cem.valued)
    assert value == pytest.approx(values.max().item())
    assert 0 < value < 1


@pytest.mark.usefixtures("two_threads")
def test_it_computes_on_one_thread_and_leaves_the_number_as_it_was(library, ropes, monkeypatch):
    threads = []
    for primitive in library.primitives.values():
        for name in ("search", "values"):
            compute = getattr(primitive, name)

            def counted(*arguments, compute=compute):
                threads.append(torch.get_num_threads())
                return compute(*arguments)

            monkeypatch.setattr(primitive, name, counted)
    library.sample(ropes["loop"], ACTION, 2, np.random.default_rng(0))
    library.values(ropes["loop"][None], [ACTION], np.random.default_rng(0))
    assert threads == [1, 1]
    assert torch.get_num_threads() == 2
