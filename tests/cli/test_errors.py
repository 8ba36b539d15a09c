"""How a command ends that cannot go on."""

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


@pytest.mark.parametrize(
    ("command", "status", "says"),
    [
        # a pipe that nobody reads is not reported; 141 as of a program that SIGPIPE has ended
        ("{} --version | sleep 0; exit $PIPESTATUS", 141, ""),
        (
            *("{} --version > /dev/full", 2),
            "isogal: the output cannot be written: No space left on device\n",
        ),
        # streams that the shell has closed
        ("{} --version >&-", 0, ""),
        ("{} run --set 2>&-", 2, ""),
        # a terminal that lacks a character: the help of match has a name with ö
        ("PYTHONIOENCODING=ascii {} match --help > /dev/null", 0, ""),
    ],
)
def test_where_the_output_goes_nowhere(command, status, says):
    words = ["bash", "-c", command.format(ISOGAL)]
    done = subprocess.run(words, capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stderr) == (status, says)


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


@pytest.mark.parametrize(
    ("module", "ended", "says"),
    [
        ("rasterio.crs", SystemExit, "pip install 'isogal[maps]'"),
        ("isogal.nothing", ModuleNotFoundError, ""),  # of our own: a defect
    ],
)
def test_the_extra_of_a_module_that_is_missing_is_named(capsys, module, ended, says):
    @clean_errors
    def needs():
        raise ModuleNotFoundError(f"No module named '{module}'", name=module)

    with pytest.raises(ended):
        needs()
    assert says in capsys.readouterr().err


@pytest.fixture
def handlers(monkeypatch):
    """Signals as a new process has them; afterwards as they were."""
    monkeypatch.setattr(errors, "_interrupts", errors.Interrupts())
    monkeypatch.setattr(sys, "unraisablehook", sys.unraisablehook)
    signals = signal.SIGINT, signal.SIGTERM, signal.SIGHUP
    before = {number: signal.getsignal(number) for number in signals}
    for number in signals:
        signal.signal(number, signal.SIG_DFL)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.mark.usefixtures("handlers")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
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
