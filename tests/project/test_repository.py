"""What must hold for every file of the repository."""

import re
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]

# Absolute paths that exist on one machine only, and hosts or options of package registries.
FOREIGN = re.compile(
    r"(?<![\w./~-])/(?:work|root|home|Users)/\w"
    r"|--(?:index-url|extra-index-url|find-links|trusted-host)\b(?!\s*[\"'`),])"
    r"|https?://[^\s/]*(?:artifactory|nexus|devpi|pypi)[^\s]*"
)


def tracked_files() -> list[Path]:
    try:
        listing = subprocess.run(
            ["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, check=True, timeout=30
        )
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("not a git checkout")
    return [ROOT / name for name in listing.stdout.decode().split("\0") if name]


def test_no_path_of_one_machine_and_no_registry() -> None:
    found = []
    for path in tracked_files():
        if path.is_symlink() or not path.is_file():
            continue
        try:
            text = path.read_text(encoding="utf-8")
        except UnicodeDecodeError:
            continue
        found += [f"{path.relative_to(ROOT)}: {match.group()}" for match in FOREIGN.finditer(text)]
    assert not found


def test_generated_files_are_not_tracked() -> None:
    generated = re.compile(r"(^|/)(__pycache__|out|build|install|log)/|\.(nbi|nbc|pyc)$")
    names = (str(path.relative_to(ROOT)) for path in tracked_files())
    assert [name for name in names if generated.search(name)] == []
