"""What a log record may say: entries of a scene's log, and of the cluster's (design of the consensus §3).

An entry is one array, its number first. Numbers 1 to 31 stand in scenes' logs, 32 and up in the cluster's only;
which of them fits after which is the business of whoever folds the log.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum
from typing import Any, TypeAlias

from scenefold.base.limits import (
    COPIES_MAX,
    MEMBER_NAME_BYTES_MAX,
    NODES_MAX,
    PARTICIPANTS_MAX,
    SPACE_DIMENSIONS_MAX,
    SPACE_NAME_BYTES_MAX,
    SPACES_PER_SCENE_MAX,
)
from scenefold.wire.common import BOOL, F64, LOCATION, MESSAGE, SPACE, SPACE_OR_NONE, U8, U32, KeyId, Location, NodeId, SpaceId
from scenefold.wire.containers import Many, Struct, Tagged
from scenefold.wire.enrol_entries import ENROL_ENTRIES, Enrol, Invite, RenewCard, RevokeUser, Trust, Withdraw
from scenefold.wire.kinds import Bin, Choice, Float, Text, Uint
from scenefold.wire.laws import Order
from scenefold.wire.members import MEMBER, Member
from scenefold.wire.render_settings import RENDER_SETTINGS, RenderSettings
from scenefold.wire.scene_headers import KEY_ENTRY, KeyEntry, SceneMode
from scenefold.wire.status_packets import ADDRESS_BYTES_MAX


class CurveKind(IntEnum):
    HILBERT = 0
    Z_ORDER = 1


class Role(IntEnum):
    """What a member may do with a scene; each may do what those before it may."""

    READER = 1
    WRITER = 2
    OWNER = 3


@dataclass(frozen=True, slots=True)
class CreateSpace:
    """`low` and `high`: the box in the world that the lattice spans. `parent` 0: no shadow of another space."""

    space: SpaceId
    dimensions: int
    curve: CurveKind
    node_managed: bool
    parent: SpaceId
    offset: Location
    copies: int
    copies_min: int
    render_output: bool
    name: str
    low: tuple[float, ...]
    high: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class TranslateSpace:
    space: SpaceId
    offset: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class ScaleSpace:
    space: SpaceId
    factor: float


@dataclass(frozen=True, slots=True)
class SetCopies:
    """How many nodes shall hold each record of the space, and how many must before a write counts as done."""

    space: SpaceId
    copies: int
    copies_min: int


@dataclass(frozen=True, slots=True)
class SetMode:
    mode: SceneMode


@dataclass(frozen=True, slots=True)
class BeginPurge:
    """What was deleted before this may be purged: nothing that was signed before can be put any more (specs/22-purge.md)."""


@dataclass(frozen=True, slots=True)
class EndScene:
    """The last entry of a scene's log: nothing of it is written any more, and nodes let go of what there is (specs/16-scene-log.md, The end)."""


@dataclass(frozen=True, slots=True)
class AddParticipant:
    """From the next position on this node decides, too; its facts are signed with this key (specs/25-consensus.md)."""

    member: Member
    key: bytes


@dataclass(frozen=True, slots=True)
class RemoveParticipant:
    member: Member


@dataclass(frozen=True, slots=True)
class AddObserver:
    """This node holds keys, and takes part in changes of mode, not in decisions (specs/26-modes.md)."""

    member: Member
    key: bytes


@dataclass(frozen=True, slots=True)
class RemoveObserver:
    member: Member


@dataclass(frozen=True, slots=True)
class Grant:
    """A member may use the scene. `name` is that of its certificate, and says nothing: the keys do."""

    name: str
    role: Role
    signing: KeyEntry
    sealing: KeyEntry


@dataclass(frozen=True, slots=True)
class Revoke:
    """The member with this signing key may not any more."""

    key: KeyId


@dataclass(frozen=True, slots=True)
class KeyEpoch:
    """From here on a new symmetric key is used, which stands in the lockboxes; `previous`: the one until now."""

    epoch: int
    previous: bytes = field(repr=False)


@dataclass(frozen=True, slots=True)
class AddNode:
    """Registers a node, directly left of `left_of` on the line; 0: it takes the seat that it was founded with."""

    member: Member
    key: bytes
    sealing_key: bytes
    address: str
    left_of: NodeId


@dataclass(frozen=True, slots=True)
class RemoveNode:
    """Takes a node out of the line. Incarnation 16 zero bytes: a founder that never registered."""

    member: Member
    reason: str


@dataclass(frozen=True, slots=True)
class RevokeNode:
    """The node's key counts no longer."""

    node: NodeId
    key: KeyId


@dataclass(frozen=True, slots=True)
class Founder:
    node: NodeId
    key: bytes
    sealing_key: bytes
    address: str


