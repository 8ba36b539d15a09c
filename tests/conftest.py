"""Fixtures that every test package shares."""

from pathlib import Path

import pytest
from hypothesis import settings

# No deadline: a first call compiles, and the machine may be busy. The same examples at every run.
settings.register_profile("isogal", deadline=None, derandomize=True)
settings.load_profile("isogal")

ROOT = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Folder of the test data beside the repository; skips the test where there is none."""
    folder = ROOT.parent / "shared" / "data"
    if not folder.is_dir():
        pytest.skip("the shared test data (../shared/data) is not present")
    return folder
