"""What a reader checks of a record before it believes it, whether it has the scene's key or not (specs/04-records.md). Plain functions for a worker thread.

That it is the record of this very scene, space and location, that a writer whom the scene's header names signed it, and that the
ciphertext is the signed one. Any of these failing is DamagedData; NewerThanKnown where a newer header may tell more.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol, Self

from scenefold.base.errors import DamagedData
from scenefold.base.ids import KeyId, SceneId, SpaceId
from scenefold.base.location import Location
from scenefold.crypto import (
    PLACED_BY_CLIENT,
    PLACED_BY_NODE,
    SUITES,
    PublicKey,
    Record,
    RecordPlace,
    check_claim,
    check_signature,
    signed_place,
)
from scenefold.scene.log import FOR_EVER
from scenefold.wire import RecordBytes, SceneLogPublic, WriterEntry

Key = tuple[SpaceId, Location] | tuple[SpaceId, Location, bytes]
"""Where a record lies; in a node-managed space with its object id."""


class NewerThanKnown(DamagedData):
    """A record that says that it is by a writer, or under a key, that is not known here: both may be younger than what is known.

    `epoch`: the log position that it names; `key_epoch`: that of its key, if that is what is missing.
    """

    epoch = 0
    key_epoch: int | None = None


def newer(what: str, epoch: int, key_epoch: int | None = None) -> NewerThanKnown:
    """The error with what is missing."""
    error = NewerThanKnown(what)
    error.epoch, error.key_epoch = epoch, key_epoch
    return error


@dataclass(frozen=True, slots=True)
class WriterKey:
    """A writer's key, and the log positions that it may sign under."""

    key: PublicKey
    terms: tuple[WriterEntry, ...]

    @classmethod
    def always(cls, key: PublicKey) -> Self:
        """A writer from the beginning on and for ever."""
        return cls(key, (WriterEntry(key.key_id, 0, FOR_EVER),))

    def may_write_at(self, epoch: int) -> bool:
        return any(term.from_position <= epoch <= term.until_position for term in self.terms)


def writers_of(header: SceneLogPublic) -> dict[KeyId, WriterKey]:
    """All writers that a header names in full, those of former times too; DamagedData if an id means two keys."""
    terms: dict[KeyId, list[WriterEntry]] = {}
    for term in header.writers:
        terms.setdefault(term.key, []).append(term)
    keys = [PublicKey(entry.raw, entry.suite) for entry in header.keys if entry.suite in SUITES]
    found = {key.key_id: WriterKey(key, tuple(terms[key.key_id])) for key in keys if key.key_id in terms}
    if len({key.key_id for key in keys}) != len(keys):
        raise DamagedData("the scene's header holds two keys of one id", where=f"scene {header.scene:08x}")
    return found


class PublicScene(Protocol):
    """What a scene's header tells everybody."""

    @property
    def scene(self) -> SceneId: ...
    @property
    def genesis(self) -> bytes: ...
    @property
    def position(self) -> int:
        """The log position of the header."""
        ...

    @property
    def writers(self) -> Mapping[KeyId, WriterKey]: ...


def verified(scene: PublicScene, space: SpaceId, location: Location, object_id: bytes, found: RecordBytes) -> Record:
    """The record, if it is what a writer of the scene put there."""
    record = Record(found.header, found.signature, found.ciphertext)
    header = record.header
    if header.genesis != scene.genesis:
        raise DamagedData("a node answered with the record of another scene")
    writer = scene.writers.get(header.writer)
    if writer is None or not writer.may_write_at(header.epoch):
        when = "" if writer is None else f" at position {header.epoch}"
        raise newer(f"a record by key {header.writer:08x}, which is no writer of the scene{when}", header.epoch)
    # A node-managed record may lie anywhere; that it is this object is what its writer signed.
    place = signed_place(object_id) if object_id else location
    check_claim(record, writer.key, RecordPlace(scene.scene, space, place))
    check_signature(record, writer.key)
    if header.epoch > scene.position:
        # Until that position is known here nobody can tell whether its writer still was one.
        raise newer(f"a record of position {header.epoch}, which the scene has not come to", header.epoch)
    if header.placement != (PLACED_BY_NODE if object_id else PLACED_BY_CLIENT):
        raise DamagedData("a node answered with a record of another kind of space")
    return record