@dataclass(frozen=True, slots=True)
class Found:
    """The first record of a cluster's log: who stands on the line at the start, in order, and who votes."""

    founders: tuple[Founder, ...]
    voters: tuple[NodeId, ...]


@dataclass(frozen=True, slots=True)
class Batch:
    """Entries that come into force together: a space and its shadows. Holds no other batch."""

    entries: tuple[SingleEntry, ...]


SingleEntry: TypeAlias = (
    CreateSpace
    | TranslateSpace
    | ScaleSpace
    | SetMode
    | AddParticipant
    | RemoveParticipant
    | AddObserver
    | RemoveObserver
    | Grant
    | Revoke
    | KeyEpoch
    | SetCopies
    | BeginPurge
    | EndScene
    | RenderSettings
    | AddNode
    | RemoveNode
    | Trust
    | RevokeNode
    | Found
    | Invite
    | Enrol
    | RenewCard
    | RevokeUser
    | Withdraw
)
LogEntry: TypeAlias = SingleEntry | Batch


@dataclass(frozen=True, slots=True)
class Boxed:
    """A space's box has as many coordinates as the space dimensions, and a positive size along each."""

    def holds(self, value: Any) -> bool:
        low, high = value.low, value.high
        return len(low) == len(high) == value.dimensions and all(a < b for a, b in zip(low, high, strict=True))

    def __str__(self) -> str:
        return "low < high along each dimension"


_COORDINATES = Many(F64, counts=tuple(range(1, SPACE_DIMENSIONS_MAX + 1)))
_KEY = Bin(lengths=(32,))
_ADDRESS = Text(ADDRESS_BYTES_MAX)
_COPIES = Uint(8, least=1, most=COPIES_MAX)
FOUNDER = Struct(Founder, ("node", U32), ("key", _KEY), ("sealing_key", _KEY), ("address", _ADDRESS))
CREATE_SPACE = Struct(
    CreateSpace,
    ("space", SPACE),
    ("dimensions", Uint(8, least=1, most=SPACE_DIMENSIONS_MAX)),
    ("curve", Choice(CurveKind)),
    ("node_managed", BOOL),
    ("parent", SPACE_OR_NONE),
    ("offset", LOCATION),
    ("copies", U8),
    ("copies_min", U8),
    ("render_output", BOOL),
    ("name", Text(SPACE_NAME_BYTES_MAX)),
    ("low", _COORDINATES),
    ("high", _COORDINATES),
    law=Boxed(),
)
GRANT = Struct(Grant, ("name", Text(MEMBER_NAME_BYTES_MAX)), ("role", Choice(Role)), ("signing", KEY_ENTRY), ("sealing", KEY_ENTRY))
_SINGLE: dict[int, Struct[Any]] = {
    1: CREATE_SPACE,
    2: Struct(TranslateSpace, ("space", SPACE), ("offset", _COORDINATES)),
    3: Struct(ScaleSpace, ("space", SPACE), ("factor", Float(positive=True))),
    4: Struct(SetMode, ("mode", Choice(SceneMode, SceneMode.RENDER))),
    5: Struct(AddParticipant, ("member", MEMBER), ("key", _KEY)),
    6: Struct(RemoveParticipant, ("member", MEMBER)),
    7: Struct(AddObserver, ("member", MEMBER), ("key", _KEY)),
    8: Struct(RemoveObserver, ("member", MEMBER)),
    9: GRANT,
    10: Struct(Revoke, ("key", U32)),
    11: Struct(KeyEpoch, ("epoch", U32), ("previous", Bin(lengths=(24,)))),
    32: Struct(AddNode, ("member", MEMBER), ("key", _KEY), ("sealing_key", _KEY), ("address", _ADDRESS), ("left_of", U32)),
    33: Struct(RemoveNode, ("member", MEMBER), ("reason", MESSAGE)),
    35: Struct(RevokeNode, ("node", U32), ("key", U32)),
    36: Struct(Found, ("founders", Many(FOUNDER, NODES_MAX)), ("voters", Many(U32, PARTICIPANTS_MAX))),
    **ENROL_ENTRIES,
    # Behind all that were there before, so that the examples of the golden vectors stay those that they are.
    14: Struct(SetCopies, ("space", SPACE), ("copies", _COPIES), ("copies_min", _COPIES), law=Order("copies_min", "copies")),
    15: Struct(BeginPurge),
    16: Struct(EndScene),
    12: RENDER_SETTINGS,
}
SINGLE_ENTRY: Tagged[SingleEntry] = Tagged("SingleEntry", _SINGLE)
LOG_ENTRY: Tagged[LogEntry] = Tagged(
    "LogEntry", dict(sorted({**_SINGLE, 13: Struct(Batch, ("entries", Many(SINGLE_ENTRY, SPACES_PER_SCENE_MAX)))}.items()))
)
