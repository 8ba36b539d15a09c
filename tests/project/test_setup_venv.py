"""What `make` installs when, with a stand-in interpreter that notes what it is asked."""

import shutil
import subprocess
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]

# Answers -V, makes a venv that holds a copy of itself and notes every call of pip and of uv.
# While the file `fail` exists, both fail; with `no uv` uv cannot be had, with `bad uv` it fails.
STAND_IN = """#!/bin/sh
note() {{ echo "$1" >> "{state}/calls"; }}
case "$*" in
  -V) echo "Python $(cat "{state}/version")" ;;
  *ensurepip*) exit 0 ;;
  "-m venv "*) mkdir -p "$3/bin"; cp "$0" "$3/bin/python"; note venv ;;
  *pip*install*requirements-installer.lock) note "get uv"; [ ! -e "{state}/no uv" ] ;;
  .ci/uv.py*install*)
    note "uv ${{*#*--no-deps }}"; [ ! -e "{state}/bad uv" ] && [ ! -e "{state}/fail" ] ;;
  *pip*install*) note "pip ${{*#*--no-deps }}"; [ ! -e "{state}/fail" ] ;;
  *) exit 3 ;;
esac
"""


class Clone:
    """A clone with two packages, and the stand-in."""

    def __init__(self, folder: Path) -> None:
        self.state = folder / "state"
        self.root = folder / "clone"
        self.python = folder / "python"
        self.state.mkdir()
        (self.root / ".ci").mkdir(parents=True)
        shutil.copy2(ROOT / ".ci" / "setup-venv", self.root / ".ci")
        (self.root / "requirements.lock").write_text("numpy==2.0.0\n")
        (self.root / "requirements-development.lock").write_text("pytest==9.2.0\n")
        for name in ("first", "second"):
            (self.root / "src" / name).mkdir(parents=True)
            (self.root / "src" / name / "setup.py").write_text(f"# {name}\n")
            (self.root / "src" / name / "setup.cfg").write_text("")
        self.python.write_text(STAND_IN.format(state=self.state))
        self.python.chmod(0o755)
        self.version("3.12.3")

    def version(self, version: str) -> None:
        (self.state / "version").write_text(version)

    def install(self, *words: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [self.root / ".ci" / "setup-venv", *words],
            env={"PATH": "/usr/bin:/bin", "PYTHON": str(self.python)},
            capture_output=True,
            text=True,
            timeout=60,
            check=False,
        )

    def calls(self) -> list[str]:
        """Return what was called since the last question."""
        log = self.state / "calls"
        lines = log.read_text().splitlines() if log.exists() else []
        log.unlink(missing_ok=True)
        return lines


LOCK = "--requirement requirements.lock"
TOOLS = "--requirement requirements-development.lock"
PACKAGES = "--no-build-isolation --editable src/first --editable src/second"
EVERYTHING = ["venv", "get uv", f"uv {LOCK}", f"uv {PACKAGES}"]


@pytest.fixture
def clone(tmp_path: Path) -> Clone:
    return Clone(tmp_path)


@pytest.fixture
def installed(clone: Clone) -> Clone:
    assert clone.install().returncode == 0
    clone.calls()
    return clone


def moved(clone: Clone) -> None:
    clone.root = clone.root.rename(clone.root.with_name("moved"))


def of_another_python(clone: Clone) -> None:
    # the venv's own stand-in would follow the version file, so it gets an answer of its own
    python = clone.root / ".venv" / "bin" / "python"
    version = f'$(cat "{clone.state}/version")'
    python.write_text(python.read_text().replace(version, "3.11.9"))


def with_a_third_package(clone: Clone) -> None:
    (clone.root / "src" / "third").mkdir()
    (clone.root / "src" / "third" / "setup.py").write_text("# third\n")


def with_another_lock(clone: Clone) -> None:
    (clone.root / "requirements.lock").write_text("numpy==2.1.0\n")


def with_another_package(clone: Clone) -> None:
    (clone.root / "src" / "first" / "setup.py").write_text("# another\n")


CHANGES = {
    "nothing": (lambda clone: None, []),
    "lock file": (with_another_lock, ["get uv", f"uv {LOCK}"]),
    "package": (with_another_package, ["get uv", f"uv {PACKAGES}"]),
    "new package": (with_a_third_package, ["get uv", f"uv {PACKAGES} --editable src/third"]),
    "place": (moved, EVERYTHING),
    "interpreter": (of_another_python, EVERYTHING),
}


@pytest.mark.parametrize("what", CHANGES)
def test_only_what_has_changed_is_installed_and_only_once(installed: Clone, what: str) -> None:
    change, calls = CHANGES[what]
    installed.install("development")
    installed.calls()
    change(installed)
    assert installed.install().returncode == 0
    assert installed.calls() == calls
    done = installed.install()
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    assert installed.calls() == []
    # the tools are gone with their venv
    installed.install("development")
    assert installed.calls() == (["get uv", f"uv {TOOLS}"] if calls == EVERYTHING else [])


@pytest.mark.parametrize(("state", "calls"), [("no uv", []), ("bad uv", [f"uv {LOCK} {TOOLS}"])])
def test_pip_installs_where_uv_does_not(clone: Clone, state: str, calls: list[str]) -> None:
    (clone.state / state).touch()
    done = clone.install("development")
    assert (done.returncode, done.stderr) == (0, "")
    pip = [f"pip {LOCK} {TOOLS}", f"pip {PACKAGES}"]
    assert clone.calls() == ["venv", "get uv", *calls, *pip]


@pytest.mark.parametrize("first", [True, False], ids=["first install", "update"])
def test_what_was_interrupted_is_made_anew(clone: Clone, first: bool) -> None:
    if not first:
        clone.install()
        with_another_lock(clone)
    (clone.state / "fail").touch()
    assert clone.install().returncode != 0
    (clone.state / "fail").unlink()
    clone.calls()
    clone.install()
    assert clone.calls() == EVERYTHING


def test_two_calls_at_once_wait_for_each_other(clone: Clone) -> None:
    with ThreadPoolExecutor(2) as pool:
        both = [pool.submit(clone.install) for _ in range(2)]
    assert [call.result().returncode for call in both] == [0, 0]
    assert clone.calls() == EVERYTHING


@pytest.mark.parametrize(
    ("version", "words", "says"),
    [
        ("3.10.13", (), "Isogal needs Python 3.11 or 3.12; PYTHON={} is Python 3.10.13\n"),
        ("3.13.0", (), "Isogal needs Python 3.11 or 3.12; PYTHON={} is Python 3.13.0\n"),
        (None, (), "Isogal needs Python 3.11 or 3.12; PYTHON={} is not found\n"),
        ("3.12.3", ("develop",), "setup-venv knows the word development, not develop\n"),
    ],
)
def test_what_will_not_do_is_one_clear_line(
    clone: Clone, version: str | None, words: tuple[str, ...], says: str
) -> None:
    if version is None:
        clone.python = Path("no-such-python")
    else:
        clone.version(version)
    done = clone.install(*words)
    assert done.returncode == 1
    assert done.stderr.startswith("isogal: ") and done.stderr.count("\n") == 1
    assert done.stderr.endswith(says.format(clone.python))
    assert clone.calls() == []
