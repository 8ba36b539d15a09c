"""Bad input is refused in one line."""

import re
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from isogal.errors import InputError


@contextmanager
def refusal(words: str) -> Iterator[None]:
    """Whether a block raises InputError, in one line that has some words."""
    with pytest.raises(InputError, match=re.escape(words)) as error:
        yield
    assert "\n" not in str(error.value)
