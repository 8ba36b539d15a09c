"""The commands that a page of documentation shows, and how they are run.

A page's commands are its fenced blocks without a language or of `sh`. What is not to be run is
named in the page, in comments that do not show: ``<!-- not run -->`` before a block. A page may
say how its numbers are made smaller, for a quick run, in words that are replaced by others:
``<!-- short: --runs 8=--runs 2 -->``, several of them with semicolons between."""

import re
import runpy
import shlex
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from helpers.command_line import answer

_NOT_RUN = "<!-- not run -->"
_SHORT = re.compile(r"^<!-- short: (.*?) -->$", re.M)


def commands(page: Path, short: bool = False) -> list[str]:
    """Return the commands of a page, line by line; lines that end in a backslash are joined."""
    text = page.read_text(encoding="utf-8")
    swaps = [one.split("=", 1) for line in _SHORT.findall(text) for one in line.split("; ")]
    lines = [
        line.strip()
        for block in _blocks(text)
        for line in re.sub(r"\s*\\\n\s*", " ", block).splitlines()
        if line.strip()
    ]
    if short:
        for before, after in swaps:
            assert any(before in line for line in lines), f"{page}: no command has '{before}'"
            lines = [line.replace(before, after) for line in lines]
    return lines


def _blocks(text: str) -> Iterator[str]:
    """Yield the text of each block of commands that is to be run."""
    language: str | None = None
    skip, inside = False, []
    for line in text.splitlines():
        if language is None and line.startswith("```"):
            language, inside = line[3:].strip(), []
        elif line == "```":
            if language in ("", "sh") and not skip:
                yield "\n".join(inside)
            language, skip = None, False
        elif language is not None:
            inside.append(line)
        elif line.strip():
            skip = line == _NOT_RUN


def run_here(lines: list[str]) -> None:
    """Run commands in this process and folder: isogal and scripts in Python; others by a shell."""
    for line in lines:
        words = shlex.split(line, comments=True)
        if words[0] == "isogal":
            answer(*words[1:])
        elif words[0] == "python":
            with pytest.MonkeyPatch.context() as patch:
                patch.setattr(sys, "argv", words[1:])
                runpy.run_path(words[1], run_name="__main__")
        else:
            subprocess.run(["bash", "-euc", line], check=True)
