"""One's own keys in a profile: shown, locked, written to a file, put back (docs/how-to/keep-your-keys.md).

Plain functions that touch the disk and may ask a person for a passphrase: they speak to no node.
"""

from __future__ import annotations

import hashlib
import secrets
from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

from scenefold.base.errors import LocalFault
from scenefold.base.ids import KeyId
from scenefold.client.connecting import profile_folder, profile_place
from scenefold.crypto import SUITES, MemberSecrets
from scenefold.crypto.secret_folder import AskPassphrase, SecretFolder
from scenefold.world.key_archive import Taken, check_keys_file, export_keys, import_keys, lock_user, unlock_user
from scenefold.world.own_papers import own_card
from scenefold.world.profile import ClusterProfile

_GROUP = 8
_GROUPS = 4


@dataclass(frozen=True, slots=True)
class OwnKeys:
    """Who a user is, without any secret. A fingerprint is the first 128 bits of the SHA-256 of a public key."""

    user: str
    cluster: str
    folder: Path
    suite: str
    is_administrator: bool
    signing_id: KeyId
    signing_fingerprint: str
    sealing_id: KeyId
    sealing_fingerprint: str
    not_before: datetime
    not_after: datetime
    is_locked: bool

    def document(self) -> dict[str, Any]:
        """The JSON form (docs/reference/scenectl.md)."""
        return {
            "user": self.user,
            "cluster": self.cluster,
            "folder": str(self.folder),
            "suite": self.suite,
            "administrator": self.is_administrator,
            "signing_key": f"{self.signing_id:08x}",
            "signing_fingerprint": self.signing_fingerprint,
            "sealing_key": f"{self.sealing_id:08x}",
            "sealing_fingerprint": self.sealing_fingerprint,
            "not_before": self.not_before.isoformat(),
            "not_after": self.not_after.isoformat(),
            "locked": self.is_locked,
        }


def own_keys(profile: str | Path | None, user: str | None, ask: AskPassphrase) -> OwnKeys:
    """The keys of a user in a profile. LocalFault if there are none, they are damaged, or are not those that the certificate names."""
    known = ClusterProfile.load(profile_folder(profile))
    name = known.user if user is None else user
    folder = _user_folder(known, name)
    opened = SecretFolder(folder, ask)
    identity, private = known.user_identity(name, opened), MemberSecrets.from_files(folder, opened)
    card = own_card(known, identity, private)
    return OwnKeys(
        user=name,
        cluster=known.name,
        folder=folder,
        suite=SUITES[private.signing.suite].name,
        is_administrator=card.keys.is_administrator,
        signing_id=private.signing.key_id,
        signing_fingerprint=fingerprint(private.signing.public.raw),
        sealing_id=private.sealing.public.key_id,
        sealing_fingerprint=fingerprint(private.sealing.public.raw),
        not_before=card.not_before,
        not_after=card.not_after,
        is_locked=opened.is_locked,
    )


def fingerprint(raw: bytes) -> str:
    """What two people compare over the telephone: 32 hexadecimal digits in groups of eight."""
    digits = hashlib.sha256(raw).hexdigest()
    return " ".join(digits[start : start + _GROUP] for start in range(0, _GROUP * _GROUPS, _GROUP))


def user_of(profile: str | Path | None, user: str | None) -> str:
    """`user`, or the one whose keys the profile's clients take; LocalFault if it has none of that name."""
    known = ClusterProfile.load(profile_folder(profile))
    name = known.user if user is None else user
    _user_folder(known, name)
    return name


def set_passphrase(profile: str | Path | None, user: str | None, wanted: Callable[[], str] | None, ask: AskPassphrase) -> Path:
    """Lock a user's keys with what `wanted` returns, or leave them plain if it is None. Returns their folder.

    `ask` tells the present passphrase. UsageFault if the new one is too short.
    """
    known = ClusterProfile.load(profile_folder(profile))
    folder = _user_folder(known, known.user if user is None else user)
    present = SecretFolder(folder, ask)
    if wanted is None:
        unlock_user(present)
    else:
        if present.is_locked:
            present.names()  # Who does not know the present one is told so before being asked for a new one.
        lock_user(present, wanted(), secrets.token_bytes)
    return folder


def write_keys(profile: str | Path | None, target: Path, user: str | None, wanted: Callable[[], str], ask: AskPassphrase) -> Taken:
    """A backup of the profile, or with `user` that user's identity, in a file under the passphrase that `wanted` returns."""
    if target.exists():
        raise LocalFault("the file exists already", where=str(target), remedy="choose another name, or remove it")
    return export_keys(profile_folder(profile), target, wanted(), secrets.token_bytes, ask, user=user)


def put_back(source: Path, profile: str | Path | None, wanted: Callable[[], str]) -> tuple[Path, Taken]:
    """Put a file of keys back into a profile, which is made if there is none. Returns its folder, and what came in."""
    folder = profile_place(profile)
    check_keys_file(source)
    return folder, import_keys(source, folder, wanted(), secrets.token_bytes)


def _user_folder(known: ClusterProfile, user: str) -> Path:
    folder = known.user_folder(user)
    if not folder.is_dir():
        names = ", ".join(sorted(path.name for path in folder.parent.iterdir())) if folder.parent.is_dir() else ""
        remedy = f"choose of {names}" if names else "put them back from a backup with `scenectl key import`"
        raise LocalFault(f"the profile has no keys of a user {user}", where=str(known.folder), remedy=remedy)
    return folder
