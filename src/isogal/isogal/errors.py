"""The one exception that means "the user gave something that cannot be used"."""

from collections.abc import Iterable
from difflib import get_close_matches


class InputError(ValueError):
    """Bad input from a user: one clear line that names the file or field and what is allowed.

    The command line prints the message and exits with status 2; nodes refuse the parameter or drop
    the message."""


def nearest(name: str, known: Iterable[str], cutoff: float = 0.6) -> str:
    """Return "; did you mean '...'?" with the known name that is most like a wrong one; empty
    where none is like it (difflib's cutoff)."""
    found = get_close_matches(name, list(known), 1, cutoff)
    return f"; did you mean {found[0]!r}?" if found else ""
