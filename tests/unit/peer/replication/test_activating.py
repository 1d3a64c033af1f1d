"""If one fails, a configuration answers that may not know what was acknowledged, or holders are worked on in a wrong order."""

from __future__ import annotations

import trio

from scenefold.base.ids import NodeId
from scenefold.base.limits import COMPARED_ARCS_MAX
from scenefold.base.location import Arc, Location
from scenefold.base.placement import Layout
from scenefold.peer.copies.configurations import Configurations
from scenefold.peer.copies.copies import Copies
from scenefold.peer.replication.activating import activated
from scenefold.peer.replication.comparing_jobs import jobs, waiting
from scenefold.peer.replication.comparing_progress import Left, Progress
from scenefold.wire import Member
from unit.peer.copies.test_configurations import compare, tell

P, A, B, C = (Member(NodeId(node), bytes([node]) * 16) for node in range(1, 5))
LAYOUT: Layout = (Location.from_number(7), Location.from_number(8))


def arc(first: int, last: int) -> Arc:
    return Arc(Location.from_number(first), Location.from_number(last))


def never(_member: Member, _layout: Layout, _arc: Arc) -> bool:
    return False


def always(_member: Member, _layout: Layout, _arc: Arc) -> bool:
    return True


def placed(holders: tuple[Member, ...] = (A, B)) -> Configurations:
    return Configurations(P).place(LAYOUT, [(arc(0, 99), holders)], 2)


def test_what_was_looked_at_becomes_active_and_nothing_else() -> None:
    found = compare(tell(placed()))
    (segment,) = found.segments
    copies = Copies(found)
    assert activated(copies, {}) is copies, "nobody has looked"
    assert activated(copies, {segment: {frozenset((A, B))}}) is copies, "two of three lack something"
    after = activated(copies, {segment: {frozenset((A,)), frozenset((B,))}}).configurations
    assert after.segments[0].active(P) is not None
    other = compare(tell(found.place(LAYOUT, [(arc(0, 99), (A, C))], 2)))
    changed = Copies(other)
    assert other.segments[0].can_activate(())
    assert activated(changed, {segment: set()}) is changed, "others are new now, and what is owed to them was not looked at"


def test_a_part_of_what_was_looked_at_becomes_active() -> None:
    found = compare(tell(placed()))
    (segment,) = found.segments
    rest, _, _ = found.give(arc(50, 99))
    after = activated(Copies(rest), {segment: set()}).configurations
    assert [(kept.arc, kept.active(P) is not None) for kept in after.segments] == [(arc(0, 49), True)]


def test_who_has_not_confirmed_is_not_compared() -> None:
    found = placed()
    assert jobs(found, never) == {}
    assert waiting(found) == 2
    assert jobs(tell(found, B), never).keys() == {A}


def test_who_is_complete_is_compared_as_a_routine_and_no_more_once_he_was() -> None:
    found = compare(tell(placed()), B)
    assert {holder: job.is_routine for holder, job in jobs(found, never).items()} == {A: True, B: False}
    assert {holder: job.is_routine for holder, job in jobs(found, always).items()} == {B: False}
    assert waiting(found) == 1
    assert jobs(tell(compare(found).activate(lambda _: [])), always) == {}


def test_the_fewest_copies_come_first() -> None:
    found = compare(tell(placed()), B)
    found = tell(found.place(LAYOUT, [(arc(100, 199), (A, B))], 2))
    job = jobs(found, never)[B]
    assert [entry.arc for entry in job.entries] == [arc(100, 199)]
    assert not job.is_routine
    assert jobs(found, never)[A].entries == job.entries


def test_one_job_is_one_packet_of_arcs() -> None:
    pieces = [(arc(2 * number, 2 * number), (A, B) if number % 2 else (A, C)) for number in range(2 * COMPARED_ARCS_MAX)]
    found = tell(Configurations(P).place(LAYOUT, pieces, 2))
    assert len(jobs(found, never)[A].entries) == COMPARED_ARCS_MAX


class Clock:
    def __init__(self) -> None:
        self.time = 100.0

    def now(self) -> float:
        return self.time

    async def sleep(self, seconds: float) -> None:
        await trio.sleep(seconds)


def test_progress_is_what_is_left_and_how_fast_it_goes() -> None:
    clock = Clock()
    progress = Progress(clock)
    assert progress.left() == Left(0, 0, 0, 0.0)
    assert progress.left().seconds == 0.0
    progress.begin("one", 10)
    assert progress.left().seconds is None
    progress.sent("one", 4, 4000)
    assert progress.left() == Left(0, 6, 6000, 400.0)
    assert progress.left().seconds == 15.0
    clock.time += 11.0
    assert progress.left().bytes_per_s == 0.0
    progress.end("one")
    assert progress.left().records == 0


def test_what_is_put_off_comes_behind_all_else_and_is_not_forgotten() -> None:
    found = tell(Configurations(P).place(LAYOUT, [(arc(0, 9), (A, B)), (arc(10, 99), (A, C))], 2))
    both = jobs(found, never)[A].entries
    assert [entry.arc for entry in both] == [arc(0, 9), arc(10, 99)]
    assert [entry.arc for entry in jobs(found, never, put_off=both[:1])[A].entries] == [arc(10, 99)]
    assert jobs(found, never, put_off=both)[A].entries == both, "there is nothing else to do"
