"""If this fails, two clients of one profile undo what each other has learnt."""

from __future__ import annotations

import fcntl
import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from scenefold.base.errors import LocalFault
from scenefold.base.ids import KeyId
from scenefold.wire import Lockbox
from scenefold.world import folder_lock, keyring, log_file
from scenefold.world.keyring import KeptScene, Keyring
from scenefold.world.log_file import LogFile
from unit.world.test_log_view import RECORDS

SCENE = KeptScene("kitchen", bytes(range(32)), KeyId(1), 0, Lockbox(KeyId(2), b"sealed", bytes(64)))


def between(monkeypatch: pytest.MonkeyPatch, other: Callable[[], object]) -> None:
    """Just before the next one has its turn, another client has had its own, whole."""
    flock = fcntl.flock

    def later(handle: int, how: int) -> None:
        monkeypatch.setattr(folder_lock.fcntl, "flock", flock)
        other()
        flock(handle, how)

    monkeypatch.setattr(folder_lock.fcntl, "flock", later)


def writing(monkeypatch: pytest.MonkeyPatch, module: Any, name: str, folder: Path) -> list[bool]:
    """Of each write, whether nobody else could have one meanwhile."""
    write, alone = getattr(module, name), list[bool]()

    def watched(*args: Any, **named: Any) -> None:
        handle = os.open(folder / folder_lock.LOCK_FILE, os.O_RDWR)
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            alone.append(False)
        except BlockingIOError:
            alone.append(True)
        finally:
            os.close(handle)
        write(*args, **named)

    monkeypatch.setattr(module, name, watched)
    return alone


def test_the_longer_log_stays_whoever_writes_last(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    LogFile(tmp_path).save(RECORDS[:2])
    alone = writing(monkeypatch, log_file, "write_secret", tmp_path)
    between(monkeypatch, lambda: LogFile(tmp_path).save(RECORDS))
    LogFile(tmp_path).save(RECORDS[:5])
    assert LogFile(tmp_path).load()[0].position == len(RECORDS)
    assert alone == [True]


def test_the_newer_position_of_a_scene_stays_whoever_writes_last(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    Keyring(tmp_path).save(SCENE)
    alone = writing(monkeypatch, keyring, "write_toml", tmp_path)
    between(monkeypatch, lambda: Keyring(tmp_path).advance(replace(SCENE, position=9)))
    Keyring(tmp_path).advance(replace(SCENE, position=5))
    assert Keyring(tmp_path).load("kitchen").position == 9
    assert alone == [True]


def test_an_entry_that_was_removed_meanwhile_does_not_come_back(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    Keyring(tmp_path).save(SCENE)
    between(monkeypatch, lambda: Keyring(tmp_path).remove("kitchen"))
    Keyring(tmp_path).advance(replace(SCENE, position=5))
    assert Keyring(tmp_path).names() == []


def test_two_scenes_of_one_name_are_never_both_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    between(monkeypatch, lambda: Keyring(tmp_path).save(SCENE))
    with pytest.raises(LocalFault, match="exists already"):
        Keyring(tmp_path).save(replace(SCENE, genesis=bytes(32)))
    assert Keyring(tmp_path).load("kitchen") == SCENE


def test_a_folder_where_nothing_can_be_written_is_told(tmp_path: Path) -> None:
    with pytest.raises(LocalFault, match="cannot write there"), folder_lock.alone_in(tmp_path / "none"):
        pass


def test_who_is_stopped_while_it_writes_keeps_nobody_waiting_for_ever(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(folder_lock, "LOOK_S", 0.0)
    with folder_lock.alone_in(tmp_path):
        with pytest.raises(LocalFault, match="is not done") as caught, folder_lock.alone_in(tmp_path):
            pass
        assert caught.value.where == str(tmp_path)
    with folder_lock.alone_in(tmp_path):
        pass


def test_who_comes_while_another_writes_has_its_turn_after_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    held = os.open(tmp_path / folder_lock.LOCK_FILE, os.O_RDWR | os.O_CREAT)
    fcntl.flock(held, fcntl.LOCK_EX)
    waits = list[float]()

    def waiting(seconds: float) -> None:
        waits.append(seconds)
        if len(waits) == 3:
            os.close(held)

    monkeypatch.setattr(folder_lock.time, "sleep", waiting)
    with folder_lock.alone_in(tmp_path):
        assert len(waits) == 3
