"""May this record be stored here? (Algorithm 6; specs/18-data.md, Writes). Pure; runs in the crypto lane.

In this order, cheapest first: the header is that of the scene with this genesis, and the log has come to its epoch, else nothing definite can be
said of it; the scene's public header lists the space, and the writer for that epoch; it is that of the place it is offered for; the epoch is not below
the write floor, and the scene's mode allows it; the signature and the digest of the ciphertext are right. Nothing here needs the scene's key: a node cannot read what it stores.

Copies that another node hands over are verified alike, but for the write floor and former keys: they were accepted once, and must
be movable in every mode. Of an epoch that has not come, or under a key that the scene does not have yet, no record was ever accepted.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple, TypeVar

from scenefold.base.errors import DamagedData, Refused
from scenefold.base.ids import KeyId, SceneId, SpaceId
from scenefold.base.location import Location
from scenefold.base.reasons import RejectReason
from scenefold.crypto import (
    PLACED_BY_NODE,
    SUITES,
    IllFormedRecord,
    PublicKey,
    Record,
    RecordHeader,
    RecordPlace,
    check_claim,
    check_header_signature,
    check_signature,
    claimed_epoch,
    key_id_of,
    object_of,
    placement_of,
    signed_place,
    wanted_place,
)
from scenefold.scene.log import Layouts, Turn
from scenefold.store import Put
from scenefold.wire import HandItem, PutItem, SceneLogPublic, SceneMode, WriterEntry

Item = TypeVar("Item", PutItem, HandItem)


@dataclass(frozen=True, slots=True)
class KnownScene:
    """A verified public header, with its keys unpacked once."""

    public: SceneLogPublic
    keys: Mapping[KeyId, PublicKey]
    writers: Mapping[KeyId, Sequence[WriterEntry]]
    spaces: frozenset[SpaceId]
    managed: frozenset[SpaceId]
    """Those of them in which nodes choose the places."""
    layouts: Mapping[SpaceId, tuple[Location, ...]]
    """Of each space that is no shadow: how far from a record its copies belong, in the order of the shadows' numbers."""
    needed: Mapping[SpaceId, int]
    """Of the same: how many nodes must hold a record before a write counts as done, the owner among them; no more than the layout makes."""
    shadows: Mapping[SpaceId, SpaceId]
    """Of each shadow: the space whose records it holds. Nobody writes to it, reads or lists it."""
    turns: Mapping[SpaceId, Turn]
    """Of each space that has had other copies before (specs/23-turns.md)."""
    outputs: frozenset[SpaceId] | None = None
    """In render mode the spaces that may still be written; None: edit mode."""
    is_ended: bool = False
    """Nothing of the scene is written any more, for ever."""

    @classmethod
    def of(cls, public: SceneLogPublic) -> KnownScene:
        # Who writes with a suite of a later program is none of our writers yet; all others go on.
        keys = {key.key_id: key for key in (PublicKey(entry.raw, entry.suite) for entry in public.keys if entry.suite in SUITES)}
        raws = {entry.raw for entry in public.keys}
        if len(set(map(key_id_of, raws))) != len(raws):
            raise DamagedData("the scene's header holds two keys of one id")
        writers: dict[KeyId, list[WriterEntry]] = {}
        for entry in public.writers:
            writers.setdefault(entry.key, []).append(entry)
        managed = frozenset(entry.space for entry in public.spaces if entry.node_managed)
        spaces = frozenset(entry.space for entry in public.spaces)
        copies = Layouts.of(public.spaces, public.scene)
        outputs = frozenset(entry.space for entry in public.spaces if entry.render_output) if public.mode is SceneMode.RENDER else None
        is_ended = public.mode is SceneMode.ENDED
        parts = copies.offsets, copies.needed, copies.parents, copies.turns
        return cls(public, keys, writers, spaces, managed, *parts, outputs, is_ended)

    @property
    def turned(self) -> int:
        """The position of the last turn of any of its spaces; 0 if none did."""
        return max((turn.position for turn in self.turns.values()), default=0)

    def check_no_shadow(self, space: SpaceId, to_do: str) -> None:
        """Refused (19) for a shadow, in which there is nothing `to_do`: its records are those of its parent, under the parent's keys."""
        parent = self.shadows.get(space)
        if parent is not None:
            what = f"space {space} holds the copies of space {parent}"
            raise Refused(RejectReason.UNKNOWN_SCENE_OR_SPACE, what, remedy=f"{to_do} space {parent}")

    def check_mode(self, header: RecordHeader) -> None:
        """Refused (9) for what must not be written any more (specs/26-modes.md, What storage nodes do in render mode)."""
        if self.is_ended:
            raise Refused(RejectReason.MODE_FORBIDS, f"the scene was ended at position {self.public.position} of its log")
        if header.epoch < self.public.write_floor:
            raise Refused(RejectReason.MODE_FORBIDS, "the record's epoch is below the scene's write floor")
        if self.outputs is not None and header.space not in self.outputs:
            raise Refused(RejectReason.MODE_FORBIDS, f"the scene is in render mode, and space {header.space} holds no output of a render")
        if header.key_epoch < self.public.key_epoch:
            raise Refused(RejectReason.MODE_FORBIDS, "the record is sealed under a former key of the scene")

    def writer_key(self, header: RecordHeader) -> PublicKey:
        """The key of the header's writer, if it may write at the header's epoch; Refused otherwise."""
        entries = self.writers.get(header.writer, ())
        key = self.keys.get(header.writer)
        if key is None or not entries:
            raise Refused(RejectReason.NOT_AUTHORISED, f"key {header.writer:08x} is no writer of the scene")
        for entry in entries:
            if entry.from_position <= header.epoch <= entry.until_position:
                return key
        raise Refused(RejectReason.KEY_REVOKED, f"key {header.writer:08x} may not write at position {header.epoch}")


