"""The calls of `cryptography`, libsodium and hashlib that sealing consists of, with nothing of ours around them: what `scenectl bench seal`
measures records.py against. Not to be used for anything else, since nothing is checked here.

The bytes are those of real records, each its own: a library that verifies one signature again and again is a tenth faster, for the
processor learns its branches by heart.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from typing import TypeAlias

from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ed25519, padding
from cryptography.hazmat.primitives.asymmetric.rsa import RSAPrivateKey, RSAPublicNumbers
from cryptography.hazmat.primitives.ciphers.aead import AESGCM
from cryptography.hazmat.primitives.serialization import load_pem_private_key
from nacl.bindings import crypto_sign_open

from scenefold.crypto.keys import SigningKey
from scenefold.crypto.record_header import ASSOCIATED_BYTES
from scenefold.crypto.records import Record
from scenefold.crypto.suites import RSA3072

_Sign: TypeAlias = Callable[[bytes], bytes]
_Verify: TypeAlias = Callable[[bytes, bytes], None]


class BareCalls:
    """The library's calls for these records and payloads, which belong together."""

    def __init__(self, signing_key: SigningKey, symmetric_key: bytes, records: Sequence[Record], payloads: Sequence[bytes]) -> None:
        self._cipher = AESGCM(symmetric_key)
        self._sign, self._verify = _rsa(signing_key) if signing_key.suite == RSA3072 else _ed25519(signing_key)
        self._headers = [record.header_bytes for record in records]
        self._drafts = [
            (record.header.nonce, payload, record.header_bytes[:ASSOCIATED_BYTES], record.header_bytes)
            for record, payload in zip(records, payloads, strict=True)
        ]
        self._signed = [
            (
                record.header_bytes,
                self._sign(record.header_bytes),
                record.ciphertext,
                record.header.nonce,
                record.header_bytes[:ASSOCIATED_BYTES],
            )
            for record in records
        ]

    def seal(self) -> list[tuple[bytes, bytes, bytes]]:
        """Encrypt, hash, sign as much as a header; what is made is kept, as whoever seals must."""
        made = []
        for nonce, payload, associated, header in self._drafts:
            ciphertext = self._cipher.encrypt(nonce, payload, associated)
            made.append((ciphertext, hashlib.sha256(ciphertext).digest(), self._sign(header)))
        return made

    def sign(self) -> None:
        """Sign the headers."""
        for header in self._headers:
            self._sign(header)

    def verify(self) -> None:
        """Hash and verify."""
        for header, signature, ciphertext, _, _ in self._signed:
            hashlib.sha256(ciphertext).digest()
            self._verify(signature, header)

    def open(self) -> list[bytes]:
        """Hash, verify and decrypt."""
        opened = []
        for header, signature, ciphertext, nonce, associated in self._signed:
            hashlib.sha256(ciphertext).digest()
            self._verify(signature, header)
            opened.append(self._cipher.decrypt(nonce, ciphertext, associated))
        return opened


def _ed25519(key: SigningKey) -> tuple[_Sign, _Verify]:
    bare = ed25519.Ed25519PrivateKey.from_private_bytes(key.seed)
    raw = key.public.raw

    def verify(signature: bytes, message: bytes) -> None:
        crypto_sign_open(signature + message, raw)

    return bare.sign, verify


def _rsa(key: SigningKey) -> tuple[_Sign, _Verify]:
    bare = load_pem_private_key(key.secret, password=None)
    assert isinstance(bare, RSAPrivateKey)
    private, public = bare, RSAPublicNumbers(65537, int.from_bytes(key.public.raw, "big")).public_key()
    hash_, pss = hashes.SHA256(), padding.PSS(padding.MGF1(hashes.SHA256()), 32)

    def sign(message: bytes) -> bytes:
        return private.sign(message, pss, hash_)

    def verify(signature: bytes, message: bytes) -> None:
        public.verify(signature, message, pss, hash_)

    return sign, verify
