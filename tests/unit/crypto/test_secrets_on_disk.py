"""If this fails, another user of the machine can read a key, or half a key is taken for a whole one."""

from __future__ import annotations

import os
import stat
from collections.abc import Callable
from pathlib import Path

import pytest

from scenefold.base.errors import LocalFault
from scenefold.crypto import make_private_folder, read_secret, write_secret
from scenefold.crypto.secrets_on_disk import read_certificate


@pytest.fixture
def open_umask() -> object:
    before = os.umask(0)
    yield
    os.umask(before)


@pytest.mark.usefixtures("open_umask")
def test_private_whatever_the_umask(tmp_path: Path) -> None:
    folder = tmp_path / "a" / "b"
    make_private_folder(folder)
    write_secret(folder / "key", b"secret")
    assert [path.stat().st_mode & 0o777 for path in (tmp_path / "a", folder, folder / "key")] == [0o700, 0o700, 0o600]
    assert read_secret(folder / "key") == b"secret"


def test_a_file_is_private_before_it_has_content(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    modes: list[int] = []

    def watch(handle: int) -> None:
        modes.append(os.fstat(handle).st_mode & 0o777)

    monkeypatch.setattr(os, "fsync", watch)
    write_secret(tmp_path / "key", b"secret")
    assert modes[0] == 0o600


@pytest.mark.parametrize("mode", [0o640, 0o604, 0o660, 0o644, 0o601, 0o777])
def test_an_exposed_key_is_refused(tmp_path: Path, mode: int) -> None:
    path = tmp_path / "key"
    write_secret(path, b"secret")
    path.chmod(mode)
    with pytest.raises(LocalFault, match="open to others") as caught:
        read_secret(path)
    assert "chmod 600" in caught.value.remedy
    assert str(path) in str(caught.value)


@pytest.mark.parametrize("read", [read_secret, read_certificate])
def test_what_belongs_to_another_user_is_refused_and_what_is_the_systems_is_not(
    tmp_path: Path, read: Callable[[Path], bytes], monkeypatch: pytest.MonkeyPatch
) -> None:
    path, fstat = tmp_path / "key", os.fstat
    write_secret(path, b"secret")

    def owned_by(owner: int) -> Callable[[int], os.stat_result]:
        def found(handle: int) -> os.stat_result:
            fields = list(fstat(handle))
            fields[stat.ST_UID] = owner
            return os.stat_result(fields)

        return found

    monkeypatch.setattr(os, "geteuid", lambda: 1000)
    for owner in (1000, 0):
        monkeypatch.setattr(os, "fstat", owned_by(owner))
        assert read(path) == b"secret"
    monkeypatch.setattr(os, "fstat", owned_by(1001))
    with pytest.raises(LocalFault, match=r"belongs to another user \(id 1001\)") as caught:
        read(path)
    assert "chown 1000" in caught.value.remedy and caught.value.remedy.startswith("run it as that user")
    monkeypatch.setattr(os, "geteuid", lambda: 0)
    with pytest.raises(LocalFault, match=r"belongs to another user \(id 1001\)") as caught:
        read(path)
    assert "#1001" in caught.value.remedy and "chown" not in caught.value.remedy, "its user would be locked out"


def test_what_is_no_file_is_refused_and_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe", 0o600)
    (tmp_path / "link").symlink_to(tmp_path / "pipe")
    for path in (tmp_path / "pipe", tmp_path / "link", Path("/dev/null")):
        with pytest.raises(LocalFault, match="is no file"):
            read_secret(path)


def test_nothing_is_overwritten_unless_asked(tmp_path: Path) -> None:
    path = tmp_path / "key"
    write_secret(path, b"first")
    with pytest.raises(LocalFault, match="exists already"):
        write_secret(path, b"second")
    assert read_secret(path) == b"first"
    write_secret(path, b"third", replace=True)
    assert read_secret(path) == b"third"
    assert [entry.name for entry in tmp_path.iterdir()] == ["key"], "a draft was left behind"


def test_a_failed_write_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(_handle: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(LocalFault, match="No space left"):
        write_secret(tmp_path / "key", b"secret")
    assert list(tmp_path.iterdir()) == []


def test_missing_files_and_folders(tmp_path: Path) -> None:
    with pytest.raises(LocalFault, match="missing"):
        read_secret(tmp_path / "key")
    with pytest.raises(LocalFault, match="cannot write"):
        write_secret(tmp_path / "nowhere" / "key", b"")
    with pytest.raises(LocalFault, match="cannot read"):
        read_secret(tmp_path)
    (tmp_path / "file").touch()
    for folder in (tmp_path / "file", tmp_path / "file" / "below"):
        with pytest.raises(LocalFault, match="cannot make the folder"):
            make_private_folder(folder)


def test_a_wrong_path_is_not_read_into_memory(tmp_path: Path) -> None:
    path = tmp_path / "movie"
    path.touch(0o600)
    os.truncate(path, 1 << 40)
    with pytest.raises(LocalFault, match="too large"):
        read_secret(path)
