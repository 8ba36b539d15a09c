"""The lock files, and where uv looks for what they name: where pip is configured to look."""

import importlib.util
import re
import subprocess
import sys
from pathlib import Path

import pytest

from helpers.packages import ROOT, required_by_file

spec = importlib.util.spec_from_file_location("uv_like_pip", ROOT / ".ci" / "uv.py")
assert spec is not None and spec.loader is not None
uv = importlib.util.module_from_spec(spec)
spec.loader.exec_module(uv)


def test_uv_hears_what_pip_is_told(tmp_path: Path) -> None:
    (tmp_path / "wheels").mkdir()
    (tmp_path / "pip.conf").write_text(
        "[global]\n"
        "index-url = https://user:word@mirror.example.org/simple\n"
        "extra-index-url =\n  https://more.example.org/a\n  https://more.example.org/b\n"
        "[install]\ntrusted-host = more.example.org\n[list]\ntimeout = 5\n"
    )
    environment = {
        "HOME": str(tmp_path),
        "PIP_CONFIG_FILE": str(tmp_path / "pip.conf"),
        "PIP_FIND_LINKS": f"{tmp_path}/wheels {tmp_path}/gone file://{tmp_path}/wheels",
        "PIP_DEFAULT_TIMEOUT": "40",
        "PIP_NO_CACHE_DIR": "1",
        "PIP_CERT": "ca.pem",
    }
    listing = subprocess.run(
        [sys.executable, "-m", "pip", "config", "list"],
        env=environment,
        capture_output=True,
        text=True,
        check=True,
        timeout=60,
    )
    assert uv.uv_variables(uv.pip_options(listing.stdout)) == {
        "UV_INDEX_STRATEGY": "unsafe-best-match",
        "UV_DEFAULT_INDEX": "https://user:word@mirror.example.org/simple",
        "UV_INDEX": "https://more.example.org/a https://more.example.org/b",
        "UV_FIND_LINKS": f"{tmp_path}/wheels,file://{tmp_path}/wheels",
        "UV_NO_CACHE": "1",
        "UV_HTTP_TIMEOUT": "40",
        "UV_INSECURE_HOST": "more.example.org",
        "SSL_CERT_FILE": "ca.pem",
    }


def pins(name: str) -> dict[str, set[str]]:
    """Package -> its lines in a lock file, one for each environment marker."""
    found: dict[str, set[str]] = {}
    for line in (ROOT / name).read_text(encoding="utf-8").splitlines():
        if re.match(r"[a-z]", line):
            found.setdefault(line.split("==")[0], set()).add(line)
    return found


def test_the_locks_agree_and_hold_no_tool_for_a_run() -> None:
    run, tools = pins("requirements.lock"), pins("requirements-development.lock")
    both = run.keys() & tools.keys()
    assert {name: tools[name] for name in both} == {name: run[name] for name in both}
    assert not {"pytest", "ruff", "mypy", "import-linter"} & set(run)
    assert list(pins("requirements-installer.lock")) == ["uv"]


@pytest.mark.parametrize("name", ["requirements", "requirements-development"])
def test_every_direct_dependency_is_locked(name: str) -> None:
    assert required_by_file(f"{name}.in") <= set(pins(f"{name}.lock"))


@pytest.mark.parametrize(
    "name",
    ["requirements", "requirements-development", "requirements-installer", "docker/requirements"],
)
def test_every_version_is_pinned_by_hashes(name: str) -> None:
    text = (ROOT / f"{name}.lock").read_text(encoding="utf-8")
    pinned = re.findall(r"^[a-z0-9._-]+==.*(?:\n    .*)*", text, re.MULTILINE)
    assert pinned
    assert [entry.split()[0] for entry in pinned if "--hash=sha256:" not in entry] == []
