"""HPKE in base mode (RFC 9180): DHKEM(X25519, HKDF-SHA256), HKDF-SHA256, AES-256-GCM.

    sealed  =  public ephemeral key (32 bytes) | ciphertext with its tag of 16 bytes

Opening is the library's. Sealing is written out after the RFC from the library's primitives, for one reason (specs/deviations.md):
the library draws the ephemeral key itself, and a simulated cluster must draw every byte from its seed. Tests hold the two against each other.
"""

from __future__ import annotations

from typing import Final

from cryptography.exceptions import InvalidTag
from cryptography.hazmat.primitives import hashes, hpke
from cryptography.hazmat.primitives.asymmetric.x25519 import X25519PrivateKey, X25519PublicKey
from cryptography.hazmat.primitives.ciphers.aead import AESGCM
from cryptography.hazmat.primitives.kdf.hkdf import HKDF, HKDFExpand

from scenefold.base.errors import DamagedData

EPHEMERAL_BYTES: Final = 32
OVERHEAD_BYTES: Final = EPHEMERAL_BYTES + 16
_KEM, _KDF, _AEAD = 0x0020, 0x0001, 0x0002
_KEY_BYTES, _NONCE_BYTES, _SECRET_BYTES = 32, 12, 32
_KEM_SUITE = b"KEM" + _KEM.to_bytes(2, "big")
_SUITE = b"HPKE" + b"".join(number.to_bytes(2, "big") for number in (_KEM, _KDF, _AEAD))
_BASE_MODE = b"\x00"
_LIBRARY = hpke.Suite(hpke.KEM.X25519, hpke.KDF.HKDF_SHA256, hpke.AEAD.AES_256_GCM)


def seal_base(plaintext: bytes, recipient: X25519PublicKey, info: bytes, ephemeral: bytes) -> bytes:
    """Seals to a public key. `ephemeral`: 32 random bytes, used for this and for nothing else. DamagedData for a key of low order."""
    key = X25519PrivateKey.from_private_bytes(ephemeral)
    public = key.public_key().public_bytes_raw()
    shared = _shared_secret(agreed(key, recipient), public + recipient.public_bytes_raw())
    cipher_key, nonce = _schedule(shared, info)
    return public + AESGCM(cipher_key).encrypt(nonce, plaintext, b"")


def open_base(sealed: bytes, recipient: X25519PrivateKey, info: bytes) -> bytes:
    """What was sealed to this key under this info; DamagedData for anything else."""
    try:
        return _LIBRARY.decrypt(sealed, recipient, info)
    except (InvalidTag, ValueError):
        raise DamagedData("it was not sealed to this key for this purpose, or is damaged") from None


def agreed(key: X25519PrivateKey, other: X25519PublicKey) -> bytes:
    """The Diffie-Hellman secret of two keys, 32 bytes; DamagedData if the other key is of low order, and the secret none."""
    try:
        return key.exchange(other)
    except ValueError:
        raise DamagedData("a key of low order agrees on no secret") from None


def _shared_secret(dh: bytes, context: bytes) -> bytes:
    return _expand(_extract(b"", _KEM_SUITE, b"eae_prk", dh), _KEM_SUITE, b"shared_secret", context, _SECRET_BYTES)


def _schedule(shared: bytes, info: bytes) -> tuple[bytes, bytes]:
    context = _BASE_MODE + _extract(b"", _SUITE, b"psk_id_hash", b"") + _extract(b"", _SUITE, b"info_hash", info)
    secret = _extract(shared, _SUITE, b"secret", b"")
    return _expand(secret, _SUITE, b"key", context, _KEY_BYTES), _expand(secret, _SUITE, b"base_nonce", context, _NONCE_BYTES)


def _extract(salt: bytes, suite: bytes, label: bytes, material: bytes) -> bytes:
    return HKDF.extract(hashes.SHA256(), salt, b"".join((b"HPKE-v1", suite, label, material)))


def _expand(pseudorandom: bytes, suite: bytes, label: bytes, info: bytes, length: int) -> bytes:
    labelled = b"".join((length.to_bytes(2, "big"), b"HPKE-v1", suite, label, info))
    return HKDFExpand(hashes.SHA256(), length, labelled).derive(pseudorandom)
