"""How a private key stands in a file: a seed in hexadecimal (suite 1), or PKCS #8 as PEM (suite 2); specs/04-records.md, Files of keys."""

from __future__ import annotations

from scenefold.base.errors import LocalFault
from scenefold.crypto.rsa3072 import PEM_BEGIN
from scenefold.crypto.suites import ED25519, RSA3072


def secret_to_text(secret: bytes, suite: int) -> bytes:
    """What stands in the file of a key."""
    return secret if suite == RSA3072 else secret.hex().encode() + b"\n"


def secret_from_text(text: bytes) -> tuple[bytes, int]:
    """A private key and its suite; LocalFault if the text is of neither form. Whether it is a key, say keys.py and sealing_keys.py."""
    if text.lstrip().startswith(PEM_BEGIN):
        return text, RSA3072
    try:
        secret = bytes.fromhex(text.decode("ascii"))
    except ValueError:
        raise LocalFault("neither hexadecimal digits nor PEM") from None
    return secret, ED25519
