"""Files that killed processes leave behind."""

import subprocess
import sys

from isogal_ros.graph.shared_memory import abandoned_memory, shared_memory, sweep_shared_memory


def test_only_files_that_nobody_has_open_are_deleted(monkeypatch, tmp_path) -> None:
    monkeypatch.setattr("isogal_ros.graph.shared_memory._FOLDER", tmp_path)
    (tmp_path / "fastrtps_old").touch()
    before = shared_memory()
    (tmp_path / "fastrtps_abandoned").touch()
    (tmp_path / "sem.fastrtps_abandoned_mutex").touch()
    (tmp_path / "fastrtps_used").write_bytes(b"x")
    (tmp_path / "something else").touch()
    code = (
        f"stream = open({str(tmp_path / 'fastrtps_used')!r}); print('open', flush=True); input()"
    )
    command = [sys.executable, "-c", code]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout.readline() == "open\n"
        assert abandoned_memory(before) == {
            "fastrtps_abandoned",
            "sem.fastrtps_abandoned_mutex",
        }
        sweep_shared_memory(before)
        process.communicate("\n")
    assert sorted(entry.name for entry in tmp_path.iterdir()) == [
        "fastrtps_old",
        "fastrtps_used",
        "something else",
    ]
