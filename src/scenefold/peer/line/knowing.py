"""Which nodes are known to know that copies of spaces have changed (specs/23-turns.md, Who knows).

What a holder answers by is the newest header that it has. So an owner goes by what others have shown of theirs, and says nothing of who holds
what, and gives nothing away, to whom it would be news. In memory: asking again costs a round trip.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Mapping, Sequence

import trio

from scenefold.base.errors import Refused
from scenefold.base.ids import SceneId, address_of
from scenefold.base.reasons import RejectReason
from scenefold.wire import Member, SceneTurn


class Knowing:
    """Used from the Trio thread only. `view`: of each scene with a space that has turned, where the last one did, as this node knows.

    Nothing has turned, and nobody need know anything, unless somebody says so.
    """

    def __init__(self) -> None:
        self.view: Callable[[], Mapping[SceneId, int]] = dict
        self.teach: Callable[[Member], Awaitable[None]] = _nothing
        """Returns once that one has shown that it knows this node's view. Refused, Unreachable or PeerFault: not now."""
        self.learn: Callable[[Member, Sequence[SceneTurn]], Awaitable[None]] = _nothing
        """Returns once this node knows these turns, which that one named. Refused or Unreachable: not now; PeerFault: they cannot be."""
        self.news = 0
        """How often something was learnt of anybody."""
        self._known: dict[Member, dict[SceneId, int]] = {}
        self._learnt = trio.Event()

    def knows(self, member: Member, scene: SceneId, position: int) -> bool:
        return self._known.get(member, {}).get(scene, 0) >= position

    def knows_all(self, member: Member) -> bool:
        """Whether it knows all that this node knows at this moment."""
        return all(self.knows(member, scene, position) for scene, position in self.view().items())

    def require(self, member: Member) -> None:
        """Refused (16) before that."""
        if not self.knows_all(member):
            raise Refused(RejectReason.NOT_READY, f"{address_of(member.node)} may not know yet which spaces have other copies now")

    async def ensure(self, member: Member) -> None:
        """Return when it is known to know all that this node knows. Refused, Unreachable or PeerFault: not now."""
        if not self.knows_all(member):
            await self.teach(member)
        self.require(member)

    def note(self, member: Member, scene: SceneId, position: int) -> None:
        """It has shown a header of this position."""
        if not self.knows(member, scene, position):
            self._known.setdefault(member, {})[scene] = position
            self.news += 1
            self._learnt.set()
            self._learnt = trio.Event()

    async def changed_after(self, news: int) -> None:
        """Return once more is known of anybody than when there were so many news."""
        while self.news == news:
            await self._learnt.wait()


async def _nothing(*_: object) -> None:
    """Before anybody can be asked."""
