"""Who decides a scene's log, as its users see it; and one more, or one fewer, which owners have decided (specs/16-scene-log.md, Participants)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

from scenefold.base.errors import LocalFault
from scenefold.base.ids import NodeId, address_of
from scenefold.base.limits import DECIDERS_MAX
from scenefold.client.access import SceneAccess
from scenefold.client.attendance import check_majority, has_majority, present_among
from scenefold.client.requests import Again
from scenefold.scene.log import CHANGES_MAX, SceneLog, changes_left
from scenefold.wire import AddParticipant, Batch, LogEntry, Member, ParticipantEntry, RemoveParticipant, SceneLogPublic, SingleEntry


@dataclass(frozen=True, slots=True)
class Deciders:
    """As of one position: who decides the next one. Without participants the origin does, alone."""

    origin: NodeId
    participants: tuple[NodeId, ...]
    observers: tuple[NodeId, ...]
    position: int
    members: tuple[Member, ...] = ()
    """The participants, each in the life in which it was named."""
    lost: tuple[NodeId, ...] | None = None
    """Those of them whose disk was lost, or that were removed from the cluster: they vote no more. None: nobody has looked."""
    changes_left: int = CHANGES_MAX
    """How often they can still change, in the scene's life."""

    def judged(self, registered: Mapping[NodeId, bytes]) -> Deciders:
        """With who votes no more, by the lives that the cluster's log has."""
        return replace(self, lost=tuple(NodeId(one.node) for one in self.members if registered.get(NodeId(one.node)) != one.incarnation))

    @property
    def nodes(self) -> tuple[NodeId, ...]:
        return self.participants or (self.origin,)

    @property
    def majority(self) -> int:
        """So many of them must agree."""
        return len(self.nodes) // 2 + 1

    def document(self) -> dict[str, Any]:
        """The JSON form (docs/reference/scenectl.md)."""
        return {
            "position": self.position,
            "decided_by": [address_of(node) for node in self.nodes],
            "by_origin_alone": not self.participants,
            "majority": self.majority,
            "observers": [address_of(node) for node in self.observers],
            "changes_left": self.changes_left,
        } | ({} if self.lost is None else {"lost": [address_of(node) for node in self.lost]})


async def deciders_of(access: SceneAccess) -> Deciders:
    """By the newest header that some nodes know: any of them has it, also while those who decide are away."""
    return deciders_in(await _header(access))


async def _header(access: SceneAccess) -> SceneLogPublic:
    header = None if access.log is None else await access.log.header()
    if header is None:
        raise LocalFault("the cluster does not know this scene", where=f"scene {access.name}")
    return header


async def add_participants(access: SceneAccess, entries: Sequence[ParticipantEntry], *, again: Again = None) -> Deciders:
    """Let another node decide, too; while the origin decides alone, let these decide in its place, and it only if it is one of them.

    LocalFault if one takes part already, or these are several, and others decide. Refused (15) if of those who decide then no majority answers.
    That they are trusted the caller has seen to (`entry_of`).
    """
    await _check_attendance(access, joining=[entry.member for entry in entries])
    return deciders_in((await access.change_log(partial(_joining, access.name, entries), again=again)).header)


async def remove_participant(access: SceneAccess, node: NodeId, *, again: Again = None) -> Deciders:
    """Let a node decide no more, whichever life it leads. LocalFault if it does not, or nobody else does; Refused (15) as above."""
    await _check_attendance(access, leaving=node)
    return deciders_in((await access.change_log(partial(_leaving, access.name, node), again=again)).header)


async def _check_attendance(access: SceneAccess, *, joining: Sequence[Member] = (), leaving: NodeId | None = None) -> None:
    """Refused (15) if those who decide now could have something decided, and those who would decide then could not."""
    header = await _header(access)
    before = [entry.member for entry in header.participants]
    after = [member for member in dict.fromkeys((*before, *joining)) if member.node != leaving]
    there = await present_among(access.calls, after)
    if has_majority(after, there):
        return
    # Without the one that leaves they are too few; are they enough with it?
    there |= await present_among(access.calls, [member for member in before if member.node == leaving])
    if not before or has_majority(before, there):
        check_majority(after, there, access.name)


def _joining(name: str, entries: Sequence[ParticipantEntry], log: SceneLog) -> LogEntry:
    before = {entry.member.node: entry.member for entry in log.roster.participants}
    observers = {entry.member.node for entry in log.roster.observers}
    where = f"scene {name}"
    for entry in entries:
        member, address = entry.member, address_of(entry.member.node)
        if before.get(member.node) == member:
            raise LocalFault("the node decides the scene's log already", where=f"{where}, {address}")
        if member.node in before:
            what = "the node decided the scene's log before it lost its disk, and takes no part since"
            remedy = f"`scenectl scene remove-participant {name} {address}` first; its place is free then"
            raise LocalFault(what, where=f"{where}, {address}", remedy=remedy)
        if member.node in observers:
            remedy = f"`scenectl scene remove-observer {name} {address}` first"
            raise LocalFault("the node takes part as an observer", where=f"{where}, {address}", remedy=remedy)
    if before and len(entries) != 1:
        raise LocalFault("those who decide change one at a time", where=where, remedy="add them one after the other")
    if len(before) + len(entries) > DECIDERS_MAX:
        raise LocalFault(f"{DECIDERS_MAX} participants are the most", where=where, remedy="remove another one first")
    added: list[SingleEntry] = [AddParticipant(entry.member, entry.key) for entry in entries]
    return added[0] if len(added) == 1 else Batch(tuple(added))


def _leaving(name: str, node: NodeId, log: SceneLog) -> LogEntry:
    members = {entry.member.node: entry.member for entry in log.roster.participants}
    where = f"scene {name}, {address_of(node)}"
    if node not in members:
        remedy = f"see `scenectl scene participants {name}`"
        raise LocalFault("the node does not decide the scene's log", where=where, remedy=remedy)
    if len(members) == 1:
        what = "it is the last one that decides the scene's log: without it nobody could change anything any more"
        raise LocalFault(what, where=where, remedy="add another one first")
    return RemoveParticipant(members[node])


def deciders_in(header: SceneLogPublic) -> Deciders:
    """As a header names them."""
    participants, observers = ([NodeId(entry.member.node) for entry in entries] for entries in (header.participants, header.observers))
    members = tuple(entry.member for entry in header.participants)
    return Deciders(
        NodeId(header.origin), tuple(participants), tuple(observers), header.position, members, changes_left=changes_left(header)
    )
