"""Who is asked for which of many records, by what has been said of each since one began to ask. Pure, but for the table.

Who said that a place is not its own is passed over, until all that may own it have; then they begin anew, by a newer table. Who was
named as its owner is asked once, for whoever moved the bound knows best. Nonsense, or a refusal for good, is the last word only if
nobody else is left who may own the place: one that claims what is not its own must not speak for the owner.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from scenefold.base.errors import Refused
from scenefold.base.ids import NodeId
from scenefold.base.location import Location
from scenefold.base.reasons import RejectReason
from scenefold.client.calls import Calls

WAIT = "try again in a while; `scenectl cluster status` shows who is there"


class Search:
    """Of one call for many records, by number; `locations` says where each of them lies."""

    def __init__(self, calls: Calls, locations: Sequence[Location]) -> None:
        self._calls = calls
        self._locations = locations
        self._passed: dict[int, set[NodeId]] = {}
        """Who was asked for a record and is not asked again until all were."""
        self._named: dict[int, NodeId] = {}
        self._hoped: dict[int, set[NodeId]] = {}
        """Who was busy with a record, or named as its owner, at any time."""
        self._disbelieved: set[NodeId] = set()
        self._excuses: dict[int, Refused] = {}
        """What was said last of a record by who may own it, and had no answer."""

    def routed(self, pending: Iterable[int]) -> dict[NodeId, list[int]]:
        """Which of these goes to which node now."""
        routed: dict[NodeId, list[int]] = {}
        for index in pending:
            node = self._named.pop(index, None)
            if node is None:
                passed = self._passed.get(index, set())
                node = self._calls.to_ask(self._locations[index], passed)[0].node_id
                if node in passed:
                    passed.clear()
            routed.setdefault(node, []).append(index)
        return routed

    def passed_on(self, node: NodeId, index: int, owner: NodeId) -> None:
        """The node said that it does not own the record, and who does, or 0."""
        passed = self._passed.setdefault(index, set())
        passed.add(node)
        if owner:
            self._hoped.setdefault(index, set()).add(owner)
        if owner and owner not in passed:
            self._named[index] = owner

    def was_busy(self, node: NodeId, indices: Iterable[int], why: Refused) -> None:
        """The node cannot say anything of these just now."""
        for index in indices:
            self._hoped.setdefault(index, set()).add(node)
            self._excuses[index] = why

    def excuse(self, indices: Sequence[int]) -> Refused:
        """Why there is no answer for these, as far as nodes said."""
        said = next((self._excuses[index] for index in indices if index in self._excuses), None)
        if said is None:
            return Refused(RejectReason.BUSY, f"the owners of {len(indices)} records are busy or keep changing", remedy=WAIT)
        others = f"; {len(indices)} records wait" if len(indices) > 1 else ""
        return Refused(said.reason, f"{said.where} {said.what}{others}", remedy=said.remedy or WAIT)

    def is_last_word(self, node: NodeId, indices: Iterable[int]) -> bool:
        """Whether nonsense, or a lasting refusal, of this node is what the call ends with; if not, it is passed over."""
        return not all(self._is_open(node, index) for index in indices)

    def _is_open(self, node: NodeId, index: int) -> bool:
        if self._hoped.get(index, set()) - self._disbelieved - {node}:
            return True
        if node in self._disbelieved:
            return False
        passed = {node, *self._passed.get(index, ())}
        return any(owner.node_id not in passed for owner in self._calls.table.candidates(self._locations[index]))

    def disbelieve(self, node: NodeId, indices: Iterable[int]) -> None:
        """Pass over a node whose word was not the last one."""
        self._disbelieved.add(node)
        for index in indices:
            self._passed.setdefault(index, set()).add(node)
