"""docs/paper.md names functions and tests that exist, and every labelled equation."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
TEXT = (ROOT / "docs" / "paper.md").read_text(encoding="utf-8")
LABELS = [
    *("s2-01", "s2-02", "s3-01", "s3-02", "s3-021", "s3-03", "s3-04", "s3-05", "s3-06"),
    *("s32-1", "kstate", "forward", "backward", "CV"),
]
REFERENCES = sorted(set(re.findall(r"`([\w/]+\.py):(\w+)`", TEXT)))


def test_every_labelled_equation_has_its_row():
    before, _, _ = TEXT.partition("## Sentences")
    rows = re.findall(r"^\| (\S+) \| .* \| `.*` \| `.*` \|$", before, re.MULTILINE)
    assert rows == LABELS
    assert len(REFERENCES) > 60


@pytest.mark.parametrize(
    ("path", "name"), REFERENCES, ids=[f"{path}:{name}" for path, name in REFERENCES]
)
def test_what_is_named_exists(path, name):
    folder = "tests" if Path(path).name.startswith("test_") else "src/isogal/isogal"
    source = (ROOT / folder / path).read_text(encoding="utf-8")
    assert re.search(rf"^(def|class) {name}\b|^{name}\b.*=", source, re.MULTILINE)
