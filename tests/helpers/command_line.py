"""Calls of the command line in this process."""

from typer.testing import CliRunner

from isogal.cli.main import app


def call(*words: object) -> tuple[int, str, str]:
    """Return exit status, standard output and standard error stream of ``isogal WORD ...``."""
    result = CliRunner().invoke(app, [str(word) for word in words], catch_exceptions=False)
    return result.exit_code, result.stdout, result.stderr


def answer(*words: object) -> str:
    """Return the standard output of a call that succeeds."""
    status, out, err = call(*words)
    assert status == 0, err
    return out


def refusal(*words: object) -> str:
    """Return the line with which a call is refused."""
    status, out, err = call(*words)
    assert (status, out) == (2, ""), err
    assert err.startswith("isogal: ")
    assert err.count("\n") == 1
    return err
