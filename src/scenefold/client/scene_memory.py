"""How far a scene was when it was met last, beyond the end of a process: no node may lead back from there (specs/16-scene-log.md, Following).

Old headers are as well signed as new ones. Whoever believed one would seal under a key that a former member has, and take what that one
writes.
"""

from __future__ import annotations

import logging
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, replace
from typing import Self

import trio

from scenefold.base.errors import LocalFault, Refused
from scenefold.base.reasons import RejectReason
from scenefold.crypto import SealingKey
from scenefold.scene.log import own_lockbox
from scenefold.wire import SceneLogPublic
from scenefold.world.keyring import KeptScene

_log = logging.getLogger("scenefold.client")


@dataclass(frozen=True, slots=True)
class Met:
    """The newest position and key epoch that were met."""

    position: int
    key_epoch: int


class SceneMemory:
    """Of one scene. What is met is written when `keep` is called."""

    def __init__(self, met: Met) -> None:
        self.met = met
        self._kept: KeptScene | None = None
        self._write: Callable[[KeptScene], Awaitable[None]] | None = None
        self._is_new = False
        self._writing = trio.Lock()

    @classmethod
    def of(cls, kept: KeptScene, write: Callable[[KeptScene], Awaitable[None]]) -> Self:
        """With the keyring's entry, and what writes a newer one."""
        memory = cls(Met(kept.position, kept.key_epoch))
        memory._kept, memory._write = kept, write
        return memory

    def is_newer_than(self, header: SceneLogPublic) -> bool:
        """Whether this header must not count any more."""
        return header.position < self.met.position or header.key_epoch < self.met.key_epoch

    def meets(self, header: SceneLogPublic, sealing: SealingKey | None) -> None:
        """A header that was verified, and is not older."""
        self.met = Met(header.position, header.key_epoch)
        if self._kept is None or header.position <= self._kept.position:
            return
        kept = replace(self._kept, position=header.position)
        own = None if sealing is None else own_lockbox(header, sealing)
        if own is not None:
            # Who has none any more keeps the last one: what lies under its key can still be read.
            kept = replace(kept, header_key=header.public_key, key_epoch=header.key_epoch, lockbox=own[0])
        self._kept, self._is_new = kept, True

    async def keep(self) -> None:
        """Durable from here on."""
        if not self._is_new:
            return
        async with self._writing:
            kept = self._kept
            if not self._is_new or kept is None or self._write is None:
                return
            try:
                await self._write(kept)
            except LocalFault as problem:
                # The scene can be used all the same; what is lost is the memory, and the user should know.
                _log.warning("how far a scene is cannot be kept, so a later start may be shown an older state of it: %s", problem)
            self._is_new = self._kept is not kept

    def refusal(self, name: str) -> Refused:
        """For a header that is older than what was met."""
        what = f"only older headers of the scene are shown than that of position {self.met.position}, which was met before"
        remedy = (
            "start the other nodes; if they lost it for ever, remove the scene's file from `scenes/` of the profile, and be granted it anew"
        )
        return Refused(RejectReason.NOT_READY, what, where=f"scene {name}", remedy=remedy)
