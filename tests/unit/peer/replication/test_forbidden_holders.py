"""If this fails, what was acknowledged loses copies that nobody may replace, as its owner's blacklist, or the next owner's, allows too few nodes."""

from __future__ import annotations

from scenefold.base.ids import NodeId
from scenefold.base.location import Arc, Location
from scenefold.peer.copies.configurations import Configurations
from scenefold.peer.copies.segment import Segment
from scenefold.peer.replication.forbidden_holders import with_forbidden
from scenefold.wire import Configuration, Member
from unit.peer.replication.terrace import THIRDS

P, A, B, C, D = (Member(NodeId(node), bytes([node]) * 16) for node in range(1, 6))
ALL = {member.node: member for member in (A, B, C, D)}


def arc(first: int, last: int) -> Arc:
    return Arc(Location.from_number(first), Location.from_number(last))


def test_as_many_of_those_that_hold_it_stay_as_there_are_shadows() -> None:
    found = Configurations(P, 1, (Segment(THIRDS, arc(10, 19), (Configuration(1, (P, A, B), 2),)),))
    assert with_forbidden(found, THIRDS, [(arc(0, 29), ())], ALL) == [(arc(0, 9), ()), (arc(10, 19), (A, B)), (arc(20, 29), ())]
    assert with_forbidden(found, THIRDS, [(arc(10, 19), (C,))], ALL) == [(arc(10, 19), (C, A))]
    assert with_forbidden(found, THIRDS, [(arc(10, 19), (C, D))], ALL) == [(arc(10, 19), (C, D))]
    assert with_forbidden(found, (), [(arc(10, 19), ())], ALL) == [(arc(10, 19), ())]


def test_so_do_those_whom_it_inherits_with_the_piece_its_giver_among_them() -> None:
    """C allowed what P forbids: nobody may hold copies for P but B."""
    inherited = Segment(THIRDS, arc(10, 19), (Configuration(1, (A, D), 1), Configuration(2, (C, P, D), 3)))
    found = Configurations(P, 3, (inherited,))
    assert inherited.active(P) is None
    assert with_forbidden(found, THIRDS, [(arc(10, 19), (B,))], ALL) == [(arc(10, 19), (B, C))]
    assert with_forbidden(found, THIRDS, [(arc(10, 19), (D,))], ALL) == [(arc(10, 19), (D, C))]
    assert with_forbidden(found, THIRDS, [(arc(10, 19), ())], ALL) == [(arc(10, 19), (C, D))]


def test_nobody_stays_who_was_removed_or_is_a_member_anew() -> None:
    found = Configurations(P, 1, (Segment(THIRDS, arc(10, 19), (Configuration(2, (C, A, D), 3),)),))
    left = {A.node: Member(A.node, bytes(16)), D.node: D}
    assert with_forbidden(found, THIRDS, [(arc(10, 19), ())], left) == [(arc(10, 19), (D,))]
