"""The scenes that the owner of a profile made or was given: one TOML file a scene, 0600 (design page ux, Set-up).

    name, id, genesis        which scene (id = the first 32 bits of genesis, consensus.md section 3)
    header_key, key_epoch    the id of the key that signed its header when this was written, the epoch of its symmetric key
    recipient, lockbox       its keys, sealed to the user's own key (specs/04-records.md, Lockboxes)
    signature                of who granted it
    position, header_hash    of the newest header that was met (SHA-256 of what is signed of it); nodes that show older ones, or another of
                             that position, are not believed

No key stands here in the clear: whoever has the file and not the user's sealing key has nothing. The file says which scene is
meant by a name, so an existing entry is never overwritten by another scene of the same name.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from scenefold.base.errors import LocalFault
from scenefold.base.ids import KeyId, SceneId
from scenefold.base.limits import LOCKBOX_BYTES_MAX
from scenefold.base.names import is_name, name_rule
from scenefold.crypto import make_private_folder
from scenefold.wire import Lockbox
from scenefold.world.folder_lock import alone_in
from scenefold.world.toml_files import damaged, read_secret_toml, write_toml

GENESIS_BYTES = 32


def checked_name(name: str, what: str) -> str:
    """`name` if it can be a file name on every system; LocalFault saying what is wrong otherwise."""
    if not is_name(name):
        raise LocalFault(
            f"{name[:80]!r} cannot be the name of a {what}",
            where=f"{what} name",
            remedy=f"use {name_rule()}",
        )
    return name


@dataclass(frozen=True, slots=True)
class KeptScene:
    """What is kept of a scene that a user may use. `name`: what it is called here."""

    name: str
    genesis: bytes
    header_key: KeyId
    key_epoch: int
    lockbox: Lockbox
    position: int = 0
    header_hash: bytes = b""

    def __post_init__(self) -> None:
        if len(self.genesis) != GENESIS_BYTES:
            raise ValueError(f"a genesis has {GENESIS_BYTES} bytes, not {len(self.genesis)}")
        if not all(0 <= number < 1 << 32 for number in (self.key_epoch, self.header_key, self.lockbox.recipient)):
            raise ValueError("key_epoch, header_key and recipient are 32-bit numbers")
        if not 0 <= self.position < 1 << 64:
            raise ValueError("position is a 64-bit number")
        if len(self.header_hash) not in (0, GENESIS_BYTES):
            raise ValueError("header_hash has 32 bytes")
        if not 0 < len(self.lockbox.sealed) <= LOCKBOX_BYTES_MAX:
            raise ValueError(f"a lockbox has at most {LOCKBOX_BYTES_MAX} bytes")

    @property
    def scene_id(self) -> SceneId:
        return SceneId(int.from_bytes(self.genesis[:4], "big"))


class Keyring:
    """The folder `scenes/` of a profile."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def names(self) -> list[str]:
        """The names of all scenes with an entry, sorted."""
        if not self._folder.is_dir():
            return []
        return sorted(path.stem for path in self._folder.glob("*.toml") if not path.name.startswith("."))

    def load(self, name: str) -> KeptScene:
        """The scene's entry; LocalFault if there is none or it is damaged."""
        path = self._path(name)
        if not path.exists():
            known = ", ".join(self.names()) or "none"
            raise LocalFault(f"there is no scene {name!r} in this profile", where=f"known: {known}", remedy="`scenectl scene list`")
        return _decoded(path, read_secret_toml(path))

    def save(self, kept: KeptScene) -> None:
        """Write the entry; saving the same scene again replaces it, another scene of that name is refused."""
        make_private_folder(self._folder)
        with alone_in(self._folder):
            self._save(kept)

    def _save(self, kept: KeptScene) -> None:
        path = self._path(kept.name)
        if path.exists() and self.load(kept.name).genesis != kept.genesis:
            raise LocalFault(f"a scene {kept.name!r} exists already", where=str(path), remedy="choose another name")
        write_toml(
            path,
            {
                "name": kept.name,
                "id": kept.scene_id,
                "genesis": kept.genesis.hex(),
                "header_key": kept.header_key,
                "key_epoch": kept.key_epoch,
                "recipient": kept.lockbox.recipient,
                "lockbox": kept.lockbox.sealed.hex(),
                "signature": kept.lockbox.signature.hex(),
                "position": str(kept.position),  # a TOML integer has 63 bits
                "header_hash": kept.header_hash.hex(),
            },
        )

    def advance(self, kept: KeptScene) -> None:
        """Write what was met of a scene that has an entry, unless that knows of as much already. One that is gone, or of another scene, is left so."""
        if self._lacks(kept):
            with alone_in(self._folder):
                if self._lacks(kept):
                    self._save(kept)

    def _lacks(self, kept: KeptScene) -> bool:
        if kept.name not in self.names():
            return False
        known = self.load(kept.name)
        return known.genesis == kept.genesis and (known.position, bool(known.header_hash)) < (kept.position, bool(kept.header_hash))

    def remove(self, name: str) -> None:
        """Forget the entry, for a creation that the cluster refused; nothing happens if there is none."""
        path = self._path(name)
        if path.exists():
            with alone_in(self._folder):
                path.unlink(missing_ok=True)

    def _path(self, name: str) -> Path:
        return self._folder / f"{checked_name(name, 'scene')}.toml"


def _decoded(path: Path, document: dict[str, Any]) -> KeptScene:
    try:
        kept = KeptScene(
            name=str(document["name"]),
            genesis=bytes.fromhex(document["genesis"]),
            header_key=KeyId(int(document["header_key"])),
            key_epoch=int(document["key_epoch"]),
            lockbox=Lockbox(KeyId(int(document["recipient"])), bytes.fromhex(document["lockbox"]), bytes.fromhex(document["signature"])),
            position=int(document.get("position", 0)),
            header_hash=bytes.fromhex(document.get("header_hash", "")),
        )
    except (KeyError, TypeError, ValueError, OverflowError) as problem:
        raise damaged(path, f"{problem}") from problem
    if kept.scene_id != document.get("id") or kept.name != path.stem:
        raise damaged(path, "its id or name does not belong to its keys")
    return kept
