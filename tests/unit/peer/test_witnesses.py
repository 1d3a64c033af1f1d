"""If this fails, a node that has just started counts nobody as alive, and believes that it alone knows the scenes that it decides."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from scenefold.base.errors import Refused
from scenefold.base.ids import NodeId
from scenefold.peer.membership.roster import Roster
from scenefold.peer.peers import UNHEARD_S, Peers
from unit.peer.test_roster import ME, OLD, OTHER, PEER, Line, status_of


def peers_of(line: Line, roster: Roster, now: list[float]) -> Peers:
    world: Any = SimpleNamespace(clock=SimpleNamespace(now=lambda: now[0]))
    own: Any = SimpleNamespace(me=ME)
    routing: Any = SimpleNamespace(members=line.order)
    links: Any = None
    return Peers(world, links, own, roster, routing)


def test_a_member_that_was_not_heard_yet_counts_for_a_while() -> None:
    line, roster, now = Line({ME: OLD, PEER: OLD, OTHER: OLD}), Roster(ME), [100.0]
    roster.set_members(line, 100.0)  # type: ignore[arg-type]
    peers = peers_of(line, roster, now)
    assert peers.witnesses() == [PEER, OTHER]
    roster.hear(status_of(PEER, 1), 100.5)
    now[0] += UNHEARD_S
    assert peers.witnesses() == [PEER]
    roster.note_refusal(PEER)
    assert peers.witnesses() == []


def test_a_founder_that_never_came_knows_nothing() -> None:
    line, roster = Line({ME: OLD, PEER: None}), Roster(ME)
    roster.set_members(line, 0.0)  # type: ignore[arg-type]
    assert peers_of(line, roster, [0.0]).witnesses() == []


def test_who_is_no_member_does_not_know_whom_to_ask() -> None:
    line, roster = Line({PEER: OLD, NodeId(77): OLD}), Roster(ME)
    roster.set_members(line, 0.0)  # type: ignore[arg-type]
    with pytest.raises(Refused, match="no member"):
        peers_of(line, roster, [0.0]).witnesses()
