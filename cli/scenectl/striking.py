"""One node of a cluster that was started for a render is killed in the midst of it: whoever watches sees that the image does not suffer."""

from __future__ import annotations

from typing import TYPE_CHECKING

import trio

from scenectl.output import note

if TYPE_CHECKING:
    from scenefold.node.local import LocalCluster

SHARE = 4
"""It dies once a quarter of all passes are closed."""


class Strike:
    """Of one render. `seen` is told how far it is, `spare` who must live."""

    def __init__(self, embedded: LocalCluster) -> None:
        self._embedded = embedded
        self._spared = ""
        self._due = trio.Event()
        self.killed: list[str] = []

    def spare(self, address: str) -> None:
        """The node that organises the render: if that one died, it would be begun anew."""
        self._spared = address

    def seen(self, phase: str, done: int, total: int) -> None:
        """How far the render is."""
        if phase == "render" and total and done * SHARE >= total and done < total:
            self._due.set()

    async def run(self) -> None:
        """Wait until it is time, and kill; return then."""
        await self._due.wait()
        # The first node decides alone who has a lease: what it is needed for shall not be seen here.
        others = [address for address in self._embedded.addresses[1:] if address != self._spared]
        if others:
            victim = others[len(others) // 2]
            note(f"node {victim} is killed on purpose, to see that the image does not suffer (--no-kill: leave it alone)")
            self._embedded.crash(victim)
            self.killed.append(victim)
