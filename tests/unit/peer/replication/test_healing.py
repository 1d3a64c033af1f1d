"""If one fails, what rots on one disk is lost though others have it, or something older takes the place of what was acknowledged."""

from __future__ import annotations

from collections.abc import Sequence

import pytest
import trio

from scenefold.base.errors import DamagedData, Refused
from scenefold.base.location import Arc, Location
from scenefold.base.prefixes import ADDRESS_BITS, AddressPrefix, Blacklist
from scenefold.base.reasons import RejectReason
from scenefold.crypto import Record, wanted_place
from scenefold.peer.line.ends import Side
from scenefold.peer.line.strays import Strays
from scenefold.peer.replication import healing
from scenefold.peer.replication.healing_asking import ASK_S_MAX, Asking, Offer
from scenefold.peer.replication.healing_sources import sources_of
from scenefold.peer.replication.lane import item_of
from scenefold.store import Put, Spot
from scenefold.wire import HandRecords, Member, PutManyReply
from scenefold.world import Priority
from unit.peer.line.street import places, rot
from unit.peer.replication.terrace import OBJECTS, SPACE, THIRDS, Home, Terrace, object_record, record_at
from unit.peer.replication.test_comparing import arc_of, holders_of, is_settled, lies_with_all, played
from unit.peer.replication.test_placing import until

HEADER_BYTE, LAST_BYTE = 20, -1
AGAIN_S = 60.0


async def filled(terrace: Terrace, count: int, seq: int = 1) -> list[Location]:
    """Records in the first one's arc, at all who hold them."""
    first = terrace.homes[0]
    await until(lambda: all(map(is_settled, terrace.homes)))
    spots = places(arc_of(first), count + 1)[1:]
    await first.store.put([Put(record_at(place, seq)) for place in spots])
    first.replication.comparing.check_all()
    await until(lambda: lies_with_all(terrace, first, spots))
    await until(lambda: is_settled(first))
    return spots


async def is_sound(home: Home, place: Location, seq: int = 1) -> bool:
    (found,) = await home.store.read([home.spot(place)])
    return isinstance(found, Record) and found.header.seq == seq


async def until_sound(home: Home, place: Location, seq: int = 1) -> None:
    with trio.fail_after(60.0):
        while not await is_sound(home, place, seq):  # noqa: ASYNC110 - a disk tells nobody what it has
            await trio.sleep(0.2)


def count_reads(home: Home, monkeypatch: pytest.MonkeyPatch) -> list[Spot]:
    """What is read there from now on."""
    seen: list[Spot] = []
    read = home.store.read

    async def counted(spots: Sequence[Spot]) -> list[Record | DamagedData | None]:
        seen.extend(spots)
        return await read(spots)

    monkeypatch.setattr(home.store, "read", counted)
    return seen


@pytest.mark.expect_log("damaged|rotten|changed")
@pytest.mark.parametrize("byte", [HEADER_BYTE, LAST_BYTE])
def test_what_has_rotted_comes_back_from_others(byte: int) -> None:
    async def main(terrace: Terrace, _nursery: trio.Nursery) -> None:
        first = terrace.homes[0]
        spots = await filled(terrace, 6)
        holder = holders_of(terrace, first, spots[1])[0]
        rot(first, spots[:1], byte)
        rot(holder, spots[1:2], byte)
        await until_sound(first, spots[0])
        await until_sound(holder, spots[1])
        assert first.living.parts.events["healed"] == 1
        assert holder.living.parts.events["healed"] == 1

    played(main, seed=11)


@pytest.mark.expect_log("damaged|rotten|changed")
def test_nothing_older_takes_the_place_of_a_wreck() -> None:
    async def main(terrace: Terrace, _nursery: trio.Nursery) -> None:
        first = terrace.homes[0]
        (place,) = await filled(terrace, 1)
        late, other = holders_of(terrace, first, place)
        for home in (late, other):
            terrace.net.cut(first.address, home.address)
        # It lies here and with one holder; the other one is owed it.
        await first.store.put([Put(record_at(place, seq=2))], [[late.node]])
        await other.store.merge([Put(record_at(place, seq=2))])
        rot(first, [place], HEADER_BYTE)
        terrace.net.mend(first.address, late.address)
        await until(lambda: first.roster.is_believed_alive(late.node))
        first.replication.comparing.check_all()
        await first.store.read([first.spot(place)])
        await trio.sleep(20.0)
        assert not await is_sound(first, place), "an older version is there"
        terrace.net.mend(first.address, other.address)
        await until_sound(first, place, seq=2)

    played(main, seed=12)


