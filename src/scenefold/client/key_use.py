"""How often one run of a client has sealed under a scene's key (specs/04-records.md, Record).

Nonces are random: at 2^32 records under a key the chance that any two are equal is 2^-33, and it grows with the square. No writer knows
how many the others seal, nor what earlier runs did, so each is held to a sixteenth of that.
"""

from __future__ import annotations

from collections import Counter

from scenefold.base.errors import LocalFault

SEALED_MAX = 2**28
"""At the 2,300 records a second that a store commits at best, this is a day and a half without a pause."""


class KeyUse:
    """Of one client: what was sealed under each key, by genesis of the scene and epoch. To open a scene anew begins nothing anew."""

    def __init__(self) -> None:
        self._sealed = Counter[tuple[bytes, int]]()

    def take(self, genesis: bytes, key_epoch: int, count: int, where: str) -> None:
        """Before so many more are sealed. LocalFault if they would be too many under this key."""
        if self._sealed[genesis, key_epoch] + count > SEALED_MAX:
            remedy = "change the key with `scenectl scene rotate-key`; if that is what was going on, go on with --resume"
            raise LocalFault(f"{SEALED_MAX} records were sealed under one key of the scene", where=where, remedy=remedy)
        self._sealed[genesis, key_epoch] += count
