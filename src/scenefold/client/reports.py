"""What nodes say of themselves (packets 75 and 76; specs/11-peers.md, Report), read into values. Pure.

A report is a document of another machine: whatever does not fit is a PeerFault of that machine alone. Fields that are not known
here are passed over, so that nodes of a later version can say more.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from scenefold.base.errors import PeerFault
from scenefold.base.location import Arc
from scenefold.base.prefixes import address_prefix
from scenefold.client.copy_reports import CopiesReport, read_copies
from scenefold.client.report_values import told_address, told_amount, told_count, told_location, told_map, told_seconds, told_word
from scenefold.wire import unpack_value


@dataclass(frozen=True, slots=True)
class HandoverReport:
    """A handover as one of its two nodes sees it."""

    id: str
    step: str
    gives: bool
    peer: str
    """Address of the other node."""
    piece: Arc
    open: bool
    """The bound between the two is on its way."""
    seconds: float
    """For how long this node has seen it."""
    records: int
    """At the giver what lies in the piece, at the receiver what has arrived."""
    bytes: int
    peer_removed: bool = False
    """The other node is no member any more; what was released to it is taken back."""


@dataclass(frozen=True, slots=True)
class PeerReport:
    """What one node has heard of another."""

    heard_s: float | None
    """Seconds since its last sign of life; None: never."""
    alive: bool


@dataclass(frozen=True, slots=True)
class SignReport:
    """That somebody means harm, as one node has met it: what, how often, how long ago last, and by whose word."""

    kind: str
    """own key, contested or forged; a later node may say more."""
    count: int
    ago_s: float
    source: str


@dataclass(frozen=True, slots=True)
class ScrubReport:
    """How far a node has come in reading all of its records again, which takes days."""

    round: int
    fraction: float
    seconds_left: float
    rotten: int
    rotten_before: int
    """In the round before."""
    paused: bool


SCENE_DIGITS = 8


@dataclass(frozen=True, slots=True)
class KeptApart:
    """What a node has brought along from before it was away, by the ids of scenes, those with the most first (specs/22-purge.md, Who was away)."""

    records: int = 0
    scenes: tuple[tuple[str, int], ...] = ()

    def document(self) -> dict[str, Any]:
        """The JSON form (docs/reference/scenectl.md)."""
        return {"records": self.records, "scenes": [{"scene": scene, "records": count} for scene, count in self.scenes]}


@dataclass(frozen=True, slots=True)
class NodeReport:
    """A node at the moment of answering."""

    address: str
    incarnation: str
    boot: int
    seconds_up: float
    role: str
    """voter, member, joining or draining."""
    trusted: bool
    """With the authority's key: it may enrol newcomers."""
    lease_s: float
    """For how long it may still speak for its arc; 0: it may not."""
    grants_leases: bool
    """To nodes, as one of those who decide the cluster's log. One of several does once it has heard what those before granted."""
    log_position: int
    arc: Arc | None
    gap: Arc | None
    """Places beside its arc that nobody owns, as far as it has found out."""
    handovers: tuple[HandoverReport, ...]
    strays: int
    strays_more: bool
    """It has counted no further: there may be more."""
    damaged: int
    records: int
    bytes: int
    used_bytes: int
    capacity_bytes: int
    memory_fraction: float
    rays_per_second: int
    stalls: int
    stall_last_s: float
    stall_ago_s: float | None
    peers: Mapping[str, PeerReport]
    blacklist: tuple[str, ...]
    """Addresses, and prefixes of some, of nodes that must not hold copies of its data."""
    blacklist_version: int
    turned_away: int
    """Connections that it refused since its start: strangers', and what was too many."""
    dropped: int
    """Datagrams that it dropped, likewise."""
    log_packets: int
    """Packets that it sent to others with whom it decides logs, likewise."""
    signs: tuple[SignReport, ...]
    copies: CopiesReport | None
    """None: it says nothing of them."""
    kept_apart: KeptApart
    scrub: ScrubReport | None
    paused: tuple[str, ...]
    """What of its upkeep an administrator has paused: repair, scrub, balance; a later node may say more."""
    document: Mapping[str, Any]
    """All that it said."""

    @property
    def fill(self) -> float:
        """Part of what it may store that is used."""
        return self.used_bytes / self.capacity_bytes if self.capacity_bytes else 0.0


@dataclass(frozen=True, slots=True)
class DrainReport:
    """How far a node that leaves is (specs/13-balance.md, Leaving)."""

    state: str
    """serving, draining or left."""
    records: int
    bytes: int
    seconds_left: float | None
    may_switch_off: bool
    obstacles: tuple[str, ...]
    text: str
    cannot_leave: str = ""
    """Why it would refuse to leave; empty if it would not."""
    room_bytes: int | None = None
    """What its neighbours have room for, those that it hears; None if it does not say."""

    def document(self) -> dict[str, Any]:
        """The JSON form (docs/reference/scenectl.md)."""
        return {
            "state": self.state,
            "records": self.records,
            "bytes": self.bytes,
            "seconds_left": self.seconds_left,
            "may_switch_off": self.may_switch_off,
            "obstacles": list(self.obstacles),
            "text": self.text,
            "cannot_leave": self.cannot_leave,
            "room_bytes": self.room_bytes,
        }


