"""The private keys of a member besides that of TLS: what it signs with, and what is sealed to it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Self

from scenefold.crypto.cards import MemberKeys
from scenefold.crypto.keys import SigningKey
from scenefold.crypto.sealing_keys import SealingKey

SIGNING_FILE = "signing.seed"
SEALING_FILE = "sealing.seed"


@dataclass(frozen=True, slots=True)
class MemberSecrets:
    """A node's or a user's. Its repr shows public halves only."""

    signing: SigningKey
    sealing: SealingKey

    @classmethod
    def generate(cls) -> Self:
        """New ones, from the operating system's entropy."""
        return cls(SigningKey.generate(), SealingKey.generate())

    @classmethod
    def from_files(cls, folder: Path) -> Self:
        """Those in a folder; LocalFault if one is missing, exposed or none."""
        return cls(SigningKey.from_file(folder / SIGNING_FILE), SealingKey.from_file(folder / SEALING_FILE))

    def to_files(self, folder: Path) -> None:
        """Writes both into a private folder that exists; LocalFault if one is there already."""
        self.signing.to_file(folder / SIGNING_FILE)
        self.sealing.to_file(folder / SEALING_FILE)

    def public(self, *, is_administrator: bool = False) -> MemberKeys:
        """The public halves, as a certificate binds them to a name."""
        return MemberKeys(self.signing.public, self.sealing.public, is_administrator)
