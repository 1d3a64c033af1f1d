"""The suites of algorithms that keys and records may be of (specs/04-records.md, Suites).

A suite is a number on the wire and on disk, and a name for people. This file says what is known of each without a key in hand;
keys.py and sealing_keys.py do what it promises. A new suite is a new row here and a branch in those two.
"""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

from scenefold.base.errors import DamagedData, UsageFault


@dataclass(frozen=True, slots=True)
class Suite:
    """One row of the registry."""

    number: int
    name: str
    signature_bytes: int
    public_key_bytes: int
    """Of a key that signs, and of one that is sealed to."""
    exponent: int
    """The public exponent of all its keys; 0 where keys have none."""


ED25519: Final = 1
RSA3072: Final = 2
DEFAULT_SUITE: Final = ED25519

SUITES: Final = MappingProxyType(
    {
        suite.number: suite
        for suite in (
            Suite(ED25519, "ed25519-aes192gcm", signature_bytes=64, public_key_bytes=32, exponent=0),
            Suite(RSA3072, "rsa3072-aes192gcm", signature_bytes=384, public_key_bytes=384, exponent=65537),
        )
    }
)
SUITE_NAMES: Final = tuple(suite.name for suite in SUITES.values())


class UnknownSuite(DamagedData):
    """A suite that this program does not know."""


def suite_of(number: int) -> Suite:
    """The suite with this number; UnknownSuite if there is none."""
    suite = SUITES.get(number)
    if suite is None:
        raise UnknownSuite(f"suite {number} is unknown", remedy="update this program")
    return suite


def suite_named(name: str) -> Suite:
    """The suite with this name; UsageFault if there is none."""
    for suite in SUITES.values():
        if suite.name == name:
            return suite
    raise UsageFault(f"{name!r} is no suite", remedy=f"choose of {', '.join(SUITE_NAMES)}")
