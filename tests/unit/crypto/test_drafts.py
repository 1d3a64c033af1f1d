"""If this fails, a writer's draft is taken from it, or a name that was given or taken away is not on the disk when we say so."""

from __future__ import annotations

import errno
import fcntl
import os
from pathlib import Path

import pytest

from scenefold.crypto import make_private_folder, write_secret
from scenefold.crypto.drafts import name_folder, new_file, new_folder, sweep_files, sweep_folders
from scenefold.crypto.secret_folder import SecretFolder
from scenefold.crypto.secrets_on_disk import remove_secrets


@pytest.fixture
def synced(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """What was synced, with the names that were there then if it is a folder."""
    seen, fsync = list[str](), os.fsync

    def watched(handle: int) -> None:
        path = Path(f"/proc/self/fd/{handle}").readlink()
        if path.is_dir():
            seen.append(f"{path.name}: {' '.join(sorted(one.name for one in path.iterdir() if one.name[0] != '.'))}")
        fsync(handle)

    monkeypatch.setattr(os, "fsync", watched)
    return seen


def test_a_new_name_is_on_the_disk_before_we_go_on(tmp_path: Path, synced: list[str]) -> None:
    base = tmp_path / "base"
    make_private_folder(base / "users")
    assert synced == [f"{tmp_path.name}: base", "base: users"]
    synced.clear()
    write_secret(base / "users" / "key", b"secret")
    with new_folder(base / "nodes") as draft:
        name_folder(draft, base / "nodes")
    assert synced == ["users: key", "base: nodes users"]


def test_a_key_that_is_gone_stays_gone(tmp_path: Path, synced: list[str]) -> None:
    base = tmp_path / "base"
    make_private_folder(base)
    SecretFolder(base).keep_locked({"a": b"1", "b": b"2"}, "four random words", os.urandom)
    synced.clear()
    SecretFolder(base, lambda _: "four random words").unlock()
    assert synced[-1] == "base: a b"
    synced.clear()
    remove_secrets(base, ("a", "none"))
    assert synced == ["base: b"]


@pytest.mark.parametrize("is_file", [True, False])
def test_a_sweep_that_comes_before_the_lock_takes_only_an_empty_draft(
    tmp_path: Path, is_file: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    flock, swept = fcntl.flock, list[int]()

    def late(handle: int, how: int) -> None:
        if not swept:
            swept.append(handle)
            (sweep_files if is_file else sweep_folders)(tmp_path)
        flock(handle, how)

    monkeypatch.setattr(fcntl, "flock", late)
    with new_file(tmp_path / "key") if is_file else new_folder(tmp_path / "key") as made:
        draft = made[0] if isinstance(made, tuple) else made
        assert swept and draft.exists()
        (sweep_files if is_file else sweep_folders)(tmp_path)
        assert draft.exists()
    assert list(tmp_path.iterdir()) == []


def test_a_disk_without_locks_takes_keys_and_loses_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def unknown(_handle: int, _how: int) -> None:
        raise OSError(errno.EOPNOTSUPP, "not supported")

    monkeypatch.setattr(fcntl, "flock", unknown)
    with new_file(tmp_path / "key") as (draft, _):
        write_secret(tmp_path / "key", b"secret")
        assert draft.exists()