class Claim(NamedTuple):
    """A record that may be stored if its writer signed it: all has been looked at but the signature and the ciphertext."""

    put: Put
    key: PublicKey


def verified_put(item: PutItem, scene: KnownScene) -> Put:
    """The record to be stored; Refused with the reason why it must not be."""
    return _signed(_claimed_put(item, scene))


def verified_copy(item: HandItem, scene: KnownScene) -> Put:
    """A record that another node hands over; Refused with the reason why it must not be kept."""
    return _signed(_claimed_copy(item, scene))


def _claimed_put(item: PutItem, scene: KnownScene) -> Claim:
    record = Record(item.header, item.signature, item.ciphertext)
    header, key = _claimed(record, item, scene)
    # These two are not asked of copies: an early version let such records in, and they must be movable.
    scene.check_no_shadow(header.space, "write to")
    if header.placement != PLACED_BY_NODE and header.space in scene.managed:
        raise Refused(RejectReason.ILL_FORMED, "nodes choose the places in this space, and the record names one")
    scene.check_mode(header)
    _check_key_epoch(header, scene)
    return Claim(Put(record), key)


def _claimed_copy(item: HandItem, scene: KnownScene, *, or_husk: bool = False) -> Claim:
    record = Record(item.header, item.signature, item.ciphertext)
    header, key = _claimed(record, item, scene, or_husk=or_husk)
    if item.object != object_of(header):
        raise Refused(RejectReason.ILL_FORMED, "the record is that of another object")
    _check_key_epoch(header, scene)
    return Claim(Put(record, at=item.location if item.object else None), key)


def _claimed_copy_or_husk(item: HandItem, scene: KnownScene) -> Claim:
    return _claimed_copy(item, scene, or_husk=True)


def home_of(item: PutItem | HandItem) -> Location:
    """The place whose owner decides about a record: its own, or the one that its object id names. Looks at the header's bytes only."""
    if placement_of(item.header) != PLACED_BY_NODE:
        return item.location
    try:
        header = RecordHeader.decode(item.header)
    except IllFormedRecord:
        return item.location
    object_id = object_of(header)
    return wanted_place(object_id) if object_id else item.location