@pytest.mark.expect_log("damaged|rotten|changed")
def test_nor_does_an_older_one_that_somebody_brings_home() -> None:
    async def main(terrace: Terrace, _nursery: trio.Nursery) -> None:
        first = terrace.homes[0]
        (place,) = await filled(terrace, 1, seq=2)
        holders = holders_of(terrace, first, place)
        stranger = next(home for home in terrace.homes if home is not first and home not in holders)
        for home in holders:
            terrace.net.cut(first.address, home.address)
        rot(first, [place], HEADER_BYTE)
        brought = HandRecords((item_of(stranger.spot(place), record_at(place)),))
        reply = await stranger.peers.ask(first.node, Priority.LOW, brought, PutManyReply, 30.0)
        assert [outcome.reason for outcome in reply.outcomes] == [RejectReason.BUSY]
        assert not await is_sound(first, place), "an older version is there"
        for home in holders:
            terrace.net.mend(first.address, home.address)
        await until_sound(first, place, seq=2)

    played(main, seed=12)


@pytest.mark.expect_log("damaged|rotten|changed")
def test_what_a_sure_one_has_lost_too_comes_from_whoever_else_has_that_version() -> None:
    async def main(terrace: Terrace, _nursery: trio.Nursery) -> None:
        first = terrace.homes[0]
        (place,) = await filled(terrace, 1)
        sure, owed = holders_of(terrace, first, place)
        for home in (sure, owed):
            terrace.net.cut(first.address, home.address)
        await first.store.put([Put(record_at(place, seq=2))], [[owed.node]])
        for home in (sure, owed):
            await home.store.merge([Put(record_at(place, seq=2))])
        rot(sure, [place], LAST_BYTE)
        rot(first, [place], HEADER_BYTE)
        await first.store.read([first.spot(place)])
        for home in (sure, owed):
            terrace.net.mend(first.address, home.address)
        await until_sound(first, place, seq=2)

    played(main, seed=18)


@pytest.mark.expect_log("damaged|rotten|changed")
def test_who_is_owed_what_lay_at_a_wreck_gives_it_back_if_it_got_it_nevertheless() -> None:
    async def main(terrace: Terrace, _nursery: trio.Nursery) -> None:
        first = terrace.homes[0]
        (place,) = await filled(terrace, 1)
        late, other = holders_of(terrace, first, place)
        await first.store.put([Put(record_at(place, seq=2))], [[late.node, other.node]])
        await late.store.merge([Put(record_at(place, seq=2))])
        terrace.net.cut(first.address, other.address)
        rot(first, [place], HEADER_BYTE)
        await first.store.read([first.spot(place)])
        await until_sound(first, place, seq=2)

    played(main, seed=18)


@pytest.mark.expect_log("damaged|rotten|changed")
def test_what_nobody_else_ever_had_gives_way_to_the_newest_that_others_have() -> None:
    async def main(terrace: Terrace, _nursery: trio.Nursery) -> None:
        first = terrace.homes[0]
        (place,) = await filled(terrace, 1)
        holders = holders_of(terrace, first, place)
        for home in holders:
            terrace.net.cut(first.address, home.address)
        await first.store.put([Put(record_at(place, seq=2))], [[home.node for home in holders]])
        rot(first, [place], HEADER_BYTE)
        await first.store.read([first.spot(place)])
        terrace.net.mend(first.address, holders[0].address)
        await trio.sleep(30.0)
        assert not await is_sound(first, place), "the other one may have it"
        terrace.net.mend(first.address, holders[1].address)
        await until_sound(first, place, seq=1)
        await until(lambda: not any(first.store.owed.values()), 120.0)

    played(main, seed=20)


