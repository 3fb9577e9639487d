import os
import subprocess
import sys

import pytest

from knotflow.workflow.store import TEMPORARY, StageFolder, atomic, remove_abandoned, sizes


def test_atomic_replaces_files_and_folders(tmp_path):
    for text in ("one", "two"):
        with atomic(tmp_path / "folder") as made:
            made.mkdir()
            (made / text).write_text(text)
    assert [path.name for path in (tmp_path / "folder").iterdir()] == ["two"]
    assert [path.name for path in tmp_path.iterdir()] == ["folder"]


def test_a_failed_block_leaves_what_was_there(tmp_path):
    (tmp_path / "file.txt").write_text("old")
    with pytest.raises(RuntimeError), atomic(tmp_path / "file.txt") as made:
        made.write_text("half")
        raise RuntimeError
    assert (tmp_path / "file.txt").read_text() == "old"
    assert [path.name for path in tmp_path.iterdir()] == ["file.txt"]


def test_nothing_written_is_an_error(tmp_path):
    with pytest.raises(FileNotFoundError), atomic(tmp_path / "file.txt"):
        pass


def test_temporaries_of_living_processes_stay(tmp_path):
    done = subprocess.run([sys.executable, "-c", "import os; print(os.getpid())"],
                          capture_output=True, text=True)  # fmt: skip
    dead, alive = int(done.stdout), os.getppid()
    for pid in (dead, alive):
        (tmp_path / f"{TEMPORARY}{pid}-abcd-file").write_text("half")
    remove_abandoned(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == [f"{TEMPORARY}{alive}-abcd-file"]


def test_temporaries_without_a_process_are_removed(tmp_path):
    (tmp_path / ".tmp-checkpoint.pt").touch()
    (tmp_path / "below").mkdir()
    (tmp_path / "below" / ".tmp-x1y2").mkdir()
    remove_abandoned(tmp_path)
    assert [one.name for one in tmp_path.rglob("*")] == ["below"]


def test_nothing_written_leaves_the_folder_that_was_there(tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "kept").touch()
    with pytest.raises(FileNotFoundError), atomic(tmp_path / "out"):
        pass
    assert (tmp_path / "out" / "kept").exists()


def test_a_folder_has_its_final_name_only_once_complete(tmp_path):
    folder = StageFolder(tmp_path, "toy", "abc")
    assert folder.state() == "run"
    folder.partial.mkdir(parents=True)
    (folder.partial / "file").write_text("x")
    assert folder.state() == "resume"
    record = folder.finish({"stage": "toy"})
    assert folder.state() == "done" and not folder.partial.exists()
    assert record["files"] == {"file": 1} == sizes(folder.final)
    assert folder.record() == record


def test_a_folder_that_cannot_be_replaced_stays(tmp_path, monkeypatch):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "kept").touch()

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.replace", full)
    with pytest.raises(OSError, match="No space left"), atomic(tmp_path / "out") as made:
        made.mkdir()
    assert (tmp_path / "out" / "kept").exists()
    assert [path.name for path in tmp_path.iterdir()] == ["out"]
