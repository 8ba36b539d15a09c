"""Files that killed processes leave behind."""

import fcntl

import pytest

from isogal_ros.graph import running
from isogal_ros.graph.running import shared_memory, sweep_shared_memory


def test_only_new_files_that_nobody_uses_are_deleted(monkeypatch, tmp_path) -> None:
    """One that is just being made is locked when it is looked at."""
    monkeypatch.setattr(running, "SHARED_MEMORY", tmp_path)
    names = ("old", "abandoned", "port7", "used", "being_made")
    files = {name: tmp_path / f"fastrtps_{name}" for name in names}
    for name in ("old", "abandoned", "port7", "used"):
        files[name].touch()
        files[name].with_name(f"fastrtps_{name}_el").touch()
    (tmp_path / "sem.fastrtps_port7_mutex").touch()
    (tmp_path / "something else").touch()
    before = {name for name in shared_memory() if "_old" in name}
    made = tmp_path / "fastrtps_being_made_el"

    def settle(seconds: float) -> None:
        assert seconds == running.SETTLED
        fcntl.flock(lock, fcntl.LOCK_EX)

    monkeypatch.setattr(running.time, "sleep", settle)
    with made.open("wb") as lock, (tmp_path / "fastrtps_used_el").open("rb") as used:
        fcntl.flock(used, fcntl.LOCK_EX)
        sweep_shared_memory(before)
    kept = {"fastrtps_old", "fastrtps_old_el", "fastrtps_used", "fastrtps_used_el"}
    assert {path.name for path in tmp_path.iterdir()} == kept | {made.name, "something else"}
    monkeypatch.setattr(running.time, "sleep", lambda seconds: pytest.fail("waits"))
    sweep_shared_memory(shared_memory())
