"""Who has to be heard before a gap counts as recovered (specs/20-copies.md, Recovery). Pure.

Everybody that the log names when the asking begins. Who joins later is a new incarnation: it holds nothing for anybody, and what is on its
disk are strays. Who is removed need not be heard, but its leases must be over: by what only it knows somebody might still be answered.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from scenefold.base.ids import SceneId, SpaceId
from scenefold.base.location import Arc, Location
from scenefold.base.placement import Layout
from scenefold.crypto import object_of, version_key, wanted_place
from scenefold.peer.cluster_log.registry import Registry
from scenefold.peer.copies.copies import Copies
from scenefold.peer.copies.entries import Entry, clipped
from scenefold.peer.copies.losses import Loss, losses_in
from scenefold.peer.copies.numbers import first_number
from scenefold.store import Put
from scenefold.wire import Member

HUSKS_MAX = 16_384
"""Remembered until all were heard. Where more has rotted, what is beyond is as lost as if its disk were."""


LOUDEST = 3
"""Nodes that are told to people where there are more pieces than can be kept."""


class Roll:
    """Of one asking about one gap; a restart begins another one."""

    def __init__(self, gap: Arc, position: int, me: Member, registered: Iterable[Member]) -> None:
        """`position`: of the cluster's log, and who was registered there. This node knows what is on its own disk."""
        self.gap = gap
        self.position = position
        self.asked = tuple(sorted(set(registered) - {me}, key=lambda member: (member.node, member.incarnation)))
        self._heard: dict[Member, tuple[Entry, ...]] = {}
        self._lost: set[Member] = set()
        self._husks: dict[tuple[SceneId, SpaceId, bytes], Put] = {}

    @property
    def number(self) -> int:
        """Below it whoever answers takes nothing in the gap any more; here the numbers of its owner begin."""
        return first_number(self.position)

    def missing(self) -> list[Member]:
        """Who is still to be heard."""
        return [member for member in self.asked if member not in self._heard and member not in self._lost]

    def hear(self, member: Member, entries: Sequence[Entry]) -> None:
        """All that a node has of the gap is here."""
        self._heard[member] = tuple(entries)

    def lose(self, member: Member) -> None:
        """The log has removed a node, and T_wait has passed since this node learnt that. What it has said before counts."""
        self._lost.add(member)

    def loudest(self) -> list[tuple[Member, int]]:
        """Who has named the most pieces that are held, and how many."""
        counts = sorted(
            ((member, len(entries)) for member, entries in self._heard.items() if entries), key=lambda one: (-one[1], one[0].node)
        )
        return counts[:LOUDEST]

    def note_husk(self, husk: Put) -> None:
        """This is left somewhere of a version that has rotted. Of one record the newest counts."""
        header = husk.record.header
        name = header.scene, header.space, object_of(header) or header.location
        known = self._husks.get(name)
        is_newer = known is not None and version_key(known.record.header) < version_key(header)
        if is_newer or (known is None and len(self._husks) < HUSKS_MAX):
            self._husks[name] = husk

    def husks(self, arc: Arc) -> list[Put]:
        """What is left of records with their homes in an arc: to be kept where nothing sound is there, once all were heard."""
        return [husk for husk in self._husks.values() if husk_home(husk) in arc]

    def recover(self, copies: Copies) -> Copies:
        """What is known about copies once the gap is recovered; only when nobody is missing."""
        assert not self.missing()
        return copies.recover(self.gap, self._heard, self.number)

    def losses(self, copies: Copies, layouts: Mapping[Layout, int], registry: Registry, *, remembers: bool) -> list[Loss]:
        """What may be lost for all that was heard; only when nobody is missing. `layouts`: of the known scenes, and what each asks of a write.

        `remembers`: whether this node has not been started since it adopted any of the gap.
        """
        assert not self.missing()
        # What this node itself held there became its own, and no entry, when it adopted the gap.
        me = copies.configurations.me
        heard = {**self._heard, me: clipped(copies.formerly, self.gap)}
        return losses_in(me, self.gap, layouts, heard, registry.is_lost, registry.lost, remembers=remembers)


def husk_home(husk: Put) -> Location:
    object_id = object_of(husk.record.header)
    return wanted_place(object_id) if object_id else husk.record.header.location
