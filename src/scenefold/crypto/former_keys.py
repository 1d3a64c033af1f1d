"""The keys that a scene had before, sealed under the one that it has (specs/04-records.md, Former keys).

sealed      =  nonce (12) | ciphertext with its tag of 16 bytes
ciphertext  =  AES-192-GCM of the keys of the epochs before, the oldest first, 24 bytes each
associated  =  length of domain (1 byte) | "scenefold/former-keys" | genesis (32) | key epoch (4)
"""

from __future__ import annotations

from collections.abc import Mapping

from cryptography.exceptions import InvalidTag
from cryptography.hazmat.primitives.ciphers.aead import AESGCM

from scenefold.base.errors import DamagedData
from scenefold.base.limits import FORMER_KEYS_MAX
from scenefold.crypto.record_header import NONCE_BYTES, TAG_BYTES
from scenefold.crypto.records import SYMMETRIC_KEY_BYTES

_DOMAIN = b"scenefold/former-keys"


def seal_former(keys: Mapping[int, bytes], *, genesis: bytes, key_epoch: int, symmetric_key: bytes, nonce: bytes) -> bytes:
    """The keys of the epochs right before `key_epoch`, as many as there may be. `nonce`: 12 random bytes, fresh for every call."""
    first = max(0, key_epoch - FORMER_KEYS_MAX)
    plain = b"".join(keys[epoch] for epoch in range(first, key_epoch))
    return nonce + AESGCM(symmetric_key).encrypt(nonce, plain, _associated(genesis, key_epoch))


def open_former(sealed: bytes, *, genesis: bytes, key_epoch: int, symmetric_key: bytes) -> dict[int, bytes]:
    """The keys by their epochs; DamagedData if they were not sealed under this key, for this scene and epoch."""
    where = f"scene {genesis[:4].hex()}, key epoch {key_epoch}"
    if len(sealed) < NONCE_BYTES + TAG_BYTES:
        raise DamagedData("the scene's former keys are cut short", where=where)
    try:
        plain = AESGCM(symmetric_key).decrypt(sealed[:NONCE_BYTES], sealed[NONCE_BYTES:], _associated(genesis, key_epoch))
    except InvalidTag:
        raise DamagedData("the scene's former keys do not open under its key", where=where) from None
    count, rest = divmod(len(plain), SYMMETRIC_KEY_BYTES)
    if rest or count != min(key_epoch, FORMER_KEYS_MAX):
        raise DamagedData("the scene's former keys are ill-formed", where=where)
    keys = (plain[at : at + SYMMETRIC_KEY_BYTES] for at in range(0, len(plain), SYMMETRIC_KEY_BYTES))
    return dict(zip(range(key_epoch - count, key_epoch), keys, strict=True))


def _associated(genesis: bytes, key_epoch: int) -> bytes:
    return b"".join((bytes((len(_DOMAIN),)), _DOMAIN, genesis, key_epoch.to_bytes(4, "big")))
