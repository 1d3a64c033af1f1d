"""The headers of a cluster's scenes, by the word of several nodes: one that has not heard of a scene yet, or hides it, speaks for itself alone (specs/16-scene-log.md, Members)."""

from __future__ import annotations

from collections.abc import Sequence

from scenefold.base.ids import NodeId
from scenefold.base.limits import CLIENT_LOOKED_MAX, CLIENT_OPINIONS, SCENES_KEPT_MAX
from scenefold.client.calls import Calls
from scenefold.client.gifts import believed
from scenefold.wire import ListScenes, SceneLogPublic, ScenesListed, check_page
from scenefold.world import Priority


class ListedHeaders:
    """As one client hears of them."""

    def __init__(self, calls: Calls, origin: NodeId) -> None:
        """`origin`: the node where this client's own scenes begin, so that it knows them before others do; it is always asked."""
        self._calls, self._origin = calls, origin

    async def of_some(self) -> list[SceneLogPublic]:
        """What a few nodes list and what proves itself: of each scene the newest header, by scene id. Unreachable if no node answers."""
        return await self._of(CLIENT_OPINIONS)

    async def of_many(self) -> list[SceneLogPublic]:
        """Likewise by up to CLIENT_LOOKED_MAX nodes: before something is said not to exist."""
        return await self._of(CLIENT_LOOKED_MAX)

    async def _of(self, nodes: int) -> list[SceneLogPublic]:
        lists = await self._calls.several(self._listed_by, first=self._origin, count=nodes)
        # Most nodes say the same, and what is equal is verified once. What is forged must not stand before what is good, however new it calls itself.
        told = list(dict.fromkeys(header for listed in lists for header in listed))
        newest: dict[bytes, SceneLogPublic] = {}
        for header in await self._calls.world.workers.run("crypto", believed, told):
            known = newest.get(header.genesis)
            if known is None or known.position < header.position:
                newest[header.genesis] = header
        return sorted(newest.values(), key=lambda header: (header.scene, header.genesis))

    async def _listed_by(self, address: str) -> Sequence[SceneLogPublic]:
        headers: list[SceneLogPublic] = []
        while len(headers) < SCENES_KEPT_MAX:
            after = headers[-1].scene if headers else 0
            page = await self._calls.ask(address, ListScenes(after), ScenesListed, priority=Priority.HIGH)
            headers += check_page(page, after, address)
            if not page.more:
                break
        return headers
