"""Which nodes observe a scene: they render under a lease of their own, and are asked when its mode is to change (specs/26-modes.md, Observers)."""

from __future__ import annotations

from functools import partial

from scenefold.base.errors import LocalFault
from scenefold.base.ids import NodeId, address_of
from scenefold.base.limits import PARTICIPANTS_MAX
from scenefold.client.access import SceneAccess
from scenefold.client.participants import Deciders, deciders_in
from scenefold.client.requests import Again
from scenefold.scene.log import SceneLog
from scenefold.wire import AddObserver, LogEntry, ParticipantEntry, RemoveObserver


async def add_observer(access: SceneAccess, entry: ParticipantEntry, *, again: Again = None) -> Deciders:
    """Let a node observe the scene; an owner's to do. LocalFault if it takes part already, or nobody but the scene's origin decides.

    That it is trusted the caller has seen to (`entry_of`).
    """
    return deciders_in((await access.change_log(partial(_joining, access.name, entry), again=again)).header)


async def remove_observer(access: SceneAccess, node: NodeId, *, again: Again = None) -> Deciders:
    """Let it observe no more, whichever life it leads. LocalFault if it does not."""
    return deciders_in((await access.change_log(partial(_leaving, access.name, node), again=again)).header)


def _joining(name: str, entry: ParticipantEntry, log: SceneLog) -> LogEntry:
    address = address_of(entry.member.node)
    where, roster = f"scene {name}, {address}", log.roster
    if not roster.participants:
        what = "the scene has no participants, and without them nobody holds leases"
        raise LocalFault(what, where=where, remedy=f"`scenectl scene add-participant {name}` makes some")
    if any(other.member.node == entry.member.node for other in roster.participants):
        what = "the node decides the scene's log, so it is asked and waited for already"
        raise LocalFault(what, where=where, remedy=f"`scenectl scene remove-participant {name} {address}` first, if it shall only observe")
    for other in roster.observers:
        if other.member == entry.member:
            raise LocalFault("the node observes the scene already", where=where)
        if other.member.node == entry.member.node:
            what = "the node observed the scene before it lost its disk, and takes no part since"
            raise LocalFault(what, where=where, remedy=f"`scenectl scene remove-observer {name} {address}` first")
    if len(roster.observers) >= PARTICIPANTS_MAX:
        raise LocalFault(f"{PARTICIPANTS_MAX} observers are the most", where=where, remedy="remove another one first")
    return AddObserver(entry.member, entry.key)


def _leaving(name: str, node: NodeId, log: SceneLog) -> LogEntry:
    members = {entry.member.node: entry.member for entry in log.roster.observers}
    if node not in members:
        where, remedy = f"scene {name}, {address_of(node)}", f"see `scenectl scene participants {name}`"
        raise LocalFault("the node does not observe the scene", where=where, remedy=remedy)
    return RemoveObserver(members[node])
