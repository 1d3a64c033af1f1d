"""The scenes that a cluster's headers show, and those that somebody has granted us: whose word that is, is looked at (specs/16-scene-log.md, Members)."""

from __future__ import annotations

import logging
from collections.abc import Awaitable, Callable, Sequence

from scenefold.base.errors import DamagedData, LocalFault, PeerFault, Refused
from scenefold.client.calls import Calls
from scenefold.client.gifts import Gift, gifts_in
from scenefold.client.grants import USER
from scenefold.client.listed_headers import ListedHeaders
from scenefold.crypto import Card, MemberSecrets
from scenefold.scene.log import check_granter
from scenefold.wire import SceneLogPublic, SceneMode

_log = logging.getLogger("scenefold.client")


class GivenScenes:
    """Of one user."""

    def __init__(
        self, calls: Calls, listed: ListedHeaders, me: str, secrets: MemberSecrets, card_of: Callable[[str], Awaitable[Card]] | None
    ) -> None:
        """`me`: the name in our certificate. `card_of`: verified cards, by which we know who grants us a scene; None: whoever it is, is believed."""
        self._calls, self._listed, self._me, self._secrets, self._card_of = calls, listed, me, secrets, card_of

    async def named(self, name: str) -> Sequence[Gift]:
        """What was granted to us under this id; if nothing, under this name. A grant may be so new that few nodes have heard of it: if nothing fits, more are asked."""
        return await self._named(name, await self._listed.of_some()) or await self._named(name, await self._listed.of_many())

    async def _named(self, name: str, headers: Sequence[SceneLogPublic]) -> Sequence[Gift]:
        given = (await self.among([header for header in headers if header.mode is not SceneMode.ENDED])).values()
        return [gift for gift in given if name == f"{gift.header.scene:08x}"] or [gift for gift in given if name == gift.contents.name]

    async def among(self, headers: Sequence[SceneLogPublic]) -> dict[bytes, Gift]:
        """What headers hold for us, by genesis: what a user of this cluster has sealed, as his card shows."""
        gifts = await self._calls.world.workers.run("crypto", gifts_in, headers, self._secrets.sealing)
        known: dict[str, Card | None] = {self._me: None}
        believed = {}
        for gift in gifts:
            try:
                if self._card_of is not None:
                    await self._check_granter(gift, known)
                believed[gift.header.genesis] = gift
            except (DamagedData, LocalFault, Refused, PeerFault) as problem:
                _log.warning("scene %08x: what it holds for us is not believed: %s", gift.header.scene, problem)
        return believed

    async def _check_granter(self, gift: Gift, known: dict[str, Card | None]) -> None:
        assert self._card_of is not None
        granter = gift.contents.granter
        if not granter.startswith(USER):
            raise DamagedData(f"{granter or 'nobody'} grants it, and is no user")
        if granter == self._me:
            key = self._secrets.signing.public
        else:
            card = known.get(granter) or await self._card_of(granter)
            known[granter] = card
            key = card.keys.signing
        check_granter(gift.lockbox, gift.contents, gift.header.genesis, key)
