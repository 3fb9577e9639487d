"""Stages compute on one thread of PyTorch, wherever they run."""

import pytest
import torch

from knotflow.threads import one_thread

pytestmark = pytest.mark.usefixtures("two_threads")


def test_the_number_of_threads_is_put_back_even_after_an_error():
    with pytest.raises(RuntimeError), one_thread():
        assert torch.get_num_threads() == 1
        raise RuntimeError
    assert torch.get_num_threads() == 2


def test_a_stage_has_one_thread(go, mapping, between):
    seen = []
    between(lambda: seen.append(torch.get_num_threads()))
    go(mapping)
    assert set(seen) == {1}
    assert torch.get_num_threads() == 2
