import subprocess
import sys
from dataclasses import dataclass, field
from enum import Enum
from pathlib import PurePosixPath

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from knotflow.workflow.key import canonical_json, digest, key_of, plain

VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(),
    lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner),
    max_leaves=10,
)

# A busy machine is no fault.
unhurried = settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])


class Colour(Enum):
    RED = 1


@dataclass
class Part:
    length: float = 1.0
    threads: int = field(default=1, metadata={"affects_result": False})


@unhurried
@given(VALUES)
def test_plain_is_idempotent(value):
    assert plain(plain(value)) == plain(value)


@unhurried
@given(st.dictionaries(st.text(), st.integers(), min_size=2))
def test_key_ignores_the_order_of_mappings(mapping):
    assert key_of(mapping) == key_of(dict(reversed(mapping.items())))


def test_fields_that_cannot_change_a_result_do_not_count():
    assert key_of({"part": Part(threads=8)}) == key_of({"part": Part()})
    assert key_of({"part": Part(length=2.0)}) != key_of({"part": Part()})


def test_enums_paths_and_sets_have_one_form():
    assert plain({"a": Colour.RED, "b": PurePosixPath("x/y"), "c": {2, 1}}) == {
        "a": "RED",
        "b": "x/y",
        "c": [1, 2],
    }


def test_other_values_are_refused_with_their_place():
    with pytest.raises(TypeError, match="part.inner is <object"):
        plain({"part": {"inner": object()}})


def test_key_is_the_same_in_another_process():
    code = "from knotflow.workflow.key import key_of; print(key_of({'b': 0.1, 'a': [1, None]}))"
    other = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert other.stdout.strip() == key_of({"a": [1, None], "b": 0.1})
    assert canonical_json({"b": 0.1, "a": "ü"}) == '{"a":"\\u00fc","b":0.1}'


def test_digest_is_of_contents_and_names_inside(tmp_path):
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "file").write_text("same")
    assert digest(tmp_path / "one") == digest(tmp_path / "two")
    (tmp_path / "two" / "file").rename(tmp_path / "two" / "renamed")
    assert digest(tmp_path / "one") != digest(tmp_path / "two")
    with pytest.raises(FileNotFoundError):
        digest(tmp_path / "three")
