"""How a command ends that cannot go on."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from isogal.cli.errors import clean_errors
from isogal.errors import InputError

ISOGAL = Path(sys.executable).with_name("isogal")


def test_a_closed_pipe_is_not_reported() -> None:
    read_end, write_end = os.pipe()
    os.close(read_end)
    with os.fdopen(write_end, "wb") as closed_pipe:
        done = subprocess.run(
            [ISOGAL, "--version"],
            stdout=closed_pipe,
            stderr=subprocess.PIPE,
            text=True,
            timeout=60,
            check=False,
        )
    assert (done.returncode, done.stderr) == (141, "")


def test_a_full_disk_is_one_line() -> None:
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            [ISOGAL, "--version"],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            timeout=60,
            check=False,
        )
    assert (done.returncode, done.stderr) == (
        2,
        "isogal: the output cannot be written: No space left on device\n",
    )


def test_clean_errors_keeps_the_result_and_the_signature() -> None:
    @clean_errors
    def double(value: int) -> int:
        """Double it."""
        if value < 0:
            raise InputError("value: must not be negative")
        return 2 * value

    assert double(4) == 8
    assert double.__doc__ == "Double it."
    with pytest.raises(SystemExit) as stopped:
        double(-1)
    assert stopped.value.code == 2
