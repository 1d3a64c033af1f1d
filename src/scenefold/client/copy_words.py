"""What holders of copies say of records, and when that counts like the owner's word (specs/20-copies.md, Reads). Pure.

A write is acknowledged once `needed` of the members of a configuration have it. So of any |H| - needed + 1 members one has it, or
something newer: once as many that are not the owner have said, under one configuration, what they have, nothing newer than the newest of
that was acknowledged. What is read must not be lost more easily than what was acknowledged: so with the owner, from whom they have it, those
who have that newest version must be `needed`. Holders name that configuration themselves. A single one of them must not be able to name one
in which it decides alone: so at least as many must have been heard as follow from the scene's header, which its owner has signed.
"""

from __future__ import annotations

from collections.abc import Mapping, Set
from contextlib import suppress

from scenefold.base.ids import NodeId
from scenefold.crypto import IllFormedRecord, RecordHeader, Version, version_key, version_of
from scenefold.wire import Configuration, CopiesFound, Copy, CopyState, RecordBytes

NOTHING = b""
"""The version of what is not there."""


def word_of(copy: Copy) -> bytes | None:
    """Which version a holder says is there; None if it cannot say."""
    match copy.state:
        case CopyState.NOTHING:
            return NOTHING
        case CopyState.DIGEST:
            return copy.digest
        case CopyState.RECORD if copy.record is not None:
            return version_of(copy.record.header)
        case _:
            return None


def is_stray(reply: CopiesFound, copy: Copy) -> bool:
    """Whether who answers has the record by no right: it shows it to who takes any copy, under a configuration of itself alone."""
    return copy.state is CopyState.RECORD and reply.holders[copy.holders].number == 0


def quorum(copies: int, needed: int) -> int:
    """Of so many members, of whom so many have what was acknowledged, as many as this cannot all lack it."""
    return max(1, copies - needed + 1)


class CopyWords:
    """Of one record."""

    def __init__(self, copies: int, needed: int, owners: frozenset[NodeId]) -> None:
        """`copies`, `needed`: by the scene's header; a configuration may ask for more. `owners`: who may own its place, as the reader knows."""
        self._quorum = quorum(copies, needed)
        self._having = needed - 1
        self._owners = owners
        self._said: dict[Configuration, dict[NodeId, bytes]] = {}
        self._records: dict[bytes, RecordBytes] = {}
        self._orders: dict[bytes, Version] = {}

    def hear(self, node: NodeId, configuration: Configuration, copy: Copy, *, is_forged: bool = False) -> None:
        """A node says something; it takes the place of what it has said before. What it has no part in does not count.

        `is_forged`: of what it gives only the version counts.
        """
        owner, *holders = configuration.members
        word = word_of(copy)
        if word is None or owner.node not in self._owners or node not in {member.node for member in holders}:
            return
        if copy.record is not None and not is_forged:
            self._records[word] = copy.record
            with suppress(IllFormedRecord):
                self._orders[word] = version_key(RecordHeader.decode(copy.record.header))
        self._said.setdefault(configuration, {})[node] = word

    def otherwise(self, version: bytes) -> set[NodeId]:
        """Who has said something else than that."""
        return {node for said in self._said.values() for node, word in said.items() if word != version}

    def named_by(self, node: NodeId) -> set[NodeId]:
        """Who holds copies by what this one has said, the owner left out."""
        return {member.node for configuration, said in self._said.items() if node in said for member in configuration.members[1:]}

    @property
    def is_silence(self) -> bool:
        """Whether nobody has said anything that may count."""
        return not self._said

    def unordered(self) -> set[NodeId]:
        """Enough were heard, and they differ, and of what these say it is not known yet how new it is."""
        return {
            node
            for configuration, said in self._said.items()
            if self._is_heard(configuration, said) and len(set(said.values())) > 1
            for node, word in said.items()
            if word != NOTHING and word not in self._orders
        }

    @property
    def version(self) -> bytes | None:
        """The version that counts; None as long as none does."""
        for configuration, said in self._said.items():
            if self._is_heard(configuration, said):
                newest = self._newest(set(said.values()))
                having = sum(word == newest for word in said.values())
                if newest is not None and having >= max(1, self._having, configuration.needed - 1):
                    return newest
        return None

    def _is_heard(self, configuration: Configuration, said: Mapping[NodeId, bytes]) -> bool:
        return len(said) >= max(self._quorum, configuration.quorum)

    def _newest(self, words: Set[bytes]) -> bytes | None:
        """None if that cannot be known: a word is of an order that nobody has shown."""
        if len(words) == 1:
            return next(iter(words))
        versions = words - {NOTHING}
        return max(versions, key=self._orders.__getitem__) if versions <= self._orders.keys() else None

    def is_here(self) -> bool:
        """Whether it is known what counts, with its bytes."""
        version = self.version
        return version is not None and (version == NOTHING or version in self._records)

    @property
    def record(self) -> RecordBytes | None:
        """What counts, once it is here; None if nothing is there."""
        version = self.version
        assert version is not None
        return None if version == NOTHING else self._records[version]
