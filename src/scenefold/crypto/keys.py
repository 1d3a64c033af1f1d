"""Ed25519 keys, and signatures that mean one thing only (specs/04-records.md, Signatures).

    signed bytes  =  length of domain (1 byte) | domain | message

The domain says what is being signed; a signature made for one purpose is worth nothing for another, whatever the
bytes of the message. Ed25519 signatures have 64 bytes, as thesis C.3 reserves.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Self

from cryptography.exceptions import InvalidSignature as _InvalidSignature
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey

from scenefold.base.errors import DamagedData, LocalFault
from scenefold.base.ids import KeyId
from scenefold.crypto.secrets_on_disk import read_secret, write_secret

SEED_BYTES = 32
PUBLIC_KEY_BYTES = 32
SIGNATURE_BYTES = 64

RECORD_DOMAIN = b"scenefold/record"
HEADER_DOMAIN = b"scenefold/header"
"""Public scene headers of committed positions, and nothing else."""
PROPOSAL_DOMAIN = b"scenefold/proposal"
STATUS_DOMAIN = b"scenefold/status"
DATAGRAM_DOMAIN = b"scenefold/datagram"
LOG_DOMAIN = b"scenefold/log"
"""Records of the cluster's log."""
LEASE_DOMAIN = b"scenefold/lease"
"""Requests for an owner lease, and their answers."""


class InvalidSignature(DamagedData):
    """The signature was not made by this key over these bytes for this purpose (reject reason 4)."""


def key_id_of(raw: bytes) -> KeyId:
    """The id of a public key: the first 32 bits of its SHA-256."""
    return KeyId(int.from_bytes(hashlib.sha256(raw).digest()[:4], "big"))


def _signed(domain: bytes, message: bytes) -> bytes:
    assert 0 < len(domain) < 256
    return b"".join((bytes((len(domain),)), domain, message))


@dataclass(frozen=True, slots=True)
class PublicKey:
    """An Ed25519 public key: 32 bytes. DamagedData if they are no key."""

    raw: bytes
    key_id: KeyId = field(init=False, compare=False)
    _key: Ed25519PublicKey = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        if len(self.raw) != PUBLIC_KEY_BYTES:
            raise DamagedData(f"a public key has {PUBLIC_KEY_BYTES} bytes, not {len(self.raw)}")
        try:
            key = Ed25519PublicKey.from_public_bytes(self.raw)
        except ValueError:
            raise DamagedData("these bytes are no Ed25519 key") from None
        object.__setattr__(self, "key_id", key_id_of(self.raw))
        object.__setattr__(self, "_key", key)

    def verify(self, signature: bytes, domain: bytes, message: bytes) -> None:
        """Returns if the signature is good; InvalidSignature otherwise."""
        try:
            self._key.verify(signature, _signed(domain, message))
        except _InvalidSignature:
            raise InvalidSignature(f"the signature is not that of key {self.key_id:08x}") from None


class SigningKey:
    """An Ed25519 private key. Its repr shows the public half only."""

    __slots__ = ("_key", "_seed", "public")

    def __init__(self, seed: bytes) -> None:
        if len(seed) != SEED_BYTES:
            raise LocalFault(f"a signing seed has {SEED_BYTES} bytes, not {len(seed)}")
        self._seed = bytes(seed)
        self._key = Ed25519PrivateKey.from_private_bytes(self._seed)
        self.public = PublicKey(self._key.public_key().public_bytes_raw())

    @classmethod
    def generate(cls) -> Self:
        """A new key, from the operating system's entropy."""
        return cls(Ed25519PrivateKey.generate().private_bytes_raw())

    @classmethod
    def from_seed(cls, seed: bytes) -> Self:
        """The key of this seed of 32 bytes; LocalFault for any other length."""
        return cls(seed)

    @classmethod
    def from_file(cls, path: Path) -> Self:
        """The key whose seed stands in a file, in hexadecimal; LocalFault if it is missing, exposed or no seed."""
        text = read_secret(path).decode("ascii", "replace").strip()
        try:
            return cls(bytes.fromhex(text))
        except (ValueError, LocalFault):
            raise LocalFault("the file holds no signing seed", where=str(path), remedy="restore it from a backup") from None

    def to_file(self, path: Path) -> None:
        """Writes the seed in hexadecimal, mode 0600; LocalFault if the file exists."""
        write_secret(path, self._seed.hex().encode() + b"\n")

    @property
    def seed(self) -> bytes:
        return self._seed

    @property
    def key_id(self) -> KeyId:
        return self.public.key_id

    def sign(self, domain: bytes, message: bytes) -> bytes:
        """64 bytes that `public.verify` accepts for the same domain and message."""
        return self._key.sign(_signed(domain, message))

    def __repr__(self) -> str:
        return f"SigningKey({self.key_id:08x})"
