"""If one fails, nobody is made a holder, a holder never hears of it, or it is for ever waited for who is gone."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest
import trio

from scenefold.base.errors import Refused
from scenefold.base.prefixes import ADDRESS_BITS, AddressPrefix, Blacklist
from scenefold.base.reasons import RejectReason
from scenefold.peer.copies.numbers import first_number
from scenefold.peer.copies.segment import GONE
from scenefold.peer.handlers import Senders
from scenefold.peer.line.ends import Side
from scenefold.peer.line.gaps import GAP_REST_S
from scenefold.peer.replication.placing_wishes import STEADY_S, target_of
from scenefold.peer.replication.telling_words import members_of, untold
from scenefold.peer.timing import T_WAIT_S
from scenefold.store import Outcome, Put, PutResult
from scenefold.wire import CustodySet, Packet, SetCustody
from scenefold.world.sim import run_simulated
from unit.peer.line.street import places
from unit.peer.replication.terrace import HEADER, SCENE, SPACE, THIRDS, THRICE, Home, Terrace, record_at


async def until(condition: Callable[[], bool], seconds: float = 60.0) -> None:
    with trio.move_on_after(seconds):
        while not condition():  # noqa: ASYNC110 - services tell nobody how far they are
            await trio.sleep(0.1)
        return
    raise AssertionError("it has not come to that")


def is_told(home: Home) -> bool:
    """Whether it has placed all of its arc, and everybody has confirmed what it holds."""
    found = home.copies.configurations
    return bool(found.segments) and home.replication.placing._is_placed(THIRDS) and not untold(found)


def holders(home: Home) -> set[int]:
    return {member.node - home.street.homes[0].node for member in members_of(home.copies.configurations)}


def test_holders_are_placed_and_told_before_there_is_a_record() -> None:
    async def main() -> None:
        terrace = Terrace(4)
        async with trio.open_nursery() as nursery:
            await terrace.begin(nursery)
            await until(lambda: all(map(is_told, terrace.homes)))
            for home in terrace.homes:
                for segment in home.copies.configurations.segments:
                    wanted = segment.holders(home.member)
                    assert len(wanted) == 2
                    for other in terrace.homes:
                        entry = other.copies.custody.at(THIRDS, segment.arc.first)
                        assert (entry is not None and entry.owner == home.member) == (other.member in wanted)
            placing = terrace.homes[0].replication.placing
            arc = terrace.homes[0].living.arc
            assert arc is not None
            assert placing.segment_of(SCENE, THRICE, arc.first) is not None
            assert placing.segment_of(SCENE, SPACE, arc.first) is None
            assert (placing.needed_of(SCENE, THRICE), placing.needed_of(SCENE, SPACE)) == (2, 1)
            await placing.ensure_placed(THIRDS)
            await placing.ensure_placed(())
            assert not placing.shortages
            nursery.cancel_scope.cancel()

    run_simulated(1, main, virtual_s_max=200.0, wall_s_max=120.0)


@pytest.mark.expect_log("the connection was cut|had no owner any more|was reset by the peer")
def test_a_removed_holder_is_replaced_and_counted_out_once_its_leases_are_over() -> None:
    async def main() -> None:
        terrace = Terrace(4)
        first = terrace.homes[0]
        async with trio.open_nursery() as nursery:
            await terrace.begin(nursery)
            await until(lambda: all(map(is_told, terrace.homes)))
            gone = next(number for number in sorted(holders(first)) if number)
            member = terrace.homes[gone].member
            terrace.homes[gone].stays_down = True
            terrace.homes[gone].crash()
            terrace.remove(gone)
            removed_at = terrace.net.now
            found = first.copies.configurations.segments

            def is_without() -> bool:
                targets = [target_of(segment, first.member) for segment in first.copies.configurations.segments]
                return not any(member in target[0] for target in targets if target is not None)

            assert found
            assert not is_without()
            # Two have it left: so once what it owned has an owner, or nobody has taken it for long.
            await until(is_without, GAP_REST_S + 3.0)
            assert terrace.net.now - removed_at >= T_WAIT_S
            await until(
                lambda: (
                    not any(
                        segment.bound_of(member) < GONE
                        for segment in first.copies.configurations.segments
                        if member in segment._known(first.member)
                    )
                )
            )
            assert terrace.net.now - removed_at >= T_WAIT_S * 0.9
            await until(lambda: not untold(first.copies.configurations))
            nursery.cancel_scope.cancel()

    run_simulated(2, main, virtual_s_max=300.0, wall_s_max=120.0)


@pytest.mark.expect_log("the connection was cut|had no owner any more|was reset by the peer")
def test_who_alone_has_it_left_places_it_anew_before_the_gap_has_an_owner() -> None:
    async def main() -> None:
        terrace = Terrace(5)
        first = terrace.homes[0]
        async with trio.open_nursery() as nursery:
            await terrace.begin(nursery)
            await until(lambda: all(map(is_told, terrace.homes)))
            segment = first.copies.configurations.segments[0]
            lost = {home for home in terrace.homes if home.member in segment.holders(first.member)}
            assert len(lost) == 2
            for home in lost:
                home.stays_down = True
                home.crash()
                terrace.remove(terrace.homes.index(home))
            removed_at = terrace.net.now

            def is_placed_anew() -> bool:
                found = first.copies.configurations.at(THIRDS, segment.arc.first)
                target = None if found is None else target_of(found, first.member)
                return target is not None and bool(target[0]) and not {home.member for home in lost}.intersection(target[0])

            await until(is_placed_anew, GAP_REST_S)
            assert terrace.net.now - removed_at < T_WAIT_S / 2
            nursery.cancel_scope.cancel()

    run_simulated(3, main, virtual_s_max=300.0, wall_s_max=120.0)


def test_a_blacklist_that_forbids_too_many_is_said() -> None:
    async def main() -> None:
        terrace = Terrace(3)
        first = terrace.homes[0]
        async with trio.open_nursery() as nursery:
            await terrace.begin(nursery)
            await until(lambda: all(map(is_told, terrace.homes)))
            own, placing = first.own, first.replication.placing
            assert own is not None
            own.blacklist = Blacklist(1, (AddressPrefix(terrace.homes[1].node, ADDRESS_BITS),))
            await until(lambda: THIRDS in placing.shortages)
            assert str(placing.shortages[THIRDS]).startswith("2 of the 3 nodes")
            placing.check(SCENE, THRICE)
            own.blacklist = Blacklist(2, tuple(AddressPrefix(home.node, ADDRESS_BITS) for home in terrace.homes[1:]))
            await until(lambda: placing.shortages[THIRDS].possible == 1)
            with pytest.raises(Refused) as refused:
                placing.check(SCENE, THRICE)
            assert refused.value.reason is RejectReason.TOO_FEW_COPIES
            assert first.address in str(refused.value)
            placing.check(SCENE, SPACE)
            nursery.cancel_scope.cancel()

    run_simulated(3, main, virtual_s_max=200.0, wall_s_max=120.0)


def test_who_is_forbidden_goes_on_holding_what_nobody_else_may_until_enough_others_may() -> None:
    async def main() -> None:
        terrace = Terrace(5)
        first = terrace.homes[0]
        async with trio.open_nursery() as nursery:
            await terrace.begin(nursery)
            await until(lambda: all(map(is_told, terrace.homes)))
            own, placing = first.own, first.replication.placing
            assert own is not None

            def active() -> set[int]:
                found = [segment.active(first.member) for segment in first.copies.configurations.segments]
                return {member.node for one in found if one is not None for member in one.members[1:]}

            held = active()
            assert held
            own.blacklist = Blacklist(1, tuple(AddressPrefix(home.node, ADDRESS_BITS) for home in terrace.homes[1:]))
            await until(lambda: THIRDS in placing.shortages)
            await trio.sleep(3 * STEADY_S)
            assert active() == held and is_told(first)
            for home in terrace.homes[1:]:
                entry = home.copies.custody.at(THIRDS, first.living.arc.first) if first.living.arc is not None else None
                segment = first.copies.configurations.at(THIRDS, first.living.arc.first) if first.living.arc is not None else None
                assert segment is not None
                assert (entry is not None and entry.whole) == (home.member in segment.holders(first.member))
            with pytest.raises(Refused):
                placing.check(SCENE, THRICE)
            allowed = {home.node for home in terrace.homes[3:]}
            own.blacklist = Blacklist(2, tuple(AddressPrefix(home.node, ADDRESS_BITS) for home in terrace.homes[1:3]))
            await until(lambda: active() == allowed and is_told(first))
            assert not placing.shortages
            nursery.cancel_scope.cancel()

    run_simulated(5, main, virtual_s_max=200.0, wall_s_max=120.0)


def test_who_waits_for_an_arc_holds_copies_where_writes_need_it_and_so_gets_one() -> None:
    """Else nothing would settle, what has not settled is not given away, and nobody would ever get an arc."""

    async def main() -> None:
        terrace = Terrace(2, newcomers=1, join_before=1)
        owner, other, newcomer = terrace.homes
        for home in terrace.homes:
            home.scenes = {HEADER.scene: replace(SCENE, needed=dict.fromkeys(SCENE.needed, 3))}
        async with trio.open_nursery() as nursery:
            await terrace.begin(nursery)
            await until(lambda: is_told(owner) and is_told(other))
            arc = owner.living.arc
            assert arc is not None and newcomer.living.arc is None
            segment = owner.copies.configurations.at(THIRDS, arc.first)
            assert segment is not None and set(segment.holders(owner.member)) == {other.member, newcomer.member}
            spots = places(arc, 4)
            results = await owner.replication.spreading.put([Put(record_at(place)) for place in spots], owner.scenes)
            assert [isinstance(result, PutResult) and result.outcome for result in results] == [Outcome.STORED] * 4
            assert newcomer.places() == {*spots}
            piece = replace(arc, first=spots[2])
            await until(lambda: not owner.living.parts.settling.settles_in_s(piece))
            await owner.living.give(Side.RIGHT, piece, why="it owns nothing yet")
            await until(lambda: all(map(is_told, terrace.homes)))
            assert newcomer.living.arc == piece
            nursery.cancel_scope.cancel()

    run_simulated(4, main, virtual_s_max=200.0, wall_s_max=120.0)


@pytest.mark.parametrize("lies", ["the highest that can be", "what it is told"])
def test_a_holder_that_lies_about_numbers_keeps_nobody_else_from_being_told(lies: str) -> None:
    """It says that it has met the highest number that there can be before the cluster's log goes on; or, each time, that which it was told."""
    told: list[int] = []

    async def main() -> None:
        terrace = Terrace(4)
        async with trio.open_nursery() as nursery:
            await terrace.begin(nursery)
            liar, *honest = terrace.homes
            highest = first_number(terrace.log.registry.position + 1) - 1

            async def lie(packet: SetCustody, _peer: str) -> Packet:
                told.append(packet.number)
                met = highest if lies == "the highest that can be" else packet.number
                return CustodySet(int(RejectReason.POSITION_BEHIND), met, "a lie")

            liar.handlers._table[SetCustody] = lie, Senders.NODES
            await trio.sleep(20.0)
            for home in honest:
                assert home.copies.configurations.segments
                assert home.copies.configurations.number < highest
            if lies == "the highest that can be":
                assert {holder for home in honest for holder in untold(home.copies.configurations)} <= {liar.member}
            assert len(told) < 120
            nursery.cancel_scope.cancel()

    run_simulated(1, main, virtual_s_max=200.0, wall_s_max=400.0)