def _claimed(record: Record, item: PutItem | HandItem, scene: KnownScene, *, or_husk: bool = False) -> tuple[RecordHeader, PublicKey]:
    """The record's header and its writer's key, if it says the right things of itself."""
    try:
        header = record.header
        _check_scene(header, scene)
        key = scene.writer_key(header)
        # Where a node-managed record lies is no business of its writer, so it is no part of what is signed.
        signed_place = header.location if header.placement == PLACED_BY_NODE else item.location
        check_claim(record, key, RecordPlace(item.scene, item.space, signed_place), or_husk=or_husk)
    except DamagedData as problem:
        raise _refused(problem) from problem
    return header, key


def _check_key_epoch(header: RecordHeader, scene: KnownScene) -> None:
    """Refused if the scene has no such key: no owner ever took such a record."""
    if header.key_epoch > scene.public.key_epoch:
        raise Refused(RejectReason.ILL_FORMED, f"the scene has no key of epoch {header.key_epoch}")


def _signed(claim: Claim) -> Put:
    try:
        (check_header_signature if claim.put.is_husk else check_signature)(claim.put.record, claim.key)
    except DamagedData as problem:
        raise _refused(problem) from problem
    return claim.put


def _refused(problem: DamagedData) -> Refused:
    reason = RejectReason.ILL_FORMED if isinstance(problem, IllFormedRecord) else RejectReason.SIGNATURE_INVALID
    return Refused(reason, str(problem))


def _check_scene(header: RecordHeader, scene: KnownScene) -> None:
    if header.genesis != scene.public.genesis:
        raise Refused(RejectReason.ILL_FORMED, "the signed header is that of another scene")
    if header.epoch > scene.public.position:
        # By the header that the author knows there may be another space, or writer: nothing definite can be said. Nor is it stored: versions
        # are ordered by epoch first, so nothing would ever be newer than a record of the last one.
        raise Refused(RejectReason.NOT_READY, f"the scene's header of position {header.epoch} is not here yet")
    if header.space not in scene.spaces:
        raise Refused(RejectReason.UNKNOWN_SCENE_OR_SPACE, f"the scene has no space {header.space}")
    if header.placement == PLACED_BY_NODE and (header.location != signed_place(object_of(header)) or not any(header.location)):
        raise Refused(RejectReason.ILL_FORMED, "a node-managed record names a place, or no object")


def epochs_of(items: Iterable[PutItem | HandItem]) -> dict[SceneId, int]:
    """The scenes of these records, in order, each with the highest log position that one of their authors claims to know.

    Asking for the scene at that position brings the header in which a new space or writer stands, if a push was missed. Who
    claims too much costs a round of asking a second at most, and is refused.
    """
    epochs: dict[SceneId, int] = {}
    for item in items:
        epochs[item.scene] = max(epochs.get(item.scene, 0), claimed_epoch(item.header))
    return dict(sorted(epochs.items()))


def verify_all(claims: Sequence[tuple[PutItem, KnownScene]]) -> list[Put | Refused]:
    """Each item of its scene: the put, or why not. Some 100 microseconds an item, 150 with the largest ciphertext."""
    return _verdicts(_claimed_put, claims)


def verify_copies(claims: Sequence[tuple[HandItem, KnownScene]]) -> list[Put | Refused]:
    """The same for records that another node hands over."""
    return _verdicts(_claimed_copy, claims)


def verify_copies_and_husks(claims: Sequence[tuple[HandItem, KnownScene]]) -> list[Put | Refused]:
    """Likewise, where a husk may be among them: of a record whose ciphertext nobody has sound any more."""
    return _verdicts(_claimed_copy_or_husk, claims)


def _verdicts(claimed: Callable[[Item, KnownScene], Claim], claims: Sequence[tuple[Item, KnownScene]]) -> list[Put | Refused]:
    # First all that Python does, then all that the library does: in turns, each would drive the other's code and data out of
    # the processor's caches, which costs a twentieth (docs/benchmarks.md, Sealing).
    judged: list[Claim | Refused] = []
    for item, scene in claims:
        try:
            judged.append(claimed(item, scene))
        except Refused as refusal:
            judged.append(refusal)
    verdicts: list[Put | Refused] = []
    for claim in judged:
        try:
            verdicts.append(claim if isinstance(claim, Refused) else _signed(claim))
        except Refused as refusal:
            verdicts.append(refusal)
    return verdicts
