"""Keys that things are sealed to: a scene's key to those who may read it, the authority's to a trusted node, datagrams to a peer.

An X25519 key pair of its own beside the signing key, since a key that signs should do nothing else. What is sealed names its
purpose, and opens for no other. RFC 9180 says how (hpke.py); specs/04-records.md, Sealing.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Self

from cryptography.hazmat.primitives.asymmetric.x25519 import X25519PrivateKey, X25519PublicKey

from scenefold.base.errors import DamagedData, LocalFault
from scenefold.base.ids import KeyId
from scenefold.crypto.hpke import EPHEMERAL_BYTES, agreed, open_base, seal_base
from scenefold.crypto.keys import key_id_of
from scenefold.crypto.secrets_on_disk import read_secret, write_secret

SEALING_KEY_BYTES = 32

LOCKBOX_PURPOSE = b"scenefold/lockbox"
"""A scene's keys, sealed to one who may use them."""
AUTHORITY_PURPOSE = b"scenefold/authority"
"""The key of a cluster's authority, sealed to a trusted node."""


@dataclass(frozen=True, slots=True)
class SealingPublicKey:
    """The public half: 32 bytes. DamagedData for another length."""

    raw: bytes
    key_id: KeyId = field(init=False, compare=False)
    _key: X25519PublicKey = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        if len(self.raw) != SEALING_KEY_BYTES:
            raise DamagedData(f"a sealing key has {SEALING_KEY_BYTES} bytes, not {len(self.raw)}")
        object.__setattr__(self, "key_id", key_id_of(self.raw))
        object.__setattr__(self, "_key", X25519PublicKey.from_public_bytes(self.raw))

    def seal(self, plaintext: bytes, purpose: bytes, context: bytes, token: Callable[[int], bytes]) -> bytes:
        """Seals for a purpose (one of this file) and a context (what it belongs to). `token` draws random bytes (world.entropy.token)."""
        return seal_base(plaintext, self._key, _info(purpose, context), token(EPHEMERAL_BYTES))


class SealingKey:
    """The private half. Its repr shows the public one only."""

    __slots__ = ("_key", "_seed", "public")

    def __init__(self, seed: bytes) -> None:
        if len(seed) != SEALING_KEY_BYTES:
            raise LocalFault(f"a sealing key has {SEALING_KEY_BYTES} bytes, not {len(seed)}")
        self._seed = bytes(seed)
        self._key = X25519PrivateKey.from_private_bytes(self._seed)
        self.public = SealingPublicKey(self._key.public_key().public_bytes_raw())

    @classmethod
    def generate(cls) -> Self:
        """A new key, from the operating system's entropy."""
        return cls(X25519PrivateKey.generate().private_bytes_raw())

    @classmethod
    def from_file(cls, path: Path) -> Self:
        """The key that stands in a file, in hexadecimal; LocalFault if it is missing, exposed or none."""
        text = read_secret(path).decode("ascii", "replace").strip()
        try:
            return cls(bytes.fromhex(text))
        except (ValueError, LocalFault):
            raise LocalFault("the file holds no sealing key", where=str(path), remedy="restore it from a backup") from None

    def to_file(self, path: Path) -> None:
        """Writes it in hexadecimal, mode 0600; LocalFault if the file exists."""
        write_secret(path, self._seed.hex().encode() + b"\n")

    @property
    def seed(self) -> bytes:
        return self._seed

    def open(self, sealed: bytes, purpose: bytes, context: bytes) -> bytes:
        """What was sealed to this key for this purpose and context; DamagedData for anything else."""
        return open_base(sealed, self._key, _info(purpose, context))

    def agree(self, other: SealingPublicKey) -> bytes:
        """The secret of 32 bytes that the two keys' holders share; DamagedData for a key of low order. Derive keys from it, use it for none."""
        return agreed(self._key, other._key)

    def __repr__(self) -> str:
        return f"SealingKey({self.public.key_id:08x})"


def _info(purpose: bytes, context: bytes) -> bytes:
    assert 0 < len(purpose) < 256
    return b"".join((bytes((len(purpose),)), purpose, hashlib.sha256(context).digest()))
