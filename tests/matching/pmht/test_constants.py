"""The numbers of `pmht` have their reasons in a table (docs/mathematics.md, section 8.3)."""

import pkgutil
import re
from importlib import import_module
from pathlib import Path

import pytest

from isogal.matching import pmht
from isogal.matching.pmht.models import FAMILIES
from isogal.matching.pmht.states import UNKNOWN

PAGE = Path(__file__).resolve().parents[3] / "docs" / "mathematics.md"
INDICES = {name.upper() for name in (*FAMILIES, *UNKNOWN)}
OTHERS = INDICES | {
    "BATCH_STATES",
    "HEADING",
    "USUAL_STATES",
    "DIVERGED_LOG_ODDS",
    "SAYS",
    "LARGEST_RATIO",
    "FILTER",
}
"""What is no number of its own."""


def numbers() -> dict[str, float]:
    """Constants of all modules that are one number."""
    names = (module.name for module in pkgutil.iter_modules(pmht.__path__))
    modules = [import_module(f"isogal.matching.pmht.{name}") for name in names]
    return {
        name: value
        for module in modules
        for name, value in vars(module).items()
        if name.isupper() and isinstance(value, int | float) and name not in OTHERS
    }


def table() -> dict[str, float]:
    """Names and values of the table."""
    section = PAGE.read_text(encoding="utf-8").partition("### 8.3 ")[2].partition("\n## ")[0]
    rows = [line.split("|")[1:3] for line in section.splitlines() if line.startswith("| `")]
    return {
        name: float(value)
        for names, values in rows
        for name, value in zip(re.findall(r"`(\w+)`", names), values.split(","), strict=True)
    }


def test_each_number_has_its_reason():
    written, found = table(), numbers()
    assert written.keys() == found.keys()
    assert written == pytest.approx(found, rel=1e-5)
