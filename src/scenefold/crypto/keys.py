"""Keys of either suite, and signatures that mean one thing only (specs/04-records.md, Suites and Signatures).

    signed bytes  =  length of domain (1 byte) | domain | message

The domain says what is being signed; a signature made for one purpose is worth nothing for another, whatever the
bytes of the message. Ed25519 signatures have 64 bytes, as thesis C.3 reserves; those of RSA-3072 have 384.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache, partial
from typing import Self

from cryptography.exceptions import InvalidSignature as _InvalidSignature
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from nacl.bindings import crypto_sign_open
from nacl.exceptions import BadSignatureError

from scenefold.base.errors import DamagedData
from scenefold.base.ids import KeyId
from scenefold.crypto import rsa3072
from scenefold.crypto.key_files import KeptKey
from scenefold.crypto.suites import DEFAULT_SUITE, ED25519, RSA3072, SUITES, suite_of

SIGNATURE_BYTES = SUITES[ED25519].signature_bytes
"""Of suite 1, which all that goes by datagram is signed in."""

_KEYS_MAX = 4_096
"""Keys that were read last: each header of a scene brings all of its keys again."""

RECORD_DOMAIN = b"scenefold/record"
HEADER_DOMAIN = b"scenefold/header"
"""Public scene headers, by an owner; and those of the cluster's log."""
DECISION_DOMAIN = b"scenefold/decided"
"""Public scene headers of committed positions, by the node that decides them, and nothing else."""
STATUS_DOMAIN = b"scenefold/status"
ALIVE_DOMAIN = b"scenefold/alive"
"""Proofs of life that others hand on: what a member drew a moment ago."""
LOG_DOMAIN = b"scenefold/log"
"""Records of the cluster's log, and of scenes' logs."""
SNAPSHOT_DOMAIN = b"scenefold/snapshot"
"""What the first records of a scene's log add up to, in their place."""
PURGE_DOMAIN = b"scenefold/purge"
"""What a writer says of deleted records, so that nodes may drop them."""
LEASE_DOMAIN = b"scenefold/lease"
"""Requests for an owner lease, and their answers."""
DISCARD_DOMAIN = b"scenefold/discard"
"""Orders to delete what a returned node keeps apart."""


class InvalidSignature(DamagedData):
    """The signature was not made by this key over these bytes for this purpose (reject reason 4)."""


def key_id_of(raw: bytes) -> KeyId:
    """The id of a public key: the first 32 bits of its SHA-256."""
    return KeyId(int.from_bytes(hashlib.sha256(raw).digest()[:4], "big"))


def signed_bytes(domain: bytes, message: bytes) -> bytes:
    """What is really signed: no message of one domain is one of another."""
    assert 0 < len(domain) < 256
    return b"%c%b%b" % (len(domain), domain, message)


@dataclass(frozen=True, slots=True)
class PublicKey:
    """A public key: 32 bytes of Ed25519, or the modulus of 384 bytes of RSA. DamagedData if they are no key."""

    raw: bytes
    suite: int = DEFAULT_SUITE
    key_id: KeyId = field(init=False, compare=False)
    _verify: Callable[[bytes, bytes], None] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        suite = suite_of(self.suite)
        if len(self.raw) != suite.public_key_bytes:
            raise DamagedData(f"a public key has {suite.public_key_bytes} bytes, not {len(self.raw)}")
        object.__setattr__(self, "key_id", key_id_of(self.raw))
        object.__setattr__(self, "_verify", _verifier(self.raw, self.suite))

    @property
    def signature_bytes(self) -> int:
        return SUITES[self.suite].signature_bytes

    def verify(self, signature: bytes, domain: bytes, message: bytes) -> None:
        """Returns if the signature is good; InvalidSignature otherwise."""
        try:
            self._verify(signature, signed_bytes(domain, message))
        except (_InvalidSignature, BadSignatureError):
            raise InvalidSignature(f"the signature is not that of key {self.key_id:08x}") from None


@lru_cache(_KEYS_MAX)
def _verifier(raw: bytes, suite: int) -> Callable[[bytes, bytes], None]:
    """What checks a signature over bytes; it raises the error of the suite's library."""
    if suite == RSA3072:
        return partial(rsa3072.verify, rsa3072.public_key(raw))
    return partial(_verify_ed25519, raw)


def _verify_ed25519(raw: bytes, signature: bytes, message: bytes) -> None:
    """By libsodium, in half of the time that OpenSSL takes; BadSignatureError. It takes no keys and points of small order, for which one
    signature could be good for several messages."""
    if len(signature) != SIGNATURE_BYTES:
        raise BadSignatureError
    crypto_sign_open(signature + message, raw)


class SigningKey(KeptKey):
    """A private key that signs. Its repr shows the public half only."""

    __slots__ = ("_sign", "public")

    WHAT = "signing seed"

    def __init__(self, secret: bytes, suite: int = DEFAULT_SUITE) -> None:
        """`secret`: a seed of 32 bytes, or in suite 2 a PEM; LocalFault if it is none."""
        super().__init__(secret, suite)
        if self.suite == RSA3072:
            rsa = rsa3072.private_key(self._secret)
            self._sign: Callable[[bytes], bytes] = partial(rsa3072.sign, rsa)
            raw = rsa3072.modulus_of(rsa)
        else:
            key = Ed25519PrivateKey.from_private_bytes(self._secret)
            self._sign = key.sign
            raw = key.public_key().public_bytes_raw()
        self.public = PublicKey(raw, suite)

    @classmethod
    def generate(cls, suite: int = DEFAULT_SUITE) -> Self:
        """A new key, from the operating system's entropy. In suite 2 it takes about half a second."""
        return cls(rsa3072.new_key() if suite == RSA3072 else Ed25519PrivateKey.generate().private_bytes_raw(), suite)

    @classmethod
    def from_seed(cls, seed: bytes) -> Self:
        """The Ed25519 key of this seed of 32 bytes; LocalFault for any other length."""
        return cls(seed)

    @property
    def key_id(self) -> KeyId:
        return self.public.key_id

    def sign(self, domain: bytes, message: bytes) -> bytes:
        """As many bytes as the suite says, which `public.verify` accepts for the same domain and message."""
        return self._sign(signed_bytes(domain, message))

    def __repr__(self) -> str:
        return f"SigningKey({self.key_id:08x})"