@pytest.mark.expect_log("damaged|rotten|changed")
@pytest.mark.parametrize("byte", [HEADER_BYTE, LAST_BYTE])
def test_what_all_who_hold_it_have_lost_comes_from_whoever_has_it_as_a_stray(byte: int, monkeypatch: pytest.MonkeyPatch) -> None:
    async def brings_nothing(_strays: Strays) -> int:
        return 0

    monkeypatch.setattr(Strays, "_look", brings_nothing)

    async def main(terrace: Terrace, _nursery: trio.Nursery) -> None:
        first = terrace.homes[0]
        (place,) = await filled(terrace, 1)
        holders = holders_of(terrace, first, place)
        stranger = next(home for home in terrace.homes if home is not first and home not in holders)
        for home in holders:
            await home.store.remove([(home.spot(place), record_at(place).header.digest)])
        await stranger.store.merge([Put(record_at(place))])
        rot(first, [place], byte)
        await first.store.read([first.spot(place)])
        await until_sound(first, place)
        assert not first.replication.healing.unhealed

    played(main, seed=19)


@pytest.mark.expect_log("damaged|rotten|changed")
def test_who_says_nothing_does_not_cost_each_record_his_time() -> None:
    async def main(terrace: Terrace, _nursery: trio.Nursery) -> None:
        first = terrace.homes[0]
        spots = await filled(terrace, 12)
        silent = holders_of(terrace, first, spots[0])[0]
        mine = [place for place in spots if silent in holders_of(terrace, first, place)]
        assert len(mine) > 3
        terrace.net.cut(first.address, silent.address)
        rot(first, mine, LAST_BYTE)
        begun = trio.current_time()
        await first.store.read([first.spot(place) for place in mine])
        for place in mine:
            await until_sound(first, place)
        assert trio.current_time() - begun < ASK_S_MAX * len(mine) / 3

    played(main, seed=19)


