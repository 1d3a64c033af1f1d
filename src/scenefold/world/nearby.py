"""Whom a newcomer asks of those who answered its broadcast: bounded, and by chance (specs/15-cluster-log.md, Discovery). Pure.

Answers are signed by nobody, and one neighbour can send them from as many addresses as it likes. So neither who answers first nor who
answers most is chosen, but each source by a number that is drawn for it; before all others, who names the address that it answers from.
"""

from __future__ import annotations

from hashlib import blake2b
from itertools import zip_longest

from scenefold.base.ids import NodeId, address_of

FOUND_MAX = 16
"""Nodes that are chosen in one look around."""
SOURCES_MAX = 64
"""Addresses whose answers are remembered."""
NAMED_MAX = 8
"""Nodes that are remembered of each."""
CHANCE_BYTES = 16
_DRAWN_BYTES = 8

Place = tuple[bool, bytes]
"""What comes first is smaller: who names itself, then by chance."""


class Nearby:
    """The answers to one question. `chance`: random bytes, on which together with what was answered depends who is chosen."""

    def __init__(self, chance: bytes) -> None:
        self._chance = chance
        self._named: dict[str, dict[NodeId, Place]] = {}
        self._places: dict[str, Place] = {}

    def hear(self, source: str, node: NodeId) -> None:
        """One more answer. Said again, it changes nothing."""
        named = self._named.setdefault(source, {})
        named[node] = (address_of(node) != source, self._drawn(f"{source} {node}"))
        if len(named) > NAMED_MAX:
            del named[max(named, key=named.__getitem__)]
        self._places[source] = (min(named.values())[0], self._drawn(source))
        if len(self._places) > SOURCES_MAX:
            last = max(self._places, key=self._places.__getitem__)
            del self._places[last], self._named[last]

    def chosen(self) -> list[NodeId]:
        """Whom to ask, in this order. Of a source that names several, the second comes behind the first of all others."""
        in_order = sorted(self._places, key=self._places.__getitem__)
        turns = zip_longest(*(sorted(self._named[source], key=self._named[source].__getitem__) for source in in_order))
        return list(dict.fromkeys(node for turn in turns for node in turn if node is not None))[:FOUND_MAX]

    def _drawn(self, what: str) -> bytes:
        return blake2b(what.encode(), key=self._chance, digest_size=_DRAWN_BYTES).digest()
