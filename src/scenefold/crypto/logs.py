"""The private part of a scene's log, sealed so that nodes can keep it and only key holders read it (specs/16-scene-log.md).

    sealed      =  version (1 byte, 1; 2 of a log that begins with a snapshot) | suite (1, 1) | key epoch (4) | nonce (12) | ciphertext with its tag of 16 bytes
    associated  =  length of domain (1 byte) | "scenefold/scene-log" | genesis (32) | position (8) | the 6 bytes in front of the nonce

AES-192-GCM under the scene's symmetric key. A record's associated data begins with its version, 2, and this with 19, so that
neither can be passed off as the other. Genesis and position bind the log to its scene and its public header: an older
log under a newer header does not open.
"""

from __future__ import annotations

import struct

from cryptography.exceptions import InvalidTag
from cryptography.hazmat.primitives.ciphers.aead import AESGCM

from scenefold.base.errors import DamagedData, LocalFault
from scenefold.crypto.record_header import NONCE_BYTES, TAG_BYTES
from scenefold.crypto.records import SYMMETRIC_KEY_BYTES

_DOMAIN = b"scenefold/scene-log"
_HEAD = struct.Struct(">BBI")
_WHOLE, _SHORTENED = 1, 2
"""Versions: all records, or a snapshot in place of the first ones."""
_SUITE = 1


def seal_log(
    log: bytes, *, genesis: bytes, position: int, symmetric_key: bytes, key_epoch: int, nonce: bytes, shortened: bool = False
) -> bytes:
    """The sealed log. `shortened`: it begins with a snapshot. `nonce`: 12 bytes, others for every other log under this key: random, or a keyed hash of all that is sealed."""
    if len(nonce) != NONCE_BYTES:
        raise LocalFault(f"a nonce has {NONCE_BYTES} bytes, not {len(nonce)}")
    head = _HEAD.pack(_SHORTENED if shortened else _WHOLE, _SUITE, key_epoch)
    return b"".join((head, nonce, _cipher(symmetric_key).encrypt(nonce, log, _associated(genesis, position, head))))


def open_log(sealed: bytes, *, genesis: bytes, position: int, symmetric_key: bytes) -> bytes:
    """The log inside. DamagedData if it is not that of this scene at this position, sealed under this key."""
    where = f"scene {genesis[:4].hex()}, log position {position}"
    if len(sealed) < _HEAD.size + NONCE_BYTES + TAG_BYTES:
        raise DamagedData(f"a sealed log of {len(sealed)} bytes is too short", where=where)
    head, nonce, ciphertext = sealed[: _HEAD.size], sealed[_HEAD.size :][:NONCE_BYTES], sealed[_HEAD.size + NONCE_BYTES :]
    version, suite, _ = _HEAD.unpack(head)
    if version not in (_WHOLE, _SHORTENED) or suite != _SUITE:
        raise DamagedData(f"a sealed log of version {version}, suite {suite}", where=where, remedy="update this program")
    try:
        return _cipher(symmetric_key).decrypt(nonce, ciphertext, _associated(genesis, position, head))
    except InvalidTag:
        remedy = "check that the scene's key is the right one; if it is, a node gave an older or damaged log"
        raise DamagedData("the scene's log cannot be opened with this key", where=where, remedy=remedy) from None


def is_shortened(sealed: bytes) -> bool:
    """Whether a log that `open_log` opens begins with a snapshot."""
    return sealed[:1] == bytes((_SHORTENED,))


def _associated(genesis: bytes, position: int, head: bytes) -> bytes:
    return b"".join((bytes((len(_DOMAIN),)), _DOMAIN, genesis, position.to_bytes(8, "big"), head))


def _cipher(symmetric_key: bytes) -> AESGCM:
    if len(symmetric_key) != SYMMETRIC_KEY_BYTES:
        raise LocalFault(f"a scene's key has {SYMMETRIC_KEY_BYTES} bytes, not {len(symmetric_key)}")
    return AESGCM(symmetric_key)
