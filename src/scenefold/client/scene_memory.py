"""How far a scene was when it was met last, beyond the end of a process: no node may lead back from there (specs/16-scene-log.md, Following).

Old headers are as well signed as new ones. Whoever believed one would seal under a key that a former member has, and take what that one
writes. And a node that decides a position twice shows two headers, each as well signed as the other: whoever took one takes no other.
"""

from __future__ import annotations

import hashlib
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
    """The newest position and key epoch that were met. `header_hash`: of what was signed of the header there; b"" if that is not known."""

    position: int
    key_epoch: int
    header_hash: bytes = b""

    @classmethod
    def by(cls, header: SceneLogPublic) -> Self:
        """Once this header was met."""
        return cls(header.position, header.key_epoch, hashlib.sha256(header.signable()).digest())


class SceneMemory:
    """Of one scene. What is met is written when `keep` is called."""

    def __init__(self, met: Met) -> None:
        self.met = met
        self._kept: KeptScene | None = None
        self._write: Callable[[KeptScene], Awaitable[None]] | None = None
        self._is_new = self._has_reported = False
        self._writing = trio.Lock()

    @classmethod
    def of(cls, kept: KeptScene, write: Callable[[KeptScene], Awaitable[None]]) -> Self:
        """With the keyring's entry, and what writes a newer one."""
        memory = cls(Met(kept.position, kept.key_epoch, kept.header_hash))
        memory._kept, memory._write = kept, write
        return memory

    def forbids(self, header: SceneLogPublic) -> bool:
        """Whether this header must not count: it is older, or another one of the same position."""
        return header.position < self.met.position or header.key_epoch < self.met.key_epoch or self.contradicts(header)

    def contradicts(self, header: SceneLogPublic) -> bool:
        """Whether this is another header of the position of that which was met."""
        return header.position == self.met.position and self.met.header_hash not in (b"", Met.by(header).header_hash)

    def report(self, header: SceneLogPublic, name: str) -> None:
        """Tell, once, that a header that was verified contradicts the one that was met."""
        if not self._has_reported:
            self._has_reported = True
            _log.warning("scene %s: its node decided position %d twice; the header that was met first counts here", name, header.position)

    def meets(self, header: SceneLogPublic, sealing: SealingKey | None) -> None:
        """A header that was verified, and is not forbidden."""
        self.met = Met.by(header)
        if self._kept is None or (header.position, True) <= (self._kept.position, bool(self._kept.header_hash)):
            return
        kept = replace(self._kept, position=header.position, header_hash=self.met.header_hash)
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
        """If nodes show only headers that are forbidden."""
        what = f"only older headers of the scene are shown than that of position {self.met.position}, which was met before"
        if self._has_reported:
            what = f"another header of position {self.met.position} is shown than the one that was met before"
        remedy = (
            "start the other nodes; if they lost it for ever, remove the scene's file from `scenes/` of the profile, and be granted it anew"
        )
        return Refused(RejectReason.NOT_READY, what, where=f"scene {name}", remedy=remedy)
