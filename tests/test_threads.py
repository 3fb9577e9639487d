"""Blocks on one thread overlap in whatever order."""

import torch

from knotflow.threads import one_thread


def test_the_number_of_threads_is_put_back_after_the_last_of_overlapping_blocks():
    before = torch.get_num_threads()
    torch.set_num_threads(3)
    try:
        first, second = one_thread(), one_thread()
        first.__enter__()
        second.__enter__()
        assert torch.get_num_threads() == 1
        first.__exit__(None, None, None)
        assert torch.get_num_threads() == 1
        second.__exit__(None, None, None)
        assert torch.get_num_threads() == 3
    finally:
        torch.set_num_threads(before)
