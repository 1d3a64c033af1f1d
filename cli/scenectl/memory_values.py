"""Amounts of memory as options; see values.py."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Annotated, Self

from scenectl.values import ONE_WORD

_UNITS = {"kib": 2**10, "mib": 2**20, "gib": 2**30, "tib": 2**40, "kb": 10**3, "mb": 10**6, "gb": 10**9, "tb": 10**12}
_AMOUNT = re.compile(r"(\d{1,9}(?:\.\d{1,9})?) ?([kmgt]i?b)", re.ASCII | re.IGNORECASE)
MOST = 2**44


@dataclass(frozen=True)
class Memory:
    """An amount of memory with its unit, as 512MiB or 1.5GiB."""

    bytes: int

    @classmethod
    def parse(cls, text: str) -> Self:
        found = _AMOUNT.fullmatch(text.strip())
        if found is None:
            raise ValueError(f"an amount of memory is expected, as 512MiB or 1.5GiB, not {text[:80]!r}")
        amount = int(float(found[1]) * _UNITS[found[2].lower()])
        if not 0 < amount <= MOST:
            raise ValueError(f"an amount of memory above 0, and up to 16TiB, is expected, not {text[:80]!r}")
        return cls(amount)

    def __str__(self) -> str:
        return f"{self.bytes / 2**20:g}MiB"


MemoryOption = Annotated[Memory, ONE_WORD]
