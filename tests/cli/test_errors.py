"""How a command ends that cannot go on."""

import os
import signal
import subprocess
import sys
from io import StringIO
from pathlib import Path

import pytest

from isogal.cli import errors
from isogal.cli.errors import clean_errors
from isogal.cli.tables import print_table

ISOGAL = Path(sys.executable).with_name("isogal")


def version_into(stream):
    done = subprocess.run(
        [ISOGAL, "--version"], stdout=stream, stderr=subprocess.PIPE, timeout=60, check=False
    )
    return done.returncode, done.stderr.decode()


def test_a_closed_pipe_is_not_reported():
    read_end, write_end = os.pipe()
    os.close(read_end)
    with os.fdopen(write_end, "wb") as closed_pipe:
        assert version_into(closed_pipe) == (141, "")


def test_a_pipe_that_is_closed_while_a_table_is_printed_says_so(monkeypatch):
    """`rich` would end the process with status 1 by itself."""

    class Closed(StringIO):
        def write(self, text):
            if text:
                raise BrokenPipeError
            return 0

    monkeypatch.setattr("sys.stdout", Closed())
    with pytest.raises(BrokenPipeError):
        print_table(["a"], [["1"]])


@pytest.mark.parametrize(
    ("command", "status"), [("{} --version >&-", 0), ("{} run --set 2>&-", 2)]
)
def test_a_stream_that_the_shell_has_closed(command, status):
    done = subprocess.run(
        command.format(ISOGAL), shell=True, capture_output=True, timeout=60, check=False
    )
    assert (done.returncode, b"Traceback" in done.stderr) == (status, False)


def test_a_terminal_that_lacks_a_character():
    """As where LANG names an encoding other than UTF-8; the help of match has a name with ö."""
    done = subprocess.run(
        [ISOGAL, "match", "--help"],
        env=os.environ | {"PYTHONIOENCODING": "ascii"},
        capture_output=True,
        timeout=60,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, b"")


def test_an_interrupt_while_everything_is_imported():
    """The program's own import is interrupted by a module that stands for any of them."""
    code = """
import sys, types
class Interrupted(types.ModuleType):
    def __getattr__(self, name):
        raise KeyboardInterrupt
sys.modules["typer"] = Interrupted("typer")
from importlib.metadata import entry_points
(program,) = entry_points(group="console_scripts", name="isogal")
program.load()()
"""
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=False
    )
    assert (done.returncode, done.stderr) == (130, "isogal: interrupted\n")


def test_a_full_disk_is_one_line():
    line = "isogal: the output cannot be written: No space left on device\n"
    with Path("/dev/full").open("wb") as full:
        assert version_into(full) == (2, line)


def test_the_extra_is_named(capsys):
    @clean_errors
    def needs():
        raise ModuleNotFoundError("No module named 'rasterio.crs'", name="rasterio.crs")

    with pytest.raises(SystemExit) as ended:
        needs()
    assert ended.value.code == 2
    assert "pip install 'isogal[maps]'" in capsys.readouterr().err


def test_a_module_of_our_own_that_is_missing_is_a_defect():
    @clean_errors
    def broken():
        raise ModuleNotFoundError("No module named 'isogal.nothing'", name="isogal.nothing")

    with pytest.raises(ModuleNotFoundError):
        broken()


@pytest.fixture
def handlers(monkeypatch):
    """Signals as a new process has them; afterwards as they were."""
    monkeypatch.setattr(errors, "_interrupts", errors.Interrupts())
    monkeypatch.setattr(sys, "unraisablehook", sys.unraisablehook)
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.mark.usefixtures("handlers")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_of_which_a_library_makes_an_error_of_its_own(number, capsys):
    @clean_errors
    def builds(interrupted: bool):
        try:
            if interrupted:
                signal.raise_signal(number)
        finally:
            raise RuntimeError("cannot be built")

    errors.remember_interrupts()
    with pytest.raises(RuntimeError, match="cannot be built"):
        builds(interrupted=False)
    with pytest.raises(SystemExit) as end:
        builds(interrupted=True)
    assert (end.value.code, capsys.readouterr().err) == (130, "isogal: interrupted\n")


@pytest.mark.usefixtures("handlers")
def test_a_signal_that_is_ignored_stays_so():
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    errors.remember_interrupts()
    assert signal.getsignal(signal.SIGTERM) is signal.SIG_IGN
    assert signal.getsignal(signal.SIGINT) is not signal.default_int_handler
