"""If this fails, a node's report is not what its holding, roster and clock say, or does not fit a packet."""

from __future__ import annotations

from typing import Any

from scenefold.base.ids import address_of
from scenefold.base.limits import DOCUMENT_BYTES_MAX, NODES_MAX
from scenefold.base.location import FIRST, LAST, Arc, Location
from scenefold.base.prefixes import Blacklist, address_prefix
from scenefold.client.reports import read_report
from scenefold.peer.cluster_log.registry import Registry
from scenefold.peer.line import Handover, Side, Step
from scenefold.peer.membership.roster import Roster
from scenefold.peer.reporting import DROPPED, LOG_PACKETS, LOOK_S, TURNED_AWAY, Memory, Moment, report_of, role_of
from scenefold.store import StoreStatistics
from scenefold.store.statistics import Counts
from scenefold.wire import RemoveNode, pack_value
from unit.peer.logs_made import add, folded, found, member, node

HALF = Arc(FIRST, Location.from_number(LAST.number // 2))
PIECE = Arc(Location.from_number(HALF.last.number + 1), LAST)
GIVEN = Handover(b"h" * 16, Step.OFFERED, member(1), PIECE)
NOW = 100.0


def moment(**changes: Any) -> Moment:
    known: dict[str, Any] = {
        "now": NOW,
        "member": member(0),
        "boot": 3,
        "arc": HALF,
        "gap": None,
        "lease_s": 8.0,
        "grants_leases": True,
        "is_draining": False,
        "handovers": [(Side.RIGHT, GIVEN)],
        "pieces": {GIVEN.id: Counts(7, 700)},
        "statistics": StoreStatistics(20, 2_000, {}, 4_096, 10**9),
        "capacity_bytes": 8_192,
        "memory_fraction": 0.25,
        "strays": 2,
        "strays_more": True,
        "damaged": 0,
        "rays_per_second": 5,
        "events": {"given": 1, DROPPED: 4, TURNED_AWAY: 5, LOG_PACKETS: 6},
        "balance": {"paused": False, "to_give": {"left": 9}},
        "blacklist": Blacklist(7, (address_prefix("10.1.2.0/24"), address_prefix("10.9.9.9"))),
    }
    return Moment(**{**known, **changes})


def roster_of(registry: Registry) -> Roster:
    roster = Roster(node(0))
    roster.set_members(registry, NOW - 50)
    return roster


def test_a_client_reads_what_a_node_writes() -> None:
    registry = folded(found(3), add(0), add(1))
    memory = Memory(begun=10.0, looked_at=NOW)
    memory.note_handovers([(Side.RIGHT, GIVEN)], NOW - 4)
    document = report_of(moment(), registry, roster_of(registry), memory)
    read = read_report(pack_value(document), address_of(node(0)))
    assert (read.blacklist, read.blacklist_version) == (("10.1.2.0/24", "10.9.9.9"), 7)
    assert (read.role, read.boot, read.arc, read.lease_s, read.grants_leases, read.log_position) == ("voter", 3, HALF, 8.0, True, 3)
    assert (read.records, read.fill, read.strays, read.strays_more, read.seconds_up) == (20, 0.5, 2, True, 90.0)
    (handover,) = read.handovers
    assert (handover.gives, handover.open, handover.peer, handover.piece) == (True, True, address_of(node(1)), PIECE)
    assert (handover.seconds, handover.records, handover.bytes) == (4.0, 7, 700)
    assert not handover.peer_removed
    assert (read.dropped, read.turned_away, read.log_packets) == (4, 5, 6)
    assert list(read.peers) == [address_of(node(1)), address_of(node(2))]
    assert all(peer.heard_s is None and not peer.alive for peer in read.peers.values())


def test_a_piece_that_is_about_to_be_taken_back_is_told_apart() -> None:
    registry = folded(found(3), add(0), add(1), RemoveNode(GIVEN.peer, "gone"))
    (handover,) = read_report(
        pack_value(report_of(moment(), registry, roster_of(registry), Memory(NOW, NOW))), address_of(node(0))
    ).handovers
    assert handover.peer_removed


def test_a_report_of_the_largest_cluster_fits_its_packet() -> None:
    registry = folded(found(NODES_MAX))
    document = report_of(moment(handovers=[]), registry, roster_of(registry), Memory(NOW, NOW))
    assert len(document["peers"]) == NODES_MAX - 1
    assert len(pack_value(document)) < DOCUMENT_BYTES_MAX


def test_a_role_is_what_the_log_and_the_holding_make_it() -> None:
    registry = folded(found(2), add(0), add(1))
    assert role_of(registry, member(0), HALF, is_draining=False) == "voter"
    assert role_of(registry, member(1), HALF, is_draining=False) == "member"
    assert role_of(registry, member(1), HALF, is_draining=True) == "draining"
    assert role_of(registry, member(1), None, is_draining=False) == "joining"
    assert role_of(registry, member(1, life=1), None, is_draining=False) == "joining"


def test_a_handover_is_as_old_as_it_was_seen_first_and_forgotten_with_its_end() -> None:
    memory = Memory(0.0, 0.0)
    memory.note_handovers([(Side.RIGHT, GIVEN)], 5.0)
    memory.note_handovers([(Side.RIGHT, GIVEN)], 65.0)
    assert memory.since == {GIVEN.id: 5.0}
    memory.note_handovers([], 70.0)
    assert memory.since == {}


def test_a_node_that_did_not_run_for_a_while_notices() -> None:
    memory = Memory(0.0, 0.0)
    memory.note_look(LOOK_S + 1.0)
    assert memory.stalls == 0
    memory.note_look(2 * LOOK_S + 301.0)
    assert (memory.stalls, memory.stalled_s, memory.stalled_at) == (1, 300.0, 2 * LOOK_S + 301.0)
