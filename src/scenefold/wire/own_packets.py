"""Packets 36 to 40: faults, and what a client asks a node first (not in the thesis)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from scenefold.base.limits import NODES_MAX, SCENES_LISTED_MAX
from scenefold.base.reasons import RejectReason
from scenefold.wire.common import BOOL, MESSAGE, REASON, U32, Carrier, Packet, row
from scenefold.wire.containers import Many
from scenefold.wire.scene_headers import SCENE_LOG_PUBLIC, SceneLogPublic
from scenefold.wire.status_packets import STATUS, Status


@dataclass(frozen=True, slots=True)
class Fault(Packet):
    """The request could not be decoded, or nobody here handles it; request_id 0 where it could not be read."""

    TYPE: ClassVar[int] = 36
    reason: RejectReason
    text: str


@dataclass(frozen=True, slots=True)
class ListScenes(Packet):
    """Asks for the scenes with higher ids than `after`."""

    TYPE: ClassVar[int] = 37
    BULK_ANSWER: ClassVar[bool] = True
    after: int = 0


@dataclass(frozen=True, slots=True)
class ScenesListed(Packet):
    """In the order of their ids; `more`: there are others with higher ids."""

    TYPE: ClassVar[int] = 38
    scenes: tuple[SceneLogPublic, ...]
    more: bool = False


@dataclass(frozen=True, slots=True)
class RequestTable(Packet):
    TYPE: ClassVar[int] = 39


@dataclass(frozen=True, slots=True)
class RespondTable(Packet):
    """The routing table: every node that the answering one knows, itself included."""

    TYPE: ClassVar[int] = 40
    statuses: tuple[Status, ...]


ROWS = (
    row(Fault, Carrier.TCP_ANY, ("reason", REASON), ("text", MESSAGE)),
    row(ListScenes, Carrier.TCP_HIGH, ("after", U32)),
    row(ScenesListed, Carrier.TCP_HIGH, ("scenes", Many(SCENE_LOG_PUBLIC, SCENES_LISTED_MAX)), ("more", BOOL)),
    row(RequestTable, Carrier.TCP_HIGH),
    row(RespondTable, Carrier.TCP_HIGH, ("statuses", Many(STATUS, NODES_MAX))),
)
