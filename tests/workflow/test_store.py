"""When an output counts as finished, and what is done about one that was changed since."""

from __future__ import annotations

import json
import multiprocessing
from pathlib import Path

import pytest

from knotflow.workflow import durable
from knotflow.workflow.errors import DamagedStageError
from knotflow.workflow.store import CLOCK, RECORD, Clock, StageFolder


@pytest.fixture
def folder(tmp_path: Path) -> StageFolder:
    """A stage's folder with two files in its partial output."""
    folder = StageFolder(tmp_path, "toy", "0123")
    (folder.partial / "sub").mkdir(parents=True)
    (folder.partial / "a").write_text("aa")
    (folder.partial / "sub" / "b").write_text("bbb")
    Clock(folder.partial).save()
    return folder


RECORDED = {"stage": "toy", "signature": "0123"}


def test_finishing(folder: StageFolder) -> None:
    assert folder.state() == "resume"
    folder.finish(dict(RECORDED))
    assert folder.state() == "done"
    assert folder.record() == RECORDED | {"files": {"a": 2, "sub/b": 3}}
    assert not folder.partial.exists()
    assert sorted(path.name for path in folder.final.iterdir()) == ["a", RECORD, "sub"]


def test_outputs_are_on_the_disk_before_the_record_says_so(
    folder: StageFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    synced: list[Path] = []
    sync_entry = durable.sync_entry

    def watched(path: Path) -> None:
        if not path.name.startswith(durable.TEMPORARY):
            assert not (folder.partial / RECORD).exists() or path.is_dir()
            synced.append(path)
        sync_entry(path)

    monkeypatch.setattr(durable, "sync_entry", watched)
    folder.finish(dict(RECORDED))
    assert {folder.partial / "a", folder.partial / "sub" / "b", folder.partial / "sub"} < {*synced}
    assert synced[-2:] == [folder.partial, folder.final.parent]


def test_the_record_is_the_runners(folder: StageFolder) -> None:
    (folder.partial / RECORD).write_text("{}")
    with pytest.raises(FileExistsError, match=f"toy wrote {RECORD}"):
        folder.finish(dict(RECORDED))
    assert folder.state() == "resume"


def test_a_missing_file_is_refused(folder: StageFolder) -> None:
    folder.finish(dict(RECORDED))
    (folder.final / "sub" / "b").unlink()
    with pytest.raises(DamagedStageError, match=rf"sub/b \(missing\).*Delete {folder.final} and"):
        folder.record()


def test_a_cut_file_is_refused(folder: StageFolder) -> None:
    folder.finish(dict(RECORDED))
    (folder.final / "a").write_text("a")
    with pytest.raises(DamagedStageError, match=r"a \(1 bytes, not 2\)"):
        folder.record()


def test_a_missing_or_foreign_record_is_refused(folder: StageFolder) -> None:
    folder.finish(dict(RECORDED))
    (folder.final / RECORD).write_text("{")
    with pytest.raises(DamagedStageError, match="missing or unreadable"):
        folder.record()
    (folder.final / RECORD).write_text(json.dumps(RECORDED | {"signature": "9", "files": {}}))
    with pytest.raises(DamagedStageError, match="holds toy/9"):
        folder.record()
    (folder.final / RECORD).unlink()
    with pytest.raises(DamagedStageError, match="missing or unreadable"):
        folder.record()


def test_looking_at_an_output_may_leave_files(folder: StageFolder) -> None:
    folder.finish(dict(RECORDED))
    (folder.final / "notes.txt").touch()
    assert folder.record()["files"] == {"a": 2, "sub/b": 3}


def test_complete_but_not_renamed(folder: StageFolder) -> None:
    assert folder.recover() is None
    record = folder.finish(dict(RECORDED))
    folder.final.rename(folder.partial)  # as if killed just before the renaming
    assert folder.recover() == record
    assert folder.state() == "done"


def test_time_adds_up_over_attempts(tmp_path: Path) -> None:
    (tmp_path / CLOCK).write_text(json.dumps({"seconds": 100.0, "pid": 7, "host": "here"}))
    clock = Clock(tmp_path)
    assert clock.owner() == "process 7 on here"
    assert clock.seconds() >= 100.0
    clock.save()
    assert Clock(tmp_path).earlier >= 100.0


def hold(folder: StageFolder, held, release) -> None:  # type: ignore[no-untyped-def]
    """Holds the folder's lock until told to let go."""
    with folder.lock():
        Clock(folder.partial).save()
        held.set()
        release.wait(30)


def test_a_second_process_waits_and_says_so(
    folder: StageFolder, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    context = multiprocessing.get_context("fork")
    held, release = context.Event(), context.Event()
    other = context.Process(target=hold, args=(folder, held, release))
    other.start()
    try:
        assert held.wait(30)
        owner = Clock.owner

        def owner_then_release(clock: Clock) -> str:
            release.set()  # asked for only when the lock was found taken
            return owner(clock)

        monkeypatch.setattr(Clock, "owner", owner_then_release)
        with folder.lock():
            pass
    finally:
        release.set()
        other.join()
    assert f"waiting for process {other.pid} on " in capfd.readouterr().out


def test_a_killed_process_holds_no_lock(
    folder: StageFolder, capfd: pytest.CaptureFixture[str]
) -> None:
    context = multiprocessing.get_context("fork")
    held, release = context.Event(), context.Event()
    other = context.Process(target=hold, args=(folder, held, release))
    other.start()
    assert held.wait(30)
    other.kill()
    other.join()
    with folder.lock():
        pass
    assert "waiting" not in capfd.readouterr().out