def read_report(packed: bytes, address: str) -> NodeReport:
    """The report of the node at this address; PeerFault if it is none."""
    try:
        found = unpack_value(packed)
        stalls, events = found["stalls"], dict(found.get("events", {}))
        return NodeReport(
            address=address,
            incarnation=str(found["incarnation"]),
            boot=told_count(found["boot"]),
            seconds_up=told_amount(found["seconds_up"]),
            role=told_word(found["role"]),
            trusted=bool(found.get("trusted", False)),
            lease_s=told_amount(found["lease_s"]),
            grants_leases=bool(found.get("grants_leases", True)),
            log_position=told_count(found["log_position"]),
            arc=_arc(found["arc"]),
            gap=_arc(found["gap"]),
            handovers=tuple(map(_handover, found["handovers"])),
            strays=told_count(found["strays"]),
            strays_more=bool(found.get("strays_more", False)),
            damaged=told_count(found["damaged"]),
            records=told_count(found["records"]),
            bytes=told_count(found["bytes"]),
            used_bytes=told_count(found["used_bytes"]),
            capacity_bytes=told_count(found["capacity_bytes"]),
            memory_fraction=told_amount(found["memory_fraction"]),
            rays_per_second=told_count(found["rays_per_second"]),
            stalls=told_count(stalls["count"]),
            stall_last_s=told_amount(stalls["last_s"]),
            stall_ago_s=told_seconds(stalls["ago_s"]),
            peers={str(peer["address"]): PeerReport(told_seconds(peer["heard_s"]), bool(peer["alive"])) for peer in found["peers"]},
            blacklist=tuple(map(_listed, found.get("blacklist", ()))),
            blacklist_version=told_count(found.get("blacklist_version", 0)),
            turned_away=told_count(events.get("connections turned away", 0)),
            dropped=told_count(events.get("datagrams dropped", 0)),
            log_packets=told_count(events.get("packets of logs sent", 0)),
            signs=tuple(map(_sign, found.get("signs", ()))),
            copies=read_copies(found.get("copies")),
            kept_apart=_kept_apart(told_map(found.get("suspects", {}))),
            scrub=_scrub(found["scrub"]) if found.get("scrub") else None,
            paused=tuple(map(told_word, told_map(found.get("upkeep", {})).get("paused", ()))),
            document=found,
        )
    except (KeyError, TypeError, ValueError, PeerFault) as problem:
        raise PeerFault(f"the node's report cannot be read: {type(problem).__name__} {problem}", where=address) from problem


def read_drain_report(packed: bytes, address: str) -> DrainReport:
    """How far the node at this address is with leaving; PeerFault if it does not say."""
    try:
        found = unpack_value(packed)
        return DrainReport(
            state=str(found["state"]),
            records=told_count(found["records"]),
            bytes=told_count(found["bytes"]),
            seconds_left=told_seconds(found["seconds_left"]),
            may_switch_off=bool(found["may_switch_off"]),
            obstacles=tuple(map(str, found["obstacles"])),
            text=str(found["text"]),
            cannot_leave=str(found.get("cannot_leave", "")),
            room_bytes=None if found.get("room_bytes") is None else told_count(found["room_bytes"]),
        )
    except (KeyError, TypeError, ValueError, PeerFault) as problem:
        raise PeerFault(f"the node's report cannot be read: {type(problem).__name__} {problem}", where=address) from problem


def _handover(found: Mapping[str, Any]) -> HandoverReport:
    return HandoverReport(
        id=str(found["id"]),
        step=told_word(found["step"]),
        gives=bool(found["gives"]),
        peer=told_address(found["peer"]),
        piece=Arc(told_location(found["first"]), told_location(found["last"])),
        open=bool(found["open"]),
        seconds=told_amount(found["seconds"]),
        records=told_count(found["records"]),
        bytes=told_count(found["bytes"]),
        peer_removed=bool(found.get("peer_removed", False)),
    )


def _sign(found: Mapping[str, Any]) -> SignReport:
    return SignReport(
        kind=str(found["kind"]), count=told_count(found["count"]), ago_s=told_amount(found["ago_s"]), source=told_address(found["source"])
    )


def _scrub(found: Mapping[str, Any]) -> ScrubReport:
    return ScrubReport(
        round=told_count(found["round"]),
        fraction=told_amount(found["fraction"]),
        seconds_left=told_amount(found["seconds_left"]),
        rotten=told_count(found["rotten"]),
        rotten_before=told_count(found["rotten_before"]),
        paused=bool(found["paused"]),
    )


def _arc(found: Mapping[str, Any] | None) -> Arc | None:
    return None if found is None else Arc(told_location(found["first"]), told_location(found["last"]))


def _listed(value: object) -> str:
    """What stands on a blacklist: an address or a prefix, for the same reason."""
    return str(address_prefix(str(value)))


def _kept_apart(found: Mapping[str, Any]) -> KeptApart:
    scenes = tuple((bytes.fromhex(str(one["scene"])).hex(), told_count(one["records"])) for one in found.get("scenes", ()))
    if any(len(scene) != SCENE_DIGITS for scene, _ in scenes):
        raise ValueError("the id of a scene is expected")
    return KeptApart(told_count(found.get("records", 0)), scenes)
