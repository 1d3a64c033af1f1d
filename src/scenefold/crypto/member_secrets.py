"""The private keys of a member besides that of TLS: what it signs with, and what is sealed to it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Self

from scenefold.base.errors import LocalFault
from scenefold.crypto.cards import MemberKeys
from scenefold.crypto.key_files import KeptKey
from scenefold.crypto.keys import PublicKey, SigningKey
from scenefold.crypto.sealing_keys import SealingKey, SealingPublicKey
from scenefold.crypto.secret_folder import SecretFolder
from scenefold.crypto.suites import DEFAULT_SUITE, RSA3072

_SIGNING, _SEALING = "signing", "sealing"
_SEED, _PEM = ".seed", ".pem"


@dataclass(frozen=True, slots=True)
class MemberSecrets:
    """A node's or a user's. Its repr shows public halves only."""

    signing: SigningKey
    sealing: SealingKey

    @classmethod
    def generate(cls, suite: int = DEFAULT_SUITE) -> Self:
        """New ones, from the operating system's entropy. In suite 2 it takes about a second."""
        return cls(SigningKey.generate(suite), SealingKey.generate(suite))

    @classmethod
    def from_files(cls, folder: Path, secrets: SecretFolder | None = None) -> Self:
        """Those in a folder, through `secrets` if they are locked; LocalFault if one is missing, exposed or none."""
        opened = secrets or SecretFolder(folder)
        signing, sealing = (_existing(opened, name) for name in (_SIGNING, _SEALING))
        return cls(
            SigningKey.from_text(opened.read(signing), str(folder / signing)),
            SealingKey.from_text(opened.read(sealing), str(folder / sealing)),
        )

    def to_files(self, folder: Path) -> None:
        """Writes both into a private folder that exists; LocalFault if one is there already."""
        for key, name in ((self.signing, _SIGNING), (self.sealing, _SEALING)):
            key.to_file(folder / _file(name, key))

    def files_besides(self, signing: PublicKey, sealing: SealingPublicKey) -> tuple[str, ...]:
        """The files that hold other keys than the private halves of these."""
        kept = ((_SIGNING, self.signing, signing), (_SEALING, self.sealing, sealing))
        return tuple(_file(name, key) for name, key, public in kept if key.public != public)

    def public(self, *, is_administrator: bool = False) -> MemberKeys:
        """The public halves, as a certificate binds them to a name."""
        return MemberKeys(self.signing.public, self.sealing.public, is_administrator)


def _file(name: str, key: KeptKey) -> str:
    return name + (_PEM if key.suite == RSA3072 else _SEED)


def _existing(folder: SecretFolder, name: str) -> str:
    """The file of a key, whichever suite it is of; that of suite 1 if there is none."""
    seed, pem = name + _SEED, name + _PEM
    if not folder.has(pem):
        return seed
    if folder.has(seed):
        remedy = f"move away the one that is not in use, {seed} or {pem}"
        raise LocalFault(f"there are two {name} keys", where=str(folder.path), remedy=remedy)
    return pem
