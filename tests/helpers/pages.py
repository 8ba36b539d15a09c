"""The blocks that a page of documentation shows, and how its commands are run.

A page's commands are its fenced blocks without a language or of `sh`; a block of YAML, TOML or
Python whose first line is the comment ``# NAME.yaml`` (``.toml``, ``.py``) is written to that
file. Comments that do not show say how:

``<!-- not run -->``
    before a block: it is left out.
``<!-- first``, commands, ``-->``
    make what the page takes for granted, such as a map. They, too, are run in their place.
``<!-- short: --runs 8=--runs 2; BIG=SMALL -->``
    words that are replaced by others for a quick run."""

import os
import re
import runpy
import shlex
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest

from helpers.command_line import answer

_NOT_RUN, _FIRST = "<!-- not run -->", "<!-- first"
_SHORT = re.compile(r"^<!-- short: (.*?) -->$", re.M)
_NAMED = re.compile(r"# (\S+\.(?:yaml|toml|py))\n")
COMMANDS = ("", "sh")
"""Languages of blocks of commands."""
_FILES = ("yaml", "toml", "python")
"""Those of blocks that may be files."""


class Block(NamedTuple):
    """A fenced block, or the commands of a comment (`hidden`)."""

    language: str
    text: str
    run: bool = True
    hidden: bool = False

    def lines(self) -> list[str]:
        """Return the commands, with lines joined that end in a backslash."""
        joined = re.sub(r"\s*\\\n\s*", " ", self.text)
        return [line.strip() for line in joined.splitlines() if line.strip()]


def blocks(page: Path) -> Iterator[Block]:
    """Yield the blocks of a page in their order."""
    language: str | None = None
    run, inside = True, []
    for line in page.read_text(encoding="utf-8").splitlines():
        if language is not None:
            if line == ("-->" if language == _FIRST else "```"):
                hidden = language == _FIRST
                yield Block("" if hidden else language, "\n".join(inside), run, hidden)
                language, run = None, True
            else:
                inside.append(line)
        elif line.startswith("```"):
            language, inside = line[3:].strip(), []
        elif line == _FIRST:
            language, inside = line, []
        elif line.strip():
            run = line != _NOT_RUN


def commands(page: Path, short: bool = False) -> list[str]:
    """Return the commands of a page that are to be run, each a line for a shell."""
    text = page.read_text(encoding="utf-8")
    swaps = [one.split("=", 1) for line in _SHORT.findall(text) for one in line.split("; ")]
    lines = []
    for block in blocks(page):
        if block.run and block.language in COMMANDS:
            lines += block.lines()
        elif block.run and (named := _named(block)):
            lines.append(
                f"mkdir -p {Path(named).parent}; cat > {named} << 'END'\n{block.text}\nEND"
            )
    if short:
        for before, after in swaps:
            assert any(before in line for line in lines), f"{page}: no command has '{before}'"
            lines = [line.replace(before, after) for line in lines]
    return lines


def named_files(page: Path) -> dict[str, str]:
    """Return the blocks of a page that are files, by name."""
    return {name: block.text for block in blocks(page) if (name := _named(block))}


def _named(block: Block) -> str:
    """Return the name of the file that a block is, or nothing."""
    found = _NAMED.match(block.text) if block.language in _FILES else None
    return found[1] if found else ""


def run_here(lines: list[str]) -> None:
    """Run commands in this process and folder: isogal and scripts in Python; others by a shell."""
    for line in lines:
        program = line.split()[0]
        words = shlex.split(line, comments=True) if program in ("isogal", "python") else []
        if program == "isogal":
            answer(*words[1:])
        elif program == "python":
            with pytest.MonkeyPatch.context() as patch:
                patch.setattr(sys, "argv", words[1:])
                runpy.run_path(words[1], run_name="__main__")
        else:
            path = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
            subprocess.run(["bash", "-euc", line], check=True, env=os.environ | {"PATH": path})
