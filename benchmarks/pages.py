"""Tables of pages under docs/evidence: what is between two marks is replaced."""

import re
from datetime import UTC, datetime
from pathlib import Path

from isogal.files import write_atomic


def write_between(page: Path, marks: tuple[str, str], text: str) -> None:
    """Put a text, with today's date at its head, between two marks of a page.

    Raises
    ------
    SystemExit
        The page has not both marks.
    """
    before = page.read_text(encoding="utf-8")
    pattern = re.escape(marks[0]) + ".*?" + re.escape(marks[1])
    new = f"{marks[0]}\nOf {datetime.now(UTC):%Y-%m-%d}.\n\n{text}\n{marks[1]}"
    after, found = re.subn(pattern, lambda _: new, before, flags=re.DOTALL)
    if not found:
        raise SystemExit(f"{page}: has no '{marks[0]}' followed by '{marks[1]}'")
    write_atomic(page, after)
