"""Memory that is free goes back to the system."""

import ctypes
from pathlib import Path

import pytest

from helpers.node_bench import bench
from isogal_ros import topics
from isogal_ros.nodes import base

BLOCKS, SIZE = 2000, 16_000
"""32 MB of blocks that the C library does not take from the system one by one."""


def resident() -> float:
    """MB of this process."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * 4096 / 1e6


def test_what_lies_below_a_block_in_use_is_given_back() -> None:
    library = ctypes.CDLL(None)
    if not hasattr(library, "malloc_trim"):
        pytest.skip("not glibc")
    library.malloc.restype = ctypes.c_void_p
    blocks = [ctypes.c_void_p(library.malloc(ctypes.c_size_t(SIZE))) for _ in range(BLOCKS)]
    for block in blocks:
        ctypes.memset(block, 1, SIZE)
    for block in blocks[:-1]:
        library.free(block)
    before = resident()
    base.give_memory_back()
    assert resident() < before - 25.0
    library.free(blocks[-1])


def test_a_node_gives_it_back_when_it_is_time(scenario, monkeypatch) -> None:
    given = []
    monkeypatch.setattr(base, "give_memory_back", lambda: given.append(True))
    with bench(topics.UKF_FUSION, scenario()) as made:
        made.bus.tick()
        assert not given
        monkeypatch.setattr(base, "FREE_EVERY", 0.0)
        made.bus.tick()
        assert given
