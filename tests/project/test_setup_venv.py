"""The installer behind `make`: what it does when, with a stand-in for the interpreter that only
notes what it is asked."""

import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]

# Answers -V, makes a venv that holds a copy of itself, notes every pip call, and fails in pip
# while the file `fail` exists.
STAND_IN = """#!/bin/sh
case "$*" in
  -V) echo "Python $(cat "{state}/version")" ;;
  *ensurepip*) exit 0 ;;
  "-m venv "*) mkdir -p "$3/bin"; cp "$0" "$3/bin/python"; echo venv >> "{state}/calls" ;;
  *pip*install*) echo "${{*#*install }}" >> "{state}/calls"; [ ! -e "{state}/fail" ] ;;
  *) exit 3 ;;
esac
"""


class Clone:
    """A clone with two packages, and the stand-in."""

    def __init__(self, folder: Path) -> None:
        self.state = folder / "state"
        self.root = folder / "clone"
        self.python = folder / "python"
        self.path = "/usr/bin:/bin"
        self.state.mkdir()
        (self.root / ".ci").mkdir(parents=True)
        shutil.copy2(ROOT / ".ci" / "setup-venv", self.root / ".ci")
        (self.root / "requirements.lock").write_text("numpy==2.0.0\n")
        for name in ("first", "second"):
            (self.root / "src" / name).mkdir(parents=True)
            (self.root / "src" / name / "setup.py").write_text(f"# {name}\n")
            (self.root / "src" / name / "setup.cfg").write_text("")
        self.python.write_text(STAND_IN.format(state=self.state))
        self.python.chmod(0o755)
        self.version("3.12.3")

    def version(self, version: str) -> None:
        (self.state / "version").write_text(version)

    def install(self) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [self.root / ".ci" / "setup-venv"],
            env={"PATH": self.path, "PYTHON": str(self.python)},
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
        return [line.replace("--quiet ", "") for line in lines]


LOCK = "--requirement requirements.lock"
PACKAGES = "--no-deps --no-build-isolation --editable src/first --editable src/second"


@pytest.fixture
def clone(tmp_path: Path) -> Clone:
    return Clone(tmp_path)


@pytest.fixture
def installed(clone: Clone) -> Clone:
    assert clone.install().returncode == 0
    clone.calls()
    return clone


def test_a_first_call_installs_everything(clone: Clone) -> None:
    done = clone.install()
    assert (done.returncode, done.stderr) == (0, "")
    assert clone.calls() == ["venv", LOCK, PACKAGES]


def test_a_second_call_does_nothing(installed: Clone) -> None:
    done = installed.install()
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    assert installed.calls() == []


def test_a_new_lock_file_is_installed_in_place(installed: Clone) -> None:
    (installed.root / "requirements.lock").write_text("numpy==2.1.0\n")
    installed.install()
    assert installed.calls() == [LOCK, PACKAGES]
    installed.install()
    assert installed.calls() == []


def test_a_changed_or_new_package_is_installed(installed: Clone) -> None:
    (installed.root / "src" / "first" / "setup.py").write_text("# another\n")
    installed.install()
    assert installed.calls() == [PACKAGES]
    (installed.root / "src" / "third").mkdir()
    (installed.root / "src" / "third" / "setup.py").write_text("# third\n")
    installed.install()
    assert installed.calls() == [PACKAGES + " --editable src/third"]


def test_an_interrupted_first_install_is_made_anew(clone: Clone) -> None:
    (clone.state / "fail").touch()
    assert clone.install().returncode != 0
    assert clone.calls() == ["venv", LOCK]
    (clone.state / "fail").unlink()
    assert clone.install().returncode == 0
    assert clone.calls() == ["venv", LOCK, PACKAGES]


def test_an_interrupted_update_is_made_anew(installed: Clone) -> None:
    (installed.state / "fail").touch()
    (installed.root / "requirements.lock").write_text("numpy==2.1.0\n")
    assert installed.install().returncode != 0
    (installed.state / "fail").unlink()
    installed.calls()
    installed.install()
    assert installed.calls() == ["venv", LOCK, PACKAGES]


def test_an_interrupted_deletion_is_made_anew(installed: Clone) -> None:
    # Another interpreter is asked for, and rm ends before it has deleted anything.
    python = installed.root / ".venv" / "bin" / "python"
    answers = python.read_text()
    python.write_text(answers.replace('$(cat "' + str(installed.state) + '/version")', "3.11.9"))
    rm = installed.root.parent / "rm"
    rm.write_text('#!/bin/sh\ncase "$*" in -rf*) exit 1 ;; *) exec /bin/rm "$@" ;; esac\n')
    rm.chmod(0o755)
    installed.path = f"{rm.parent}:/usr/bin:/bin"
    assert installed.install().returncode != 0
    python.write_text(answers)
    installed.path = "/usr/bin:/bin"
    installed.calls()
    installed.install()
    assert installed.calls() == ["venv", LOCK, PACKAGES]


def test_a_moved_clone_is_installed_anew(installed: Clone) -> None:
    installed.root = installed.root.rename(installed.root.with_name("moved"))
    installed.install()
    assert installed.calls() == ["venv", LOCK, PACKAGES]


def test_another_interpreter_is_installed_anew(installed: Clone) -> None:
    # The venv's own stand-in would follow the version file, so it gets an answer of its own.
    venv_python = installed.root / ".venv" / "bin" / "python"
    venv_python.write_text(
        venv_python.read_text().replace('$(cat "' + str(installed.state) + '/version")', "3.11.9")
    )
    installed.install()
    assert installed.calls() == ["venv", LOCK, PACKAGES]


@pytest.mark.parametrize("version", ["3.10.13", "3.13.0", "2.7.18"])
def test_an_unsupported_interpreter_is_one_clear_line(clone: Clone, version: str) -> None:
    clone.version(version)
    done = clone.install()
    assert done.returncode == 1
    assert (
        done.stderr
        == f"isogal: Isogal needs Python 3.11 or 3.12; PYTHON={clone.python} is Python {version}\n"
    )
    assert clone.calls() == []


def test_a_missing_interpreter_is_one_clear_line(clone: Clone) -> None:
    clone.python = Path("no-such-python")
    done = clone.install()
    assert (done.returncode, done.stderr) == (
        1,
        "isogal: Isogal needs Python 3.11 or 3.12; PYTHON=no-such-python is not found\n",
    )
