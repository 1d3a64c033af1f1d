"""A lying node: what it lies in, how often, what it remembers, and how it makes wrong records out of right ones.

It runs the code of all others, and only its mouth lies: its disk holds what an honest one would. It knows the scene's keys,
as if a reader had betrayed them, but no writer's; so nothing but a signature keeps what it makes up from being taken.
"""

from __future__ import annotations

import random
from collections import OrderedDict, deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from enum import Enum

from scenefold.base.location import Location
from scenefold.crypto import PLACED_BY_NODE, RecordHeader, SigningKey, object_of
from scenefold.crypto.record_header import TAG_BYTES
from scenefold.crypto.records import seal_records
from scenefold.simulation.cluster import Node
from scenefold.simulation.history import Digest, Place
from scenefold.simulation.lies import Lies, Manner, Way
from scenefold.wire import RecordBytes, SceneLogPublic, Status

LIES = 0.3
"""Share of what it says that a liar says wrongly."""
PACKETS = 0.5
"""Share of the packets of a handover in which one record is altered."""
WAYS = 12
"""In which a wrong record is made; most often it is made up."""
PLACES_MAX = 512
VERSIONS_MAX = 3
"""Places, and versions of each, that it remembers."""
MADE_UP_MAX = 4_096

Keys = Callable[[], Mapping[int, bytes]]
"""The scene's keys, by epoch; none as long as there is no scene."""


class Scope(Enum):
    """What a node lies in."""

    READS = "reads"
    ACKNOWLEDGEMENTS = "acknowledgements"
    HANDOVERS = "handovers"
    STATUSES = "statuses"
    TABLES = "tables"
    HEADERS = "headers"
    COPIES = "copies"


SINGLE_SCOPES = tuple(scope for scope in Scope if scope is not Scope.COPIES)


def scopes_of(amount: float) -> tuple[Scope, ...]:
    """What the amount of a fault means: 1, 2 ... one of these; above their number all of them, and copies."""
    number = int(amount) - 1
    return (SINGLE_SCOPES[number],) if number < len(SINGLE_SCOPES) else tuple(Scope)


@dataclass(eq=False)
class MadeUp:
    """What nobody may ever believe, of all liars of a run."""

    statuses: OrderedDict[Status, int] = field(default_factory=OrderedDict)
    """With who made it up."""
    headers: OrderedDict[SceneLogPublic, int] = field(default_factory=OrderedDict)

    def add_status(self, status: Status, slot: int) -> Status:
        self.statuses[status] = slot
        if len(self.statuses) > MADE_UP_MAX:
            self.statuses.popitem(last=False)
        return status

    def add_header(self, header: SceneLogPublic, slot: int) -> SceneLogPublic:
        self.headers[header] = slot
        if len(self.headers) > MADE_UP_MAX:
            self.headers.popitem(last=False)
        return header


