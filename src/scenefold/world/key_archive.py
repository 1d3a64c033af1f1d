"""Keys taken out of a profile and put back: backups, and a user's identity on another computer (docs/how-to/keep-your-keys.md).

A **backup** holds all of a profile but the keys of nodes, whose disks are worth nothing without them anyway, and the cluster's log, which
the nodes have: who the cluster is, its authority (with its key where the profile has it), its users, its scenes. An **identity** holds who
the cluster is and one user. Both are one file of text under a passphrase of its own (crypto/passphrases.py, crypto/archives.py).

What comes in is never written over what is there, and a user's keys come in locked, under the passphrase of the file.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from scenefold.base.errors import LocalFault
from scenefold.crypto import make_private_folder, write_secret
from scenefold.crypto.archives import ARCHIVE_BYTES_MAX, is_safe_name, pack_archive, unpack_archive
from scenefold.crypto.drafts import name_folder, sync_folder
from scenefold.crypto.passphrases import is_locked, lock, unlock
from scenefold.crypto.secret_folder import LOCKED_FILE, SecretFolder
from scenefold.crypto.secrets_on_disk import SECRET_BYTES_MAX
from scenefold.world.folder_lock import alone_in
from scenefold.world.leftovers import draft_of, sweep_profile
from scenefold.world.log_file import LOG_FILE
from scenefold.world.toml_files import read_settings_toml

BACKUP, IDENTITY = "backup", "identity"
_IMPORT = ".import"
_SETTINGS = "cluster.toml"
_USERS, _AUTHORITY, _SCENES = "users", "authority", "scenes"
_ROOMS = (_SETTINGS, _USERS, _AUTHORITY, _SCENES)
"""What a file of keys holds. All else in a profile is of one computer, or asked of the nodes again."""
_AUTHORITY_KEY = "authority/key.pem"
_PUBLIC = ("certificate.pem",)
"""Files of a user's folder that are no secrets, and stay as they are when the rest is locked."""

Token = Callable[[int], bytes]


@dataclass(frozen=True, slots=True)
class Taken:
    """What a file of keys holds, or what was put back from one."""

    kind: str
    cluster: str
    users: tuple[str, ...]
    scenes: int
    has_authority_key: bool

    @classmethod
    def of(cls, kind: str, files: Mapping[str, bytes], cluster: str) -> Taken:
        users = sorted({name.split("/")[1] for name in files if name.startswith(f"{_USERS}/")})
        scenes = sum(name.startswith(f"{_SCENES}/") for name in files)
        return cls(kind, cluster, tuple(users), scenes, _AUTHORITY_KEY in files)


def lock_user(folder: SecretFolder, passphrase: str, token: Token) -> None:
    """Lock a user's keys, or give them another passphrase. UsageFault if it is too short, LocalFault if a file there is none that can be locked."""
    folder.names()  # Whoever is to be asked is asked before others have to wait.
    with alone_in(folder.path):
        plain = tuple(name for name in _files_in(folder.path) if name not in (*_PUBLIC, LOCKED_FILE))
        stray = next((name for name in plain if not is_safe_name(name)), None)
        if stray is not None:
            raise LocalFault(f"a file there is no key, and cannot be locked: {stray}", where=str(folder.path), remedy="move it away")
        folder.lock(folder.names() if folder.is_locked else plain, passphrase, token)
    sweep_profile(folder.path.parent.parent)


def unlock_user(folder: SecretFolder) -> None:
    """Leave a user's keys plain; WrongPassphrase."""
    folder.names()
    with alone_in(folder.path):
        folder.unlock()
    sweep_profile(folder.path.parent.parent)


def export_keys(profile: Path, target: Path, passphrase: str, token: Token, ask: Callable[[str], str], *, user: str | None) -> Taken:
    """Write a backup of a profile to `target`, or with `user` that user's identity. LocalFault if the file exists or a key is unreadable."""
    if target.exists():
        raise LocalFault("the file exists already", where=str(target), remedy="choose another name, or remove it")
    files = dict(_taken_from(profile, ask, user))
    stray = next((name for name in files if not _has_place(name)), None)
    if stray is not None:
        raise LocalFault(f"a file of the profile cannot be put back: {stray}", where=str(profile), remedy="move it away")
    kind = BACKUP if user is None else IDENTITY
    if user is not None and not any(name.startswith(f"{_USERS}/{user}/") for name in files):
        raise LocalFault(f"the profile has no user {user}", where=str(profile), remedy="see users/ in it")
    archive = pack_archive(kind, files)
    locked = lock(archive, passphrase, token)
    # Whoever finds out on the day when it is needed has lost everything.
    if _opened(locked, passphrase, str(target)) != (kind, files):
        raise LocalFault("what was locked does not open again", where=str(target), remedy="report this; no file was written")
    write_secret(target, locked)
    return Taken.of(kind, files, _cluster_of(profile))


def check_keys_file(source: Path) -> None:
    """LocalFault if no keys are to be had from a file, whatever the passphrase: asked before anybody types one."""
    _check_locked(_content(source, ARCHIVE_BYTES_MAX), str(source))


