"""The scenes that the owner of a profile holds keys of: one TOML file a scene, 0600 (design page ux, Set-up).

    name, id, genesis        which scene (id = the first 32 bits of genesis, consensus.md section 3)
    symmetric_key, key_epoch what its records are encrypted with (AES-192)
    header_seed              the seed of the key that signs the scene's public header; the first participant holds it

Whoever loses this file loses the scene, since no node can read it. So an existing entry is never overwritten by
another scene of the same name.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from scenefold.base.errors import LocalFault
from scenefold.base.ids import SceneId
from scenefold.crypto import SYMMETRIC_KEY_BYTES, make_private_folder
from scenefold.world.toml_files import damaged, read_secret_toml, write_toml

GENESIS_BYTES = 32
SEED_BYTES = 32

_NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,63}")


def checked_name(name: str, what: str) -> str:
    """`name` if it can be a file name on every system; LocalFault saying what is wrong otherwise."""
    if not _NAME.fullmatch(name):
        raise LocalFault(
            f"{name[:80]!r} cannot be the name of a {what}",
            where=f"{what} name",
            remedy="use 1 to 64 letters, digits, '-', '_' or '.', not beginning with '-' or '.'",
        )
    return name


@dataclass(frozen=True, slots=True)
class SceneKeys:
    """What a key holder needs to read, write and vouch for one scene."""

    name: str
    genesis: bytes
    symmetric_key: bytes = field(repr=False)
    header_seed: bytes = field(repr=False)
    key_epoch: int = 0

    def __post_init__(self) -> None:
        lengths = len(self.genesis), len(self.symmetric_key), len(self.header_seed)
        if lengths != (GENESIS_BYTES, SYMMETRIC_KEY_BYTES, SEED_BYTES):
            raise ValueError(f"genesis, symmetric key and header seed have the lengths {lengths}")
        if not 0 <= self.key_epoch < 1 << 32:
            raise ValueError("key_epoch is a 32-bit number")

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

    def load(self, name: str) -> SceneKeys:
        """The keys of the scene; LocalFault if there is no entry or it is damaged."""
        path = self._path(name)
        if not path.exists():
            known = ", ".join(self.names()) or "none"
            raise LocalFault(f"there is no scene {name!r} in this profile", where=f"known: {known}", remedy="`scenectl scene list`")
        return _decoded(path, read_secret_toml(path))

    def save(self, keys: SceneKeys) -> None:
        """Write the entry; saving the same scene again replaces it, another scene of that name is refused."""
        path = self._path(keys.name)
        if path.exists() and self.load(keys.name).genesis != keys.genesis:
            raise LocalFault(f"a scene {keys.name!r} exists already", where=str(path), remedy="choose another name")
        make_private_folder(self._folder)
        write_toml(
            path,
            {
                "name": keys.name,
                "id": keys.scene_id,
                "genesis": keys.genesis.hex(),
                "key_epoch": keys.key_epoch,
                "symmetric_key": keys.symmetric_key.hex(),
                "header_seed": keys.header_seed.hex(),
            },
        )

    def remove(self, name: str) -> None:
        """Forget the entry, for a creation that the cluster refused; nothing happens if there is none."""
        self._path(name).unlink(missing_ok=True)

    def _path(self, name: str) -> Path:
        return self._folder / f"{checked_name(name, 'scene')}.toml"


def _decoded(path: Path, document: dict[str, Any]) -> SceneKeys:
    try:
        keys = SceneKeys(
            name=str(document["name"]),
            genesis=bytes.fromhex(document["genesis"]),
            symmetric_key=bytes.fromhex(document["symmetric_key"]),
            header_seed=bytes.fromhex(document["header_seed"]),
            key_epoch=int(document["key_epoch"]),
        )
    except (KeyError, TypeError, ValueError) as problem:
        raise damaged(path, f"{problem}") from problem
    if keys.scene_id != document.get("id") or keys.name != path.stem:
        raise damaged(path, "its id or name does not belong to its keys")
    return keys
