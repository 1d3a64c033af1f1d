"""A folder of key files, as they are or behind a passphrase (specs/04-records.md, Locked files).

Unlocked, each secret is a file of its own. Locked, all of them are one file, `locked`, so that setting, changing and removing the
passphrase is one replacement of one file, and a crash leaves the one or the other. If both are there, `locked` counts: the plain
files are what a crash kept from being removed, and go when the folder is opened next, with drafts that a crash left.

Whoever sets, changes or removes a passphrase must be alone in the folder (its lock file; drafts.py): who opens it meanwhile removes nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path

from scenefold.base.errors import LocalFault, UsageFault
from scenefold.crypto.archives import pack_archive, unpack_archive
from scenefold.crypto.drafts import alone_now, has_drafts
from scenefold.crypto.passphrases import lock, unlock
from scenefold.crypto.secrets_on_disk import read_secret, remove_secrets, write_secret

LOCKED_FILE = "locked"
_KIND = "secrets"

AskPassphrase = Callable[[str], str]
"""Given the folder, returns its passphrase. May ask a person; runs in a worker thread."""


def refuse_to_ask(where: str) -> str:
    """For those who have no passphrase: UsageFault."""
    remedy = "give it in SCENEFOLD_PASSPHRASE, or call from a terminal"
    raise UsageFault("these keys are locked, and no passphrase was given", where=where, remedy=remedy)


class SecretFolder:
    """The secrets in `path` under their names. The passphrase is asked for once, when the first of a locked folder is read."""

    def __init__(self, path: Path, ask: AskPassphrase = refuse_to_ask) -> None:
        self.path = path
        self._ask = ask
        self._opened: Mapping[str, bytes] | None = None

    @property
    def is_locked(self) -> bool:
        return (self.path / LOCKED_FILE).exists()

    def read(self, name: str) -> bytes:
        """One secret; LocalFault if it is missing, exposed or damaged, WrongPassphrase."""
        if not self.is_locked:
            return read_secret(self.path / name)
        if self._opened is None:
            self._opened = self._unlocked(self._ask(str(self.path)))
        if name not in self._opened:
            raise LocalFault(f"{name} is missing among the locked keys", where=str(self.path), remedy="restore them from a backup")
        return self._opened[name]

    def has(self, name: str) -> bool:
        """Whether there is a secret of this name; asks for the passphrase of a locked folder."""
        return name in self.names() if self.is_locked else (self.path / name).exists()

    def names(self) -> tuple[str, ...]:
        """What is locked here; asks for the passphrase. Of an unlocked folder: nothing, whoever wants its files knows their names."""
        if not self.is_locked:
            return ()
        self._opened = self._unlocked(self._ask(str(self.path))) if self._opened is None else self._opened
        return tuple(sorted(self._opened))

    def lock(self, names: tuple[str, ...], passphrase: str, token: Callable[[int], bytes]) -> None:
        """Lock these secrets, now plain or under another passphrase; the new one is in force once this returns."""
        self.keep_locked({name: self.read(name) for name in names}, passphrase, token)

    def keep_locked(self, secrets: Mapping[str, bytes], passphrase: str, token: Callable[[int], bytes]) -> None:
        """Put these secrets here, locked: they never lie on the disk in the clear."""
        locked = lock(pack_archive(_KIND, secrets), passphrase, token)
        if unlock(locked, passphrase) != pack_archive(_KIND, secrets):
            raise LocalFault("what was locked does not open again", where=str(self.path), remedy="report this; nothing was changed")
        write_secret(self.path / LOCKED_FILE, locked, replace=True)
        remove_secrets(self.path, secrets)
        self._opened = secrets

    def unlock(self) -> None:
        """Put the secrets back as plain files, and remove the locked one."""
        if self.is_locked:
            for name in self.names():
                write_secret(self.path / name, self.read(name), replace=True)
            remove_secrets(self.path, (LOCKED_FILE,))
            self._opened = None

    def _unlocked(self, passphrase: str) -> Mapping[str, bytes]:
        path = self.path / LOCKED_FILE
        _, secrets = unpack_archive(unlock(read_secret(path), passphrase, str(path)), (_KIND,), str(path))
        self._remove_leftovers(secrets)
        return secrets

    def _remove_leftovers(self, secrets: Mapping[str, bytes]) -> None:
        """Of a crash. Not while somebody removes the passphrase: the plain files are then what counts next. Who may not write here, leaves it."""
        with suppress(OSError):
            if has_drafts(self.path) or any((self.path / name).exists() for name in secrets):
                with alone_now(self.path):
                    if self.is_locked:
                        remove_secrets(self.path, secrets)