@pytest.mark.expect_log("damaged|rotten|changed")
def test_no_older_stray_takes_the_place_of_what_is_known(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[int] = []
    anywhere = Asking.anywhere

    async def heard(self: Asking, spot: Spot, members: Sequence[Member]) -> list[Offer]:
        offers = await anywhere(self, spot, members)
        asked.append(len(offers))
        return offers

    monkeypatch.setattr(Asking, "anywhere", heard)

    async def main(terrace: Terrace, _nursery: trio.Nursery) -> None:
        first = terrace.homes[0]
        (place,) = await filled(terrace, 1, seq=2)
        holders = holders_of(terrace, first, place)
        stranger = next(home for home in terrace.homes if home is not first and home not in holders)
        for home in holders:
            rot(home, [place], LAST_BYTE)
        await stranger.store.merge([Put(record_at(place))])
        rot(first, [place], HEADER_BYTE)
        await first.store.read([first.spot(place)])
        await until(lambda: first.replication.healing.unhealed == 1, 120.0)
        assert asked[0] == 1, "the stray was not met"
        assert not await is_sound(first, place)
        await first.store.merge([Put(record_at(place, seq=2))])
        await until_sound(first, place, seq=2)

    played(main, seed=19)


@pytest.mark.expect_log("damaged|rotten|changed")
def test_a_wreck_is_not_given_up_because_one_has_lost_it_as_long_as_another_may_have_it() -> None:
    async def main(terrace: Terrace, _nursery: trio.Nursery) -> None:
        first = terrace.homes[0]
        (place,) = await filled(terrace, 1)
        one, other = holders_of(terrace, first, place)
        await one.store.remove([(one.spot(place), record_at(place).header.digest)])
        terrace.net.cut(first.address, other.address)
        rot(first, [place], HEADER_BYTE)
        await first.store.read([first.spot(place)])
        await trio.sleep(60.0)
        assert not first.store.noticed.is_given_up(first.spot(place))
        terrace.net.mend(first.address, other.address)
        await until_sound(first, place)

    played(main, seed=19)


@pytest.mark.expect_log("damaged|rotten|changed")
def test_a_piece_with_a_wreck_in_it_stays_as_long_as_others_may_have_what_lay_there() -> None:
    async def main(terrace: Terrace, _nursery: trio.Nursery) -> None:
        first, second = terrace.homes[:2]
        (place,) = await filled(terrace, 1)
        holders = holders_of(terrace, first, place)
        for home in holders:
            terrace.net.cut(first.address, home.address)
        piece = Arc(place, arc_of(first).last)
        await until(lambda: first.living.settled(piece))
        rot(first, [place], HEADER_BYTE)
        if second in holders:
            terrace.net.mend(first.address, second.address)
            await second.store.remove([(second.spot(place), record_at(place).header.digest)])
            await until(lambda: first.roster.is_believed_alive(second.node))
        with pytest.raises(Refused, match="has rotted, and is being fetched"):
            await first.living.give(Side.RIGHT, piece, why="balance")
        assert arc_of(first).last == piece.last
        for home in holders:
            terrace.net.mend(first.address, home.address)
        await until_sound(first, place)
        await first.living.give(Side.RIGHT, piece, why="balance")
        assert await is_sound(second, place)

    played(main, seed=16)


@pytest.mark.expect_log("damaged|rotten|changed")
def test_a_piece_with_a_wreck_that_nobody_has_any_more_is_let_go_of() -> None:
    async def main(terrace: Terrace, _nursery: trio.Nursery) -> None:
        first = terrace.homes[0]
        (place,) = await filled(terrace, 1)
        piece = Arc(place, arc_of(first).last)
        for home in holders_of(terrace, first, place):
            await home.store.remove([(home.spot(place), record_at(place).header.digest)])
        rot(first, [place], HEADER_BYTE)
        await first.store.read([first.spot(place)])
        await until(lambda: first.replication.healing.unhealed == 1, 120.0)
        await until(lambda: first.living.settled(piece))
        await first.living.give(Side.RIGHT, piece, why="balance")
        assert arc_of(terrace.homes[1]).first == place

    played(main, seed=17)


@pytest.mark.expect_log("damaged|rotten|changed")
def test_who_has_it_by_owning_the_place_from_now_on_is_asked_at_once_by_those_who_gave_it_up() -> None:
    async def main(terrace: Terrace, _nursery: trio.Nursery) -> None:
        first, second = terrace.homes[:2]
        spots = await filled(terrace, 6)
        place = next(place for place in spots if second not in holders_of(terrace, first, place))
        former = [first, *holders_of(terrace, first, place)]
        for home in former:
            rot(home, [place], LAST_BYTE)
            await home.store.read([home.spot(place)])
        await until(lambda: all(home.replication.healing.unhealed == 1 for home in former), 120.0)
        piece = Arc(place, arc_of(first).last)
        await until(lambda: first.living.settled(piece))
        # A stray until it owns the place: nobody is sent what lies there already.
        await second.store.merge([Put(record_at(place))])
        await first.living.give(Side.RIGHT, piece, why="balance")
        assert not any([await is_sound(home, place) for home in former])
        await until(lambda: is_settled(second) and len(holders_of(terrace, second, place)) == 2)
        for home in holders_of(terrace, second, place):
            await until_sound(home, place)
        assert all(not home.replication.healing.unhealed for home in terrace.homes)

    played(main, seed=19)


@pytest.mark.expect_log("damaged|rotten|changed")
def test_what_had_rotted_as_a_stray_is_fetched_once_it_lies_here_by_right() -> None:
    async def main(terrace: Terrace, _nursery: trio.Nursery) -> None:
        first = terrace.homes[0]
        (place,) = await filled(terrace, 1)
        former, other = holders_of(terrace, first, place)
        (spare,) = [home for home in terrace.homes if home not in (first, former, other)]
        assert first.own is not None
        first.own.blacklist = Blacklist(1, (AddressPrefix(former.node, ADDRESS_BITS),))
        await spare.store.merge([Put(record_at(place))])
        rot(spare, [place], LAST_BYTE)
        await spare.store.read([spare.spot(place)])
        assert spare.replication.healing.unhealed == 0
        await until(lambda: spare in holders_of(terrace, first, place))
        # Nobody reads it for that.
        await until(lambda: spare.living.parts.events["healed"] == 1, 60.0)
        assert await is_sound(spare, place)

    played(main, seed=18)


@pytest.mark.expect_log("damaged|rotten|changed")
def test_objects_heal_where_they_lie() -> None:
    async def main(terrace: Terrace, _nursery: trio.Nursery) -> None:
        first = terrace.homes[0]
        await until(lambda: all(map(is_settled, terrace.homes)))
        thing = bytes(places(arc_of(first), 3)[1][:16])
        await first.store.put([Put(object_record(thing))])
        first.replication.comparing.check_all()
        (spot,) = first.spots(OBJECTS)
        holder = holders_of(terrace, first, wanted_place(thing))[0]
        await until(lambda: spot in holder.spots(OBJECTS))
        for home in (first, holder):
            rot(home, [spot.place.location], LAST_BYTE)
            with trio.fail_after(60.0):
                while not isinstance((await home.store.read([spot]))[0], Record):  # noqa: ASYNC110
                    await trio.sleep(0.2)

    played(main, seed=13)


def test_who_lacks_what_lay_there_is_not_believed() -> None:
    async def main(terrace: Terrace, _nursery: trio.Nursery) -> None:
        first = terrace.homes[0]
        (place,) = await filled(terrace, 1)
        one, other = holders_of(terrace, first, place)
        spot = first.spot(place)
        found = sources_of(first.copies, THIRDS, spot, [one.node], owns=True)
        assert found is not None
        assert (set(found.members), found.sure) == ({one.member, other.member}, (other.member,))
        held = sources_of(one.copies, THIRDS, spot, [], owns=False)
        assert held is not None
        assert (held.members, held.sure, held.all_of) == ((first.member, other.member), (first.member,), ())
        assert sources_of(first.copies, (), spot, [], owns=True) is None

    played(main, seed=14)


@pytest.mark.expect_log("damaged|rotten|changed")
def test_what_nobody_else_has_is_told_as_given_up_until_it_is_written_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(healing, "AGAIN_S", AGAIN_S)

    async def main(terrace: Terrace, _nursery: trio.Nursery) -> None:
        first = terrace.homes[0]
        (place,) = places(arc_of(first), 1)
        await first.store.put([Put(record_at(place, space=SPACE))])
        rot(first, [place], LAST_BYTE)
        await first.store.read([first.spot(place, SPACE)])
        await until(lambda: first.replication.healing.unhealed == 1 and not first.replication.healing.waiting)
        document = await first.replication.health.document()
        assert document["rotten"] == {"waiting": 0, "unhealed": 1, "healed": 0, "more": False}
        reads = count_reads(first, monkeypatch)
        await trio.sleep(3 * AGAIN_S)
        assert (first.replication.healing.unhealed, first.store.damaged, len(reads)) == (1, 1, 0)
        await first.store.put([Put(record_at(place, 2, space=SPACE))])
        assert not first.replication.healing.unhealed

    played(main, seed=12)


@pytest.mark.expect_log("damaged|rotten|changed")
def test_what_all_have_lost_is_asked_for_now_and_then_and_counted_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(healing, "AGAIN_S", AGAIN_S)

    async def main(terrace: Terrace, _nursery: trio.Nursery) -> None:
        first = terrace.homes[0]
        (place,) = await filled(terrace, 1)
        holders = holders_of(terrace, first, place)
        for home in (first, *holders):
            rot(home, [place], LAST_BYTE)
            await home.store.read([home.spot(place)])
        await until(lambda: all(home.replication.healing.unhealed == 1 for home in (first, *holders)), 4 * AGAIN_S)
        await trio.sleep(3 * AGAIN_S)
        assert (first.replication.healing.unhealed, first.store.damaged) == (1, 1)
        # Somebody has it again: whoever lacks it gets it from there.
        await holders[0].store.merge([Put(record_at(place))])
        await until(lambda: not first.replication.healing.unhealed, 4 * AGAIN_S)
        await until_sound(first, place)
        await until_sound(holders[1], place)

    played(main, seed=15)
