"""Memory that is free goes back to the system."""

import ctypes
from pathlib import Path

import pytest

from isogal_ros.nodes import memory
from isogal_ros.nodes.memory import EVERY, Memory

BLOCKS, SIZE = 2000, 16_000
"""32 MB of blocks that the C library does not take from the system one by one."""


def resident() -> float:
    """MB of this process."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * 4096 / 1e6


def test_what_lies_below_a_block_in_use_is_given_back_when_it_is_time(monkeypatch) -> None:
    now = 0.0
    monkeypatch.setattr(memory.time, "monotonic", lambda: now)
    made = Memory()
    if made._trim is None:
        pytest.skip("not glibc")
    library = ctypes.CDLL(None)
    library.malloc.restype = ctypes.c_void_p
    blocks = [ctypes.c_void_p(library.malloc(ctypes.c_size_t(SIZE))) for _ in range(BLOCKS)]
    for block in blocks:
        ctypes.memset(block, 1, SIZE)
    for block in blocks[:-1]:
        library.free(block)
    before = resident()
    assert not made.give_back()
    assert resident() > before - 5.0
    now = EVERY
    assert made.give_back()
    assert resident() < before - 25.0
    assert not made.give_back()
    library.free(blocks[-1])
