"""Keys that things are sealed to: a scene's key to those who may read it, the authority's to a trusted node, datagrams to a peer.

A key pair of its own beside the signing key, since a key that signs should do nothing else. What is sealed names its purpose, and
opens for no other. X25519 seals by RFC 9180 (hpke.py), RSA by OAEP with the purpose in its label; specs/04-records.md, Sealing.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Self

from cryptography.hazmat.primitives.asymmetric.rsa import RSAPrivateKey, RSAPublicKey
from cryptography.hazmat.primitives.asymmetric.x25519 import X25519PrivateKey, X25519PublicKey

from scenefold.base.errors import DamagedData, LocalFault
from scenefold.base.ids import KeyId
from scenefold.crypto import rsa3072
from scenefold.crypto.hpke import EPHEMERAL_BYTES, agreed, open_base, seal_base
from scenefold.crypto.key_files import KeptKey
from scenefold.crypto.keys import key_id_of
from scenefold.crypto.suites import DEFAULT_SUITE, ED25519, RSA3072, SUITES, suite_of

SEALING_KEY_BYTES = SUITES[ED25519].public_key_bytes
"""Of suite 1, which all nodes' keys are of."""

LOCKBOX_PURPOSE = b"scenefold/lockbox"
"""A scene's keys, sealed to one who may use them."""
AUTHORITY_PURPOSE = b"scenefold/authority"
"""The key of a cluster's authority, sealed to a trusted node."""
RENDER_PURPOSE = b"scenefold/render"
"""A scene's keys, sealed to a node that shall render it."""


@dataclass(frozen=True, slots=True)
class SealingPublicKey:
    """The public half: 32 bytes of X25519, or the modulus of 384 bytes of RSA. DamagedData if they are no key."""

    raw: bytes
    suite: int = DEFAULT_SUITE
    key_id: KeyId = field(init=False, compare=False)
    _key: X25519PublicKey | RSAPublicKey = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        suite = suite_of(self.suite)
        if len(self.raw) != suite.public_key_bytes:
            raise DamagedData(f"a sealing key has {suite.public_key_bytes} bytes, not {len(self.raw)}")
        key = rsa3072.public_key(self.raw) if self.suite == RSA3072 else X25519PublicKey.from_public_bytes(self.raw)
        object.__setattr__(self, "key_id", key_id_of(self.raw))
        object.__setattr__(self, "_key", key)

    def seal(self, plaintext: bytes, purpose: bytes, context: bytes, token: Callable[[int], bytes]) -> bytes:
        """Seals for a purpose (one of this file) and a context (what it belongs to). `token` draws random bytes (world.entropy.token).

        LocalFault for more than 318 bytes to an RSA key.
        """
        if isinstance(self._key, RSAPublicKey):
            return rsa3072.seal(self._key, plaintext, _info(purpose, context))
        return seal_base(plaintext, self._key, _info(purpose, context), token(EPHEMERAL_BYTES))


class SealingKey(KeptKey):
    """The private half. Its repr shows the public one only."""

    __slots__ = ("_key", "public")

    WHAT = "sealing key"

    def __init__(self, secret: bytes, suite: int = DEFAULT_SUITE) -> None:
        """`secret`: 32 bytes, or in suite 2 a PEM; LocalFault if it is none."""
        super().__init__(secret, suite)
        self._key: X25519PrivateKey | RSAPrivateKey
        if self.suite == RSA3072:
            self._key = rsa3072.private_key(self._secret)
            raw = rsa3072.modulus_of(self._key)
        else:
            self._key = X25519PrivateKey.from_private_bytes(self._secret)
            raw = self._key.public_key().public_bytes_raw()
        self.public = SealingPublicKey(raw, suite)

    @classmethod
    def generate(cls, suite: int = DEFAULT_SUITE) -> Self:
        """A new key, from the operating system's entropy. In suite 2 it takes about half a second."""
        return cls(rsa3072.new_key() if suite == RSA3072 else X25519PrivateKey.generate().private_bytes_raw(), suite)

    def open(self, sealed: bytes, purpose: bytes, context: bytes) -> bytes:
        """What was sealed to this key for this purpose and context; DamagedData for anything else."""
        if isinstance(self._key, RSAPrivateKey):
            return rsa3072.open_sealed(self._key, sealed, _info(purpose, context))
        return open_base(sealed, self._key, _info(purpose, context))

    def agree(self, other: SealingPublicKey) -> bytes:
        """The secret of 32 bytes that the two keys' holders share; DamagedData for a key of low order, LocalFault in another suite than 1.

        Derive keys from it, use it for none.
        """
        if isinstance(self._key, RSAPrivateKey) or isinstance(other._key, RSAPublicKey):
            raise LocalFault("keys of RSA agree on no secret")
        return agreed(self._key, other._key)

    def __repr__(self) -> str:
        return f"SealingKey({self.public.key_id:08x})"


def _info(purpose: bytes, context: bytes) -> bytes:
    assert 0 < len(purpose) < 256
    return b"".join((bytes((len(purpose),)), purpose, hashlib.sha256(context).digest()))
