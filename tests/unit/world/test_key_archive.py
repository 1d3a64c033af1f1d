"""If this fails, somebody who did as the docs say has lost their keys, or they lie about in the clear."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import pytest

from scenefold.base.errors import LocalFault, UsageFault
from scenefold.crypto import passphrases, write_secret
from scenefold.crypto.drafts import LOCK_FILE
from scenefold.crypto.passphrases import WrongPassphrase, unlock
from scenefold.crypto.secret_folder import LOCKED_FILE, SecretFolder, refuse_to_ask
from scenefold.world import key_archive
from scenefold.world.key_archive import BACKUP, IDENTITY, export_keys, import_keys, lock_user
from scenefold.world.log_file import LOG_FILE, LogFile
from scenefold.world.profile import ClusterProfile
from unit.world.test_log_view import RECORDS

PASSPHRASE = "four random words here"
OTHER = "another four words"


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(passphrases, "LOG2_N", 4)


@pytest.fixture(scope="module")
def original(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = ClusterProfile.create(tmp_path_factory.mktemp("profiles") / "studio", "studio", ["127.0.0.2"]).folder
    (folder / "scenes" / "kitchen.toml").write_text('name = "kitchen"\n')
    (folder / "scenes" / "kitchen.toml").chmod(0o600)
    return folder


@pytest.fixture
def profile(original: Path, tmp_path: Path) -> Path:
    shutil.copytree(original, tmp_path / "studio")
    return tmp_path / "studio"


def _files(folder: Path) -> dict[str, bytes]:
    files = (path for path in sorted(folder.rglob("*")) if path.is_file() and path.name != LOCK_FILE)
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in files}


def _secrets_of(profile: Path, user: str = "owner") -> list[str]:
    return [name for name in sorted(_files(profile / "users" / user)) if name != "certificate.pem"]


def _known(_where: str) -> str:
    return PASSPHRASE


def test_a_locked_user_has_nothing_in_the_clear_and_unlocks_to_the_same(profile: Path) -> None:
    before = _files(profile / "users" / "owner")
    lock_user(SecretFolder(profile / "users" / "owner"), PASSPHRASE, os.urandom)
    assert _secrets_of(profile) == [LOCKED_FILE]
    folder = SecretFolder(profile / "users" / "owner", _known)
    assert {name: folder.read(name) for name in folder.names()} == {
        name: data for name, data in before.items() if name != "certificate.pem"
    }
    folder.unlock()
    assert _files(profile / "users" / "owner") == before


def test_the_passphrase_is_changed_in_one_step(profile: Path) -> None:
    owner = profile / "users" / "owner"
    lock_user(SecretFolder(owner), PASSPHRASE, os.urandom)
    lock_user(SecretFolder(owner, _known), OTHER, os.urandom)
    assert SecretFolder(owner, lambda _where: OTHER).names()
    with pytest.raises(WrongPassphrase):
        SecretFolder(owner, _known).names()


def test_what_a_crash_left_beside_a_locked_file_does_not_count_and_goes(profile: Path) -> None:
    owner = profile / "users" / "owner"
    name = _secrets_of(profile)[0]
    content = (owner / name).read_bytes()
    lock_user(SecretFolder(owner), PASSPHRASE, os.urandom)
    (owner / name).write_bytes(b"older")
    assert SecretFolder(owner, _known).read(name) == content
    assert not (owner / name).exists()


def test_a_locked_folder_without_a_passphrase_says_what_to_do(profile: Path) -> None:
    lock_user(SecretFolder(profile / "users" / "owner"), PASSPHRASE, os.urandom)
    with pytest.raises(UsageFault, match=r"locked.*SCENEFOLD_PASSPHRASE"):
        SecretFolder(profile / "users" / "owner").read("signing.seed")


@pytest.mark.parametrize("is_locked", [False, True])
def test_a_backup_brings_everything_back_on_another_machine(profile: Path, tmp_path: Path, is_locked: bool) -> None:
    before = _files(profile)
    if is_locked:
        lock_user(SecretFolder(profile / "users" / "owner"), PASSPHRASE, os.urandom)
    backup = tmp_path / "keys.backup"
    taken = export_keys(profile, backup, OTHER, os.urandom, _known, user=None)
    assert (taken.kind, taken.cluster, taken.users, taken.scenes, taken.has_authority_key) == (BACKUP, "studio", ("owner",), 1, True)
    assert backup.stat().st_mode & 0o777 == 0o600
    backup.chmod(0o644)  # It may come back on any disk.
    back = tmp_path / "elsewhere" / "studio"
    assert import_keys(backup, back, OTHER, os.urandom) == taken
    SecretFolder(back / "users" / "owner", lambda _where: OTHER).unlock()
    assert _files(back) == {name: data for name, data in before.items() if not name.startswith("nodes/")}


@pytest.mark.parametrize("is_large", [False, True])
@pytest.mark.parametrize("user", [None, "owner"])
def test_the_keys_of_a_profile_that_was_used_come_back(profile: Path, tmp_path: Path, user: str | None, is_large: bool) -> None:
    LogFile(profile).save(RECORDS)
    if is_large:
        (profile / LOG_FILE).write_bytes(bytes((1 << 20) + 1))
    (profile / "nodes.log").write_text("what a user keeps here")
    lock_user(SecretFolder(profile / "users" / "owner"), PASSPHRASE, os.urandom)
    file, back = tmp_path / "keys", tmp_path / "back"
    export_keys(profile, file, OTHER, os.urandom, _known, user=user)
    import_keys(file, back, OTHER, os.urandom)
    assert SecretFolder(back / "users" / "owner", lambda _where: OTHER).names()
    assert ClusterProfile.load(back).authority_certificate() and not (back / LOG_FILE).exists()


def test_files_that_hold_the_clusters_log_are_read_all_the_same(profile: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import json

    file, back = tmp_path / "keys", tmp_path / "back"
    export_keys(profile, file, PASSPHRASE, os.urandom, refuse_to_ask, user=None)
    document = json.loads(unlock(file.read_bytes(), PASSPHRASE))
    document["files"][LOG_FILE] = ""
    monkeypatch.setattr(key_archive, "unlock", lambda *_: json.dumps(document).encode())
    import_keys(file, back, PASSPHRASE, os.urandom)
    assert _secrets_of(back) == [LOCKED_FILE] and not (back / LOG_FILE).exists()


def test_no_file_of_keys_is_written_that_could_not_be_put_back(profile: Path, tmp_path: Path) -> None:
    (profile / "users" / "stray").write_text("no folder of a user")
    with pytest.raises(LocalFault, match="cannot be put back: users/stray"):
        export_keys(profile, tmp_path / "keys", PASSPHRASE, os.urandom, refuse_to_ask, user=None)
    assert not (tmp_path / "keys").exists()


def test_an_identity_holds_neither_scenes_nor_the_authoritys_key(profile: Path, tmp_path: Path) -> None:
    file = tmp_path / "me.keys"
    taken = export_keys(profile, file, PASSPHRASE, os.urandom, refuse_to_ask, user="owner")
    assert (taken.kind, taken.scenes, taken.has_authority_key) == (IDENTITY, 0, False)
    back = tmp_path / "laptop"
    import_keys(file, back, PASSPHRASE, os.urandom)
    assert not (back / "authority" / "key.pem").exists() and _secrets_of(back) == [LOCKED_FILE]
    assert ClusterProfile.load(back).authority_certificate()


def test_nothing_that_is_there_is_overwritten(profile: Path, tmp_path: Path) -> None:
    file = tmp_path / "keys.backup"
    export_keys(profile, file, PASSPHRASE, os.urandom, refuse_to_ask, user=None)
    before = _files(profile)
    with pytest.raises(LocalFault, match="has keys of owner already"):
        import_keys(file, profile, PASSPHRASE, os.urandom)
    with pytest.raises(LocalFault, match="exists already"):
        export_keys(profile, file, PASSPHRASE, os.urandom, refuse_to_ask, user=None)
    stranger = ClusterProfile.create(tmp_path / "other", "other", ["127.0.0.3"]).folder
    with pytest.raises(LocalFault, match="another cluster"):
        import_keys(file, stranger, PASSPHRASE, os.urandom)
    assert _files(profile) == before


def test_a_lost_user_and_scene_come_back_into_a_profile_that_has_the_rest(profile: Path, tmp_path: Path) -> None:
    file = tmp_path / "keys.backup"
    export_keys(profile, file, PASSPHRASE, os.urandom, refuse_to_ask, user=None)
    shutil.rmtree(profile / "users" / "owner")
    (profile / "scenes" / "kitchen.toml").unlink()
    (profile / "scenes" / "garden.toml").write_text('name = "garden"\n')
    import_keys(file, profile, PASSPHRASE, os.urandom)
    assert _secrets_of(profile) == [LOCKED_FILE]
    assert sorted(path.name for path in (profile / "scenes").iterdir()) == ["garden.toml", "kitchen.toml"]


class Killed(BaseException):
    """The process ends here, and nothing is cleaned up."""


def _killed(*_: object, **__: object) -> None:
    raise Killed


def _drafts(profile: Path) -> list[Path]:
    return [path for path in profile.parent.iterdir() if path.name.startswith(f".{profile.name}.")]


def test_a_killed_import_leaves_no_key_of_a_user_in_the_clear_and_the_next_one_clears_up(
    profile: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file, back = tmp_path / "keys.backup", tmp_path / "back"
    export_keys(profile, file, PASSPHRASE, os.urandom, refuse_to_ask, user=None)
    plain = [data for name, data in _files(profile / "users" / "owner").items() if name != "certificate.pem"]
    written: list[bytes] = []

    def written_down(path: Path, data: bytes, *, replace: bool = False) -> None:
        written.append(data)
        write_secret(path, data, replace=replace)

    with monkeypatch.context() as dying:
        dying.setattr(key_archive, "write_secret", written_down)
        dying.setattr("scenefold.crypto.secret_folder.write_secret", written_down)
        dying.setattr(key_archive, "_merge", _killed)
        dying.setattr("shutil.rmtree", lambda *_, **__: None)
        with pytest.raises(Killed):
            import_keys(file, back, PASSPHRASE, os.urandom)
    assert len(_drafts(back)) == 1 and written and not [data for data in written if data in plain]
    import_keys(file, back, PASSPHRASE, os.urandom)
    assert not _drafts(back) and _secrets_of(back) == [LOCKED_FILE]


def test_what_others_make_beside_the_profile_stays(profile: Path, tmp_path: Path) -> None:
    file, back = tmp_path / "keys.backup", tmp_path / "back"
    export_keys(profile, file, PASSPHRASE, os.urandom, refuse_to_ask, user=None)
    mine = (".back.0123456789abcdef", ".back.notes", ".background.0123456789ab")
    for name in mine:
        (tmp_path / name).mkdir()
    (tmp_path / ".back.0123456789ab").touch()
    import_keys(file, back, PASSPHRASE, os.urandom)
    assert all((tmp_path / name).is_dir() for name in mine) and (tmp_path / ".back.0123456789ab").is_file()


@pytest.mark.parametrize("renames", range(4))
def test_an_interrupted_import_can_be_repeated(profile: Path, tmp_path: Path, renames: int, monkeypatch: pytest.MonkeyPatch) -> None:
    file, before = tmp_path / "keys.backup", _files(profile)
    shutil.copytree(profile / "users" / "owner", profile / "users" / "zoe")
    export_keys(profile, file, PASSPHRASE, os.urandom, refuse_to_ask, user=None)
    for gone in ("users/owner", "users/zoe"):
        shutil.rmtree(profile / gone)
    for gone in ("authority/key.pem", "scenes/kitchen.toml"):
        (profile / gone).unlink()
    left, rename = [None] * renames, Path.rename

    def dies(path: Path, target: Path) -> Path:
        if not left:
            raise Killed
        left.pop()
        return rename(path, target)

    with monkeypatch.context() as dying:
        dying.setattr(Path, "rename", dies)
        with pytest.raises(Killed):
            import_keys(file, profile, PASSPHRASE, os.urandom)
    import_keys(file, profile, PASSPHRASE, os.urandom)
    for user in ("owner", "zoe"):
        assert _secrets_of(profile, user) == [LOCKED_FILE]
    assert {name: data for name, data in _files(profile).items() if not name.startswith("users/")} == {
        name: data for name, data in before.items() if not name.startswith("users/")
    }


def test_a_wrong_passphrase_and_a_damaged_file_are_told_apart_and_leave_nothing(profile: Path, tmp_path: Path) -> None:
    file = tmp_path / "keys.backup"
    export_keys(profile, file, PASSPHRASE, os.urandom, refuse_to_ask, user=None)
    with pytest.raises(WrongPassphrase):
        import_keys(file, tmp_path / "back", OTHER, os.urandom)
    data = bytearray(file.read_bytes())
    data[len(data) // 2] ^= 1
    file.write_bytes(data)
    with pytest.raises(LocalFault, match="damaged"):
        import_keys(file, tmp_path / "back", PASSPHRASE, os.urandom)
    file.write_bytes(b"name = 3\n")
    with pytest.raises(LocalFault, match="holds no keys"):
        import_keys(file, tmp_path / "back", PASSPHRASE, os.urandom)
    assert {path.name for path in tmp_path.iterdir()} == {"studio", "keys.backup"}


@pytest.mark.parametrize(
    "name",
    [
        "../evil",
        "/etc/passwd",
        "users/../../evil",
        "nodes/127.0.0.2/key.pem",
        "users/a/b/c/d",
        "users/a/b/c",
        "users/owner/locked",
        "users/owner",
        "",
    ],
)
def test_a_file_that_would_lie_elsewhere_is_refused(profile: Path, tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    import json

    file = tmp_path / "keys.backup"
    export_keys(profile, file, PASSPHRASE, os.urandom, refuse_to_ask, user=None)
    document = json.loads(unlock(file.read_bytes(), PASSPHRASE))
    document["files"][name] = ""
    monkeypatch.setattr(key_archive, "unlock", lambda *_: json.dumps(document).encode())
    with pytest.raises(LocalFault, match="damaged"):
        import_keys(file, tmp_path / "back", PASSPHRASE, os.urandom)
    assert not (tmp_path / "back").exists()
