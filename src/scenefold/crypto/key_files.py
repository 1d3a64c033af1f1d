"""How a private key stands in a file: a seed in hexadecimal (suite 1), or PKCS #8 as PEM (suite 2); specs/04-records.md, Files of keys."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar, Self

from scenefold.base.errors import LocalFault
from scenefold.crypto.rsa3072 import PEM_BEGIN
from scenefold.crypto.secrets_on_disk import read_secret, write_secret
from scenefold.crypto.suites import DEFAULT_SUITE, ED25519, RSA3072, suite_of

SEED_BYTES = 32


class KeptKey:
    """A private key of either suite that is kept in a file of its own. What it does, say keys.py and sealing_keys.py."""

    __slots__ = ("_secret", "suite")

    WHAT: ClassVar[str] = "key"
    """What it is called where it is missed."""

    def __init__(self, secret: bytes, suite: int = DEFAULT_SUITE) -> None:
        """`secret`: 32 bytes, or in suite 2 a PEM; LocalFault if it has another length."""
        self.suite = suite_of(suite).number
        self._secret = bytes(secret)
        if self.suite != RSA3072 and len(secret) != SEED_BYTES:
            raise LocalFault(f"a {self.WHAT} has {SEED_BYTES} bytes, not {len(secret)}")

    @classmethod
    def from_file(cls, path: Path) -> Self:
        """The key in a file, of either suite; LocalFault if it is missing, exposed or none."""
        return cls.from_text(read_secret(path), str(path))

    @classmethod
    def from_text(cls, text: bytes, where: str) -> Self:
        """The key that `to_text` made, of either suite; LocalFault naming `where` if it is none."""
        try:
            return cls(*_secret_in(text))
        except LocalFault:
            raise LocalFault(f"the file holds no {cls.WHAT}", where=where, remedy="restore it from a backup") from None

    def to_file(self, path: Path) -> None:
        """Writes the key as its suite says, mode 0600; LocalFault if the file exists."""
        write_secret(path, self.to_text())

    def to_text(self) -> bytes:
        """What stands in the file of the key: a seed in hexadecimal, or a PEM."""
        return self._secret if self.suite == RSA3072 else self._secret.hex().encode() + b"\n"

    @property
    def secret(self) -> bytes:
        """What the key is made from: see `__init__`."""
        return self._secret

    @property
    def seed(self) -> bytes:
        """The 32 bytes of a key of suite 1; others have none."""
        assert self.suite == ED25519, "an RSA key has no seed"
        return self._secret


def _secret_in(text: bytes) -> tuple[bytes, int]:
    """A private key and its suite; LocalFault if the text is of neither form."""
    if text.lstrip().startswith(PEM_BEGIN):
        return text, RSA3072
    try:
        return bytes.fromhex(text.decode("ascii")), ED25519
    except ValueError:
        raise LocalFault("neither hexadecimal digits nor PEM") from None
