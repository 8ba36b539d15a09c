"""The container files, as far as they can be checked without a container engine."""

import os
import re
import shlex
import stat
import subprocess
from pathlib import Path

import yaml

from helpers.packages import ROOT, executables

DOCKER = ROOT / "docker"
INSTALLED = re.compile(
    r"^/opt/isogal/install/"
    r"(?:lib/(?P<package>\w+)/(?P<executable>\w+)|share/(?P<share>\w+)/(?P<file>.+))$"
)


def instructions() -> list[tuple[str, str]]:
    """Return (instruction, argument) of the Dockerfile, continuation lines joined, comments left
    out."""
    lines = [
        line
        for line in (DOCKER / "Dockerfile").read_text(encoding="utf-8").splitlines()
        if not line.startswith("#")
    ]
    text = "\n".join(lines).replace("\\\n", " ")
    pairs = [line.partition(" ") for line in text.splitlines() if line.strip()]
    return [(word, rest.strip()) for word, _, rest in pairs]


def test_every_copied_source_exists_and_is_in_the_build_context() -> None:
    ignored = (ROOT / ".dockerignore").read_text(encoding="utf-8").splitlines()
    kept = {line[1:] for line in ignored if line.startswith("!")}
    copied = [
        source
        for word, argument in instructions()
        if word == "COPY" and "--from" not in argument
        for source in [part for part in shlex.split(argument) if not part.startswith("--")][:-1]
    ]
    assert copied
    for source in copied:
        assert (ROOT / source).exists(), source
        assert source.split("/")[0] in kept, source


def test_it_starts_a_launch_file_that_exists_and_not_as_root() -> None:
    last = dict(instructions())
    assert last["USER"] not in ("root", "0")
    command = yaml.safe_load(last["CMD"])
    assert command[:2] == ["ros2", "launch"]
    assert (ROOT / "src" / command[2] / "launch" / command[3]).is_file()
    for name in ("entrypoint.sh", "healthcheck.py"):
        assert (DOCKER / name).stat().st_mode & stat.S_IXUSR


def test_every_node_has_a_service_on_the_loopback_that_runs_what_there_is() -> None:
    known = executables()
    services = yaml.safe_load((DOCKER / "compose.yaml").read_text(encoding="utf-8"))["services"]
    assert {"ins_sim_node", "gravimeter_node", "pmht_mm_node", "ukf_fusion_node"} < set(services)
    for name, service in services.items():
        assert service["network_mode"] == "host"
        assert "ipc" not in service  # no shared memory: the nodes' own profile has none
        assert service["environment"]["ROS_AUTOMATIC_DISCOVERY_RANGE"] == "LOCALHOST"
        checks = ["/opt/isogal/entrypoint.sh", "/opt/isogal/healthcheck.py"]
        assert service["healthcheck"]["test"][1:3] == checks
        found = [match for word in service["command"] if (match := INSTALLED.match(word))]
        assert found[0]["executable"] in known[found[0]["package"]], name
        for match in found[1:]:
            assert (ROOT / "src" / match["share"] / match["file"]).is_file(), match.group()


def test_entrypoint_finds_the_workspace_outside_of_the_image(tmp_path: Path) -> None:
    """The one that is named, the one beside it, merged or not; with neither one line, and no
    command."""
    script = tmp_path / "docker" / "entrypoint.sh"
    script.parent.mkdir()
    script.write_bytes((DOCKER / "entrypoint.sh").read_bytes())

    def run(**environment: str) -> subprocess.CompletedProcess[str]:
        words = ["bash", script, "isogal"]
        env = {"PATH": os.environ["PATH"], **environment}
        return subprocess.run(words, env=env, capture_output=True, text=True, check=False)

    missing = run()
    assert (missing.returncode, missing.stdout) == (2, "")
    assert "no workspace in" in missing.stderr
    for folder, scripts, environment in (
        ("ros2_ws/install", "isogal/lib/isogal", {}),
        ("docker/install", "lib/isogal", {}),
        ("elsewhere", "lib/isogal", {"ISOGAL_INSTALL": str(tmp_path / "elsewhere")}),
    ):
        command = tmp_path / folder / scripts / "isogal"
        command.parent.mkdir(parents=True)
        command.write_text('#!/bin/sh\necho "$WORKSPACE"\n')
        command.chmod(0o755)
        (tmp_path / folder / "setup.bash").write_text(f"export WORKSPACE={folder}\n")
        assert run(**environment).stdout.split() == [folder]
