"""The life that this process asks for leases under, drawn anew every minute (specs/15-cluster-log.md, Lives).

What an earlier process left on the disk serves to learn that the voter granted it, and for nothing else: a lease counts only
under a life that this process has drawn, not longer than LIFE_S before it asked.
"""

from __future__ import annotations

import logging
import math

from scenefold.base.errors import DamagedData, Refused
from scenefold.peer.cluster_log.lives import LIFE_BYTES, NO_LIFE, Lives, drawn_from, unpack_lives
from scenefold.peer.timing import LIFE_S, RENEW_S
from scenefold.store import Store
from scenefold.world import World
from scenefold.world.quiet import QuietLog

NOTE = "cluster-log/lives"

_log = logging.getLogger("scenefold.peer.cluster_log.lease")


class OwnLife:
    """Used by the lease alone, one call at a time."""

    def __init__(self, world: World, store: Store) -> None:
        self._world = world
        self._store = store
        self._quiet = QuietLog(_log)
        self._lives = Lives()
        self._is_granted = True
        self._ends_at = -math.inf

    @property
    def lives(self) -> Lives:
        """What to ask with: as it is on the disk."""
        return self._lives

    async def load(self) -> None:
        """Take what earlier processes left."""
        data = await self._store.get_note(NOTE)
        try:
            self._lives = Lives() if data is None else unpack_lives(data)
        except DamagedData as damage:
            # The voter will not know what is drawn next, and this node begins anew.
            _log.error("%s", damage)
        self._is_granted = self._lives.now == NO_LIFE

    async def renew(self) -> None:
        """Draw the next life if it is time and the last was granted; durable on return.

        Refused if the disk has no room and this process has drawn none yet. Later on, the old life serves on meanwhile.
        """
        now = self._world.clock.now()
        if not self._is_granted or now < self._ends_at:
            return
        lives = self._lives.after(drawn_from(self._world.entropy.token(LIFE_BYTES)))
        try:
            await self._store.put_note(NOTE, lives.pack())
        except Refused as refusal:
            if self._ends_at == -math.inf:
                raise
            self._quiet.say(now, "life", "life", f"no new life can be written, so the old one serves on: {refusal}")
            self._ends_at = self._world.clock.now() + RENEW_S
            return
        self._lives, self._is_granted, self._ends_at = lives, False, now + LIFE_S

    def granted(self, asked_at: float) -> bool:
        """Note that the voter granted what was asked then; whether it counts as a lease."""
        self._is_granted = True
        return asked_at < self._ends_at
