"""Bytes locked by a passphrase: key files at rest, and backups of keys (specs/04-records.md, Locked files).

    -----BEGIN SCENEFOLD LOCKED-----
    base64 of   version u8 = 1 | log2 of scrypt's n, u8 | salt 16 | nonce 12 | ciphertext and tag | SHA-256 of all in front
    -----END SCENEFOLD LOCKED-----

scrypt (RFC 7914) with r = 8 and p = 1 makes a key of 32 bytes, AES-256-GCM encrypts, with all in front of the ciphertext as
associated data. The digest at the end is no protection: it tells a damaged file from a wrong passphrase, which the cipher alone
cannot.
"""

from __future__ import annotations

import base64
import binascii
import hashlib
import hmac
import struct
import unicodedata
from collections.abc import Callable

from cryptography.exceptions import InvalidTag
from cryptography.hazmat.primitives.ciphers.aead import AESGCM
from cryptography.hazmat.primitives.kdf.scrypt import Scrypt

from scenefold.base.errors import LocalFault, UsageFault

PASSPHRASE_CHARACTERS_MIN = 8
PASSPHRASE_CHARACTERS_MAX = 1024
LOG2_N = 17
"""128 MiB and some 0.3 s for each guess."""
LOG2_N_MAX = 20
"""A file that asks for more than a gibibyte is none of ours."""

_BEGIN = b"-----BEGIN SCENEFOLD LOCKED-----"
_END = b"-----END SCENEFOLD LOCKED-----"
_VERSION = 1
_HEAD = struct.Struct(">BB16s12s")
_SALT_BYTES, _NONCE_BYTES, _TAG_BYTES, _DIGEST_BYTES, _KEY_BYTES = 16, 12, 16, 32, 32
_LINE = 64


class WrongPassphrase(LocalFault):
    """The file is whole, and this passphrase does not open it."""


def is_locked(data: bytes) -> bool:
    """Whether these bytes say that a passphrase locks them."""
    return data.lstrip().startswith(_BEGIN)


def lock(data: bytes, passphrase: str, token: Callable[[int], bytes]) -> bytes:
    """The locked form, text. UsageFault if the passphrase is too short or too long. Takes some 0.3 s and 128 MiB: for a worker thread."""
    _check(passphrase)
    salt, nonce = token(_SALT_BYTES), token(_NONCE_BYTES)
    head = _HEAD.pack(_VERSION, LOG2_N, salt, nonce)
    body = head + AESGCM(_key(passphrase, salt, LOG2_N)).encrypt(nonce, data, head)
    text = base64.b64encode(body + hashlib.sha256(body).digest())
    lines = [text[start : start + _LINE] for start in range(0, len(text), _LINE)]
    return b"\n".join((_BEGIN, *lines, _END, b""))


def unlock(data: bytes, passphrase: str, where: str = "") -> bytes:
    """What was locked. LocalFault if the file is damaged, WrongPassphrase if it is whole and this is not its passphrase."""
    body = _body(data, where)
    version, log2_n, salt, nonce = _HEAD.unpack_from(body)
    if version != _VERSION:
        raise LocalFault(
            f"the file is locked in format {version}, this program knows {_VERSION}", where=where, remedy="update this program"
        )
    if not 1 <= log2_n <= LOG2_N_MAX:
        raise _damaged(where)
    head, ciphertext = body[: _HEAD.size], body[_HEAD.size :]
    try:
        return AESGCM(_key(passphrase, salt, log2_n)).decrypt(nonce, ciphertext, head)
    except InvalidTag:
        raise WrongPassphrase("the passphrase is wrong", where=where, remedy="try again; nobody can tell it to you") from None


def _body(data: bytes, where: str) -> bytes:
    """What stands between the two lines, without the digest that it is checked by."""
    text = data.strip()
    if not text.startswith(_BEGIN) or not text.endswith(_END):
        raise _damaged(where)
    inside = b"".join(text[len(_BEGIN) : -len(_END)].split())
    try:
        whole = base64.b64decode(inside, validate=True)
    except (binascii.Error, ValueError):
        raise _damaged(where) from None
    if base64.b64encode(whole) != inside:
        raise _damaged(where)  # Bits that mean nothing have been changed all the same.
    body, digest = whole[:-_DIGEST_BYTES], whole[-_DIGEST_BYTES:]
    if len(body) < _HEAD.size + _TAG_BYTES or not hmac.compare_digest(hashlib.sha256(body).digest(), digest):
        raise _damaged(where)
    return body


def _damaged(where: str) -> LocalFault:
    return LocalFault("the locked file is damaged", where=where, remedy="restore it from another copy")


def _check(passphrase: str) -> None:
    if not PASSPHRASE_CHARACTERS_MIN <= len(passphrase) <= PASSPHRASE_CHARACTERS_MAX:
        bounds = f"{PASSPHRASE_CHARACTERS_MIN} to {PASSPHRASE_CHARACTERS_MAX}"
        raise UsageFault(f"a passphrase has {bounds} characters, not {len(passphrase)}", remedy="take four or more random words")


def _key(passphrase: str, salt: bytes, log2_n: int) -> bytes:
    # The same letters may be typed as different characters on another keyboard.
    text = unicodedata.normalize("NFC", passphrase).encode()
    return Scrypt(salt=salt, length=_KEY_BYTES, n=1 << log2_n, r=8, p=1).derive(text)
