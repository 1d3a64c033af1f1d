"""How a node does, for people and tools: RequestReport (76), answered with a NodeReport (75) (specs/11-peers.md, Report).

A report is what this node itself knows at this moment: its durable arc, its lease, how far it knows the log, handovers
under way, whom it hears. Who asks all nodes sees whether these views fit together; nothing is decided by a report. All times
are durations on this node's own clock, so that reports of several nodes can stand beside each other.

`report_of` is pure. The service around it keeps in mind since when a handover is open, and notices when this node did
not run for a while: its machine slept, its clock jumped, or it was starved.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from scenefold.base.ids import NodeId, address_of
from scenefold.base.location import Arc
from scenefold.base.prefixes import Blacklist
from scenefold.peer.cluster_log.registry import Registry
from scenefold.peer.context import NodeContext
from scenefold.peer.handlers import Handlers
from scenefold.peer.line import Handover, Side
from scenefold.peer.line.rightful import rightful
from scenefold.peer.membership.roster import Roster
from scenefold.store import StoreStatistics
from scenefold.store.statistics import Counts, capacity_of
from scenefold.wire import Member, NodeReport, Packet, RequestReport, pack_value

LOOK_S = 5.0
"""Between two looks at the handovers and the clock: who warns of a handover waits for a minute."""
STRAYS_COUNTED_MAX = 1_000
"""There may be many more; whoever reads the number wants to know whether there are any, and whether they get fewer."""
DROPPED, TURNED_AWAY = "datagrams dropped", "connections turned away"
"""Of the events: what came from strangers, or was too much, at all ports. Clients know these names."""
LOG_PACKETS = "packets of logs sent"
"""Likewise: by those who decide logs, to each other."""
STALL_S_MIN = 5.0
"""A look that comes so much later than it should is worth telling."""


@dataclass(slots=True)
class Memory:
    """What a report tells beyond the moment. `since`: when each open handover was seen first."""

    begun: float
    looked_at: float
    since: dict[bytes, float] = field(default_factory=dict)
    stalls: int = 0
    stalled_s: float = 0.0
    """How long the last stall was."""
    stalled_at: float | None = None

    def note_handovers(self, handovers: list[tuple[Side, Handover]], now: float) -> None:
        self.since = {handover.id: self.since.get(handover.id, now) for _, handover in handovers}

    def note_look(self, now: float) -> None:
        """A look that was to come LOOK_S after the one before."""
        late_s = now - self.looked_at - LOOK_S
        self.looked_at = now
        if late_s >= STALL_S_MIN:
            self.stalls += 1
            self.stalled_s, self.stalled_at = late_s, now


@dataclass(frozen=True, slots=True)
class Moment:
    """A node at one moment; `pieces` has what lies in the piece of each handover here."""

    now: float
    member: Member
    boot: int
    arc: Arc | None
    gap: Arc | None
    lease_s: float
    grants_leases: bool
    is_draining: bool
    handovers: list[tuple[Side, Handover]]
    pieces: Mapping[bytes, Counts]
    statistics: StoreStatistics
    capacity_bytes: int
    memory_fraction: float
    strays: int
    strays_more: bool
    damaged: int
    rays_per_second: int
    events: Mapping[str, int]
    balance: Mapping[str, Any]
    scrub: Mapping[str, Any] = field(default_factory=dict)
    blacklist: Blacklist = field(default_factory=Blacklist)
    signs: Sequence[Mapping[str, Any]] = ()
    copies: Mapping[str, Any] = field(default_factory=dict)
    suspects: Mapping[str, Any] = field(default_factory=dict)
    upkeep: Mapping[str, Any] = field(default_factory=dict)


def report_of(moment: Moment, registry: Registry, roster: Roster, memory: Memory) -> dict[str, Any]:
    """The document (specs/11-peers.md, Report)."""
    stalled_at = memory.stalled_at
    return {
        "node": moment.member.node,
        "address": address_of(moment.member.node),
        "incarnation": moment.member.incarnation.hex(),
        "boot": moment.boot,
        "seconds_up": moment.now - memory.begun,
        "role": role_of(registry, moment.member, moment.arc, is_draining=moment.is_draining),
        "trusted": registry.is_trusted(moment.member.node),
        "lease_s": moment.lease_s,
        "grants_leases": moment.grants_leases,
        "log_position": registry.position,
        "log_head": registry.head.hex()[:16],
        "arc": _arc_document(moment.arc),
        "gap": _arc_document(moment.gap),
        "handovers": [_handover_document(side, handover, moment, memory, registry) for side, handover in moment.handovers],
        "strays": moment.strays,
        "strays_more": moment.strays_more,
        "damaged": moment.damaged,
        "records": moment.statistics.records,
        "bytes": moment.statistics.bytes,
        "used_bytes": moment.statistics.disk_used_bytes,
        "capacity_bytes": moment.capacity_bytes,
        "memory_fraction": moment.memory_fraction,
        "rays_per_second": moment.rays_per_second,
        "stalls": {
            "count": memory.stalls,
            "last_s": memory.stalled_s,
            "ago_s": None if stalled_at is None else moment.now - stalled_at,
        },
        "peers": [_peer_document(node, roster, moment.now) for node in registry.order if node != moment.member.node],
        "events": dict(sorted(moment.events.items())),
        "balance": dict(moment.balance),
        "scrub": dict(moment.scrub),
        "blacklist": list(map(str, moment.blacklist.prefixes)),
        "blacklist_version": moment.blacklist.version,
        "signs": list(moment.signs),
        "copies": dict(moment.copies),
        "suspects": dict(moment.suspects),
        "upkeep": dict(moment.upkeep),
    }


def role_of(registry: Registry, member: Member, arc: Arc | None, *, is_draining: bool) -> str:
    """voter, member, joining (owns nothing yet) or draining."""
    if member.node in registry.voters and registry.is_current(member):
        return "voter"
    if is_draining:
        return "draining"
    return "member" if arc is not None and registry.is_current(member) else "joining"


def _arc_document(arc: Arc | None) -> dict[str, str] | None:
    return None if arc is None else {"first": arc.first.hex(), "last": arc.last.hex()}


def _handover_document(side: Side, handover: Handover, moment: Moment, memory: Memory, registry: Registry) -> dict[str, Any]:
    counts = moment.pieces.get(handover.id, Counts())
    return {
        "id": handover.id.hex(),
        "side": str(side),
        "step": str(handover.step),
        "gives": handover.gives,
        "peer": address_of(handover.peer.node),
        # Whom the log has removed claims nothing: what was released to it is about to be taken back.
        "peer_removed": registry.removal(handover.peer.incarnation) is not None,
        "first": handover.piece.first.hex(),
        "last": handover.piece.last.hex(),
        "open": handover.is_open,
        "seconds": moment.now - memory.since.get(handover.id, moment.now),
        # At the giver all that lies there, at the receiver what has arrived: together they are the progress.
        "records": counts.records,
        "bytes": counts.bytes,
    }


def _peer_document(node: NodeId, roster: Roster, now: float) -> dict[str, Any]:
    heard_at = roster.heard_at(node)
    return {
        "address": address_of(node),
        "heard_s": None if heard_at is None else now - heard_at,
        "alive": roster.is_believed_alive(node),
    }


class Reporting:
    """Answers for this node. `register`, then `run`."""

    def __init__(self, context: NodeContext) -> None:
        self._context = context
        now = context.world.clock.now()
        self._memory = Memory(now, now)

    def register(self, handlers: Handlers) -> None:
        handlers.add(RequestReport, self._on_request)

    async def run(self) -> None:
        """Look at handovers and clock until cancelled."""
        clock = self._context.world.clock
        while True:
            await clock.sleep(LOOK_S)
            self._memory.note_look(clock.now())
            self._memory.note_handovers(self._context.line.open_handovers(), clock.now())

    async def report(self) -> dict[str, Any]:
        """The document as of now."""
        context = self._context
        line, load = context.line, context.own.load
        handovers = line.open_handovers()
        pieces = {handover.id: await context.store.arc_totals(handover.piece) for _, handover in handovers}
        strays = await context.store.strays(await rightful(line.parts), None, STRAYS_COUNTED_MAX)
        statistics = await context.store.statistics()
        copies = await context.replication.health.document()
        now = context.world.clock.now()
        self._memory.note_handovers(handovers, now)
        moment = Moment(
            now=now,
            member=context.own.member,
            boot=context.own.boot,
            # Read together, after the last wait: an arc and handovers of two moments would not fit.
            arc=line.arc,
            gap=line.gap_left(),
            lease_s=context.lease.seconds_left,
            grants_leases=context.cluster_log.grants_leases,
            is_draining=bool(line.refuses),
            handovers=line.open_handovers(),
            pieces=pieces,
            statistics=statistics,
            capacity_bytes=capacity_of(statistics, context.settings.capacity_bytes),
            memory_fraction=load.memory_used_bytes / load.memory_total_bytes if load.memory_total_bytes else 0.0,
            strays=len(strays.entries),
            strays_more=strays.cursor is not None,
            damaged=context.store.damaged,
            rays_per_second=load.rays_per_second,
            events={
                **line.events,
                DROPPED: context.gossip.dropped + context.range_datagrams.dropped + context.discovery.dropped,
                TURNED_AWAY: context.world.network.turned_away,
                LOG_PACKETS: context.logs.packets_sent,
            },
            balance=context.balancer.report(),
            scrub=context.scrub.progress(statistics.bytes).document(),
            blacklist=context.own.blacklist,
            signs=context.gossip.signs.documents(now),
            copies=copies,
            suspects=context.suspects.document(),
            upkeep=context.upkeep.document(),
        )
        return report_of(moment, context.cluster_log.registry, context.roster, self._memory)

    async def _on_request(self, _packet: RequestReport, _peer: str) -> Packet:
        return NodeReport(pack_value(await self.report()))
