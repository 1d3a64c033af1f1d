"""What holders of copies say of records, and when that counts like the owner's word (specs/20-copies.md, Reads). Pure.

A write is acknowledged once `needed` of the members of a configuration have it. So of any |H| - needed + 1 members one has it, or
something newer; and if as many that are not the owner say alike, under one configuration, nothing newer was acknowledged. What is
read must not be lost more easily than what was acknowledged: so with the owner, from whom they have it, they must be `needed`. Holders
name that configuration themselves. A single one of them must not be able to name one in which it decides alone: so at least as many
must say alike as follow from the scene's header, which its owner has signed.
"""

from __future__ import annotations

from scenefold.base.ids import NodeId
from scenefold.crypto import version_of
from scenefold.wire import Configuration, Copy, CopyState, RecordBytes

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


def enough(copies: int, needed: int) -> int:
    """So many holders have to say alike, of a record with so many copies, of which so many are needed."""
    return max(1, copies - needed + 1, needed - 1)


class CopyWords:
    """Of one record. `least`: how many must say alike at least; `owners`: who may own its place, as the reader knows."""

    def __init__(self, least: int, owners: frozenset[NodeId]) -> None:
        self._least = least
        self._owners = owners
        self._said: dict[tuple[Configuration, bytes], set[NodeId]] = {}
        self._records: dict[bytes, RecordBytes] = {}

    def hear(self, node: NodeId, configuration: Configuration, copy: Copy, *, is_forged: bool = False) -> None:
        """A node says something. What it has no part in does not count. `is_forged`: of what it gives only the version counts."""
        owner, *holders = configuration.members
        word = word_of(copy)
        if word is None or owner.node not in self._owners or node not in {member.node for member in holders}:
            return
        if copy.record is not None and not is_forged:
            self._records[word] = copy.record
        self._said.setdefault((configuration, word), set()).add(node)

    def otherwise(self, version: bytes) -> set[NodeId]:
        """Who has said something else than that."""
        return {node for (_, word), nodes in self._said.items() if word != version for node in nodes}

    @property
    def version(self) -> bytes | None:
        """The version that counts; None as long as none does."""
        for (configuration, word), nodes in self._said.items():
            if len(nodes) >= max(self._least, enough(len(configuration.members), configuration.needed)):
                return word
        return None

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