class Liar:
    """One node, over all its lives. It lies in a scope while a fault says so."""

    def __init__(self, node: Node, lies: Lies, made_up: MadeUp, keys: Keys, owner: Callable[[], SigningKey | None], seed: int) -> None:
        """`keys`, `owner`: of the scene, which a member of it lets the liar have."""
        self.node = node
        self.lies = lies
        self.made_up = made_up
        self.dice = random.Random(f"liar/{seed}/{node.slot}")
        self.at_work: list[Scope] = []
        """As often as faults name each."""
        self._keys = keys
        self.owner = owner
        self._versions: OrderedDict[Place, deque[RecordBytes]] = OrderedDict()

    @property
    def key(self) -> SigningKey:
        return self.node.secrets.signing

    def lies_in(self, scope: Scope) -> bool:
        return scope in self.at_work

    def tells(self, peer: str, place: Place, manner: Manner, digest: Digest | None) -> None:
        """It lies to who has asked it."""
        self.lies.tells(self.node.slot, Way(f"node:{self.node.node_id}", peer), place, manner, digest)

    def chance(self, scope: Scope) -> bool:
        """Whether this word of this kind is to be a lie."""
        return scope in self.at_work and self.dice.random() < LIES

    def decides(self, location: Location) -> bool:
        """Whether it may speak for a place: what an owner withholds nobody else has."""
        return self.node.owns(location) and self.node.has_lease()

    # ---------------------------------------------------------------------------------------------------- records

    def saw(self, place: Place, record: RecordBytes) -> None:
        """Remember a version that passes by."""
        versions = self._versions.setdefault(place, deque(maxlen=VERSIONS_MAX))
        if record not in versions:
            versions.append(record)
        self._versions.move_to_end(place)
        if len(self._versions) > PLACES_MAX:
            self._versions.popitem(last=False)

    def remembered(self) -> RecordBytes | None:
        """Any record that has passed by lately."""
        return self._versions[self.dice.choice(list(self._versions))][-1] if self._versions else None

    def older(self, place: Place, than: RecordBytes) -> RecordBytes | None:
        """A version of a record that is older than this one, if one is remembered."""
        seq = RecordHeader.decode(than.header).seq
        found = [known for known in self._versions.get(place, ()) if RecordHeader.decode(known.header).seq < seq]
        return self.dice.choice(found) if found else None

    def wrong(self, place: Place, record: RecordBytes, how: int) -> RecordBytes:
        """Something else than a record, which nobody may take for it, made in one of WAYS. What is only left of one has no ciphertext to spoil."""
        match how:
            case 0 | 3 if not record.ciphertext:
                return replace(record, signature=flipped(record.signature, self.dice))
            case 0:
                return replace(record, ciphertext=flipped(record.ciphertext, self.dice))
            case 1:
                return replace(record, signature=flipped(record.signature, self.dice))
            case 2:
                return replace(record, header=flipped(record.header, self.dice))
            case 3:
                return replace(record, ciphertext=record.ciphertext[:-1])
            case 4:
                elsewhere = [known for known in self._versions if known != place]
                return self._versions[self.dice.choice(elsewhere)][-1] if elsewhere else self.forged(record)
            case 5:
                return self.forged(record, as_writer=False)
            case _:
                return self.forged(record)

    def forged(self, record: RecordBytes, *, as_writer: bool = True) -> RecordBytes:
        """A newer version with another content, sealed under the scene's key and signed by the liar, in the writer's name or its own."""
        header = RecordHeader.decode(record.header)
        key = self._keys().get(header.key_epoch)
        if key is None:
            return self.wrong(place_of_record(record), record, 0)
        payload = self.dice.randbytes(40)
        writer = header.writer if as_writer else self.key.key_id
        changed = header._replace(
            seq=header.seq + 1,
            nonce=self.dice.randbytes(len(header.nonce)),
            length=len(payload) + TAG_BYTES,
            writer=writer,
            suite=self.key.suite,
        )
        impostor = _Impostor(self.key, writer)
        (made,) = seal_records([(changed, payload)], key, impostor)  # type: ignore[arg-type]
        return RecordBytes(made.signature, made.header_bytes, made.ciphertext)


class _Impostor:
    """Signs with a key of its own in somebody's name."""

    def __init__(self, key: SigningKey, name: int) -> None:
        self.key_id, self.suite = name, key.suite
        self._key = key

    def sign(self, domain: bytes, message: bytes) -> bytes:
        return self._key.sign(domain, message)


def place_of_record(record: RecordBytes) -> Place:
    """How histories call the place that a record names."""
    header = RecordHeader.decode(record.header)
    return Place(header.scene, header.space, object_of(header) if header.placement == PLACED_BY_NODE else header.location)


def flipped(data: bytes, dice: random.Random) -> bytes:
    """The bytes with one bit turned over."""
    bit = dice.randrange(8 * len(data))
    return data[: bit // 8] + bytes((data[bit // 8] ^ 1 << bit % 8,)) + data[bit // 8 + 1 :]