def import_keys(source: Path, profile: Path, passphrase: str, token: Token) -> Taken:
    """Put back what `export_keys` wrote, into a profile of the same cluster or a new one.

    LocalFault if the file is damaged, the profile is of another cluster, or a key there differs; WrongPassphrase. Then nothing is changed.
    """
    # Locked, so it may come on any disk, with any mode.
    kind, files = _opened(_content(source, ARCHIVE_BYTES_MAX), passphrase, str(source))
    with draft_of(profile, _IMPORT) as draft:
        for name, content in files.items():
            if _room(name) != _USERS or Path(name).name in _PUBLIC:
                make_private_folder((draft / name).parent)
                write_secret(draft / name, content)
        taken = Taken.of(kind, files, _cluster_of(draft))
        for user in taken.users:
            make_private_folder(draft / _USERS / user)
            SecretFolder(draft / _USERS / user).keep_locked(_secrets_of(user, files), passphrase, token)
        make_private_folder(draft / _SCENES)
        _merge(draft, profile)
    return taken


def _check_locked(data: bytes, where: str) -> None:
    if not is_locked(data):
        raise LocalFault("the file holds no keys", where=where, remedy="give one that `scenectl key backup` or `key export` wrote")


def _opened(data: bytes, passphrase: str, where: str) -> tuple[str, dict[str, bytes]]:
    """The kind and the files of a file of keys; LocalFault for one that cannot be put back, WrongPassphrase."""
    _check_locked(data, where)
    kind, files = unpack_archive(unlock(data, passphrase, where), (BACKUP, IDENTITY), where)
    files.pop(LOG_FILE, None)  # Earlier versions took it along.
    if len(data) > ARCHIVE_BYTES_MAX or _SETTINGS not in files or not all(_has_place(name) for name in files):
        raise LocalFault("the file of keys is damaged", where=where, remedy="restore it from another copy")
    return kind, files


def _has_place(name: str) -> bool:
    """Whether a file of this name is put back."""
    if _room(name) == _USERS:
        return len(name.split("/")) == len(("users", "name", "file")) and not name.endswith(f"/{LOCKED_FILE}")
    return _room(name) in _ROOMS


def _secrets_of(user: str, files: Mapping[str, bytes]) -> dict[str, bytes]:
    own = {name.rpartition("/")[2]: content for name, content in files.items() if name.startswith(f"{_USERS}/{user}/")}
    return {name: content for name, content in own.items() if name not in _PUBLIC}


def _merge(draft: Path, profile: Path) -> None:
    if not profile.exists() or (profile.is_dir() and not any(profile.iterdir())):
        name_folder(draft, profile)
        return
    if not (profile / _SETTINGS).exists():
        raise LocalFault("the place is taken by something else", where=str(profile), remedy="choose another folder")
    ours, theirs = (read_settings_toml(folder / _SETTINGS).get("cluster_id") for folder in (profile, draft))
    if ours != theirs:
        raise LocalFault(
            "the profile is of another cluster than the keys", where=str(profile), remedy="name a profile that does not exist yet"
        )
    users = _folders_in(draft / _USERS)
    new = [user for user in users if not (profile / _USERS / user).exists()]
    for user in users:
        # Some of several may be there because an earlier import was interrupted among them.
        if user not in new and not (new and _is_same(draft / _USERS / user, profile / _USERS / user)):
            raise LocalFault(f"the profile has keys of {user} already", where=str(profile), remedy="move them away, or name a new profile")
    for room in (_SCENES, _AUTHORITY):
        make_private_folder(profile / room)
        for name in _files_in(draft / room):
            target = profile / room / name
            if not target.exists():
                (draft / room / name).rename(target)
        sync_folder(profile / room)
    # Last: as long as they are missing, whoever was interrupted may repeat all of it.
    make_private_folder(profile / _USERS)
    for user in new:
        name_folder(draft / _USERS / user, profile / _USERS / user)


def _is_same(one: Path, other: Path) -> bool:
    return all((one / name).exists() and (other / name).exists() and _content(one / name) == _content(other / name) for name in _PUBLIC)


def _taken_from(profile: Path, ask: Callable[[str], str], user: str | None) -> Iterator[tuple[str, bytes]]:
    for path in sorted(profile.rglob("*")):
        name = path.relative_to(profile).as_posix()
        if not path.is_file() or not is_safe_name(name) or _room(name) not in _ROOMS:
            continue
        if user is not None and (name == _AUTHORITY_KEY or _room(name) == _SCENES or not _is_of(user, name)):
            continue
        if path.name == LOCKED_FILE and _room(name) == _USERS:
            opened = SecretFolder(path.parent, ask)
            for secret in opened.names():
                yield f"{Path(name).parent.as_posix()}/{secret}", opened.read(secret)
        elif not ((path.parent / LOCKED_FILE).exists() and path.name not in _PUBLIC):
            yield name, _content(path)


def _is_of(user: str, name: str) -> bool:
    return _room(name) != _USERS or name.split("/")[1] == user


def _content(path: Path, bytes_max: int = SECRET_BYTES_MAX) -> bytes:
    try:
        with path.open("rb") as file:
            data = file.read(bytes_max + 1)
    except OSError as error:
        raise LocalFault(f"cannot read the file: {error.strerror}", where=str(path), remedy="check its name and permissions") from error
    if len(data) > bytes_max:
        raise LocalFault("far too large for a file of keys", where=str(path), remedy="check its name")
    return data


def _room(name: str) -> str:
    return name.split("/", maxsplit=1)[0]


def _cluster_of(profile: Path) -> str:
    return str(read_settings_toml(profile / _SETTINGS).get("name", ""))


def _files_in(folder: Path) -> tuple[str, ...]:
    """Without locks, drafts, and what else nobody is shown."""
    names = (path.name for path in folder.iterdir() if path.is_file()) if folder.is_dir() else ()
    return tuple(sorted(name for name in names if not name.startswith(".")))


def _folders_in(folder: Path) -> tuple[str, ...]:
    return tuple(sorted(path.name for path in folder.iterdir() if path.is_dir())) if folder.is_dir() else ()
