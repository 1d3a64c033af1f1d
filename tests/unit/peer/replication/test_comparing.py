"""If one fails, a holder counts as complete that is not, nobody ever does, or what a holder has newer is lost."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import pytest
import trio

from scenefold.base.errors import Refused
from scenefold.base.ids import NodeId, SceneId
from scenefold.base.location import Arc, Location
from scenefold.base.prefixes import ADDRESS_BITS, AddressPrefix, Blacklist
from scenefold.base.reasons import RejectReason
from scenefold.crypto import RecordPlace, wanted_place
from scenefold.peer.records.copying import NotKept
from scenefold.peer.records.verification import KnownScene
from scenefold.peer.replication.comparing_space import SpaceComparison
from scenefold.peer.replication.placing_wishes import target_of
from scenefold.peer.replication.telling_words import untold
from scenefold.store import Put, Spot
from scenefold.store.layout import RECORDS, spot_of
from scenefold.world.sim import run_simulated
from unit.peer.line.street import places
from unit.peer.replication.terrace import HEADER, OBJECTS, THIRDS, THRICE, Home, Terrace, object_record, record_at
from unit.peer.replication.test_placing import until
from unit.peer.scenes_made import first_header, sealed

Main = Callable[[Terrace, trio.Nursery], Any]


def played(main: Main, homes: int = 4, seed: int = 1, **more: Any) -> None:
    async def begin() -> None:
        terrace = Terrace(homes, **more)
        async with trio.open_nursery() as nursery:
            await terrace.begin(nursery)
            await main(terrace, nursery)
            nursery.cancel_scope.cancel()

    run_simulated(seed, begin, virtual_s_max=600.0, wall_s_max=240.0)


def is_settled(home: Home) -> bool:
    """Whether all of its arc has the configuration that placement gives, and everybody knows."""
    found = home.copies.configurations
    return (
        home.replication.placing._is_placed(THIRDS)
        and not untold(found)
        and all(segment.is_idle(home.member) for segment in found.segments)
        and not home.store.owed
    )


def arc_of(home: Home) -> Arc:
    arc = home.living.arc
    assert arc is not None
    return arc


def holders_of(terrace: Terrace, owner: Home, location: Location) -> list[Home]:
    segment = owner.copies.configurations.at(THIRDS, location)
    assert segment is not None
    members = segment.holders(owner.member)
    return [home for home in terrace.homes if home.member in members]


def lies_with_all(terrace: Terrace, owner: Home, spots: Sequence[Location]) -> bool:
    had = had_by(terrace)
    return all(place in had[home.node] for place in spots for home in [owner, *holders_of(terrace, owner, place)])


def had_by(terrace: Terrace) -> dict[NodeId, set[Location]]:
    """What lies on each disk now: to look anew for every place would take most of the time of a test."""
    return {home.node: home.places() for home in terrace.homes}


def test_what_holders_lack_comes_to_them() -> None:
    async def main(terrace: Terrace, _nursery: trio.Nursery) -> None:
        first = terrace.homes[0]
        await until(lambda: all(map(is_settled, terrace.homes)))
        for segment in first.copies.configurations.segments:
            active = segment.active(first.member)
            assert active is not None
            assert (len(active.members), active.needed) == (3, 2)
        assert all(entry.whole for home in terrace.homes for entry in home.copies.custody.entries)
        spots = places(arc_of(first), 700)
        # Behind the back of everything, as if debts had been lost.
        await first.store.put([Put(record_at(place)) for place in spots])
        first.replication.comparing.check_all()
        await until(lambda: lies_with_all(terrace, first, spots))
        left = first.replication.comparing.left
        assert (left.segments, left.records) == (0, 0)
        assert left.bytes_per_s > 0

    played(main)


def test_a_new_holder_gets_the_records_of_a_scene_that_its_owner_has_forgotten() -> None:
    """Its header has rotted on the owner's disk; all others know it."""
    other = first_header(spaces=tuple(entry for entry in HEADER.spaces if THRICE in (entry.space, entry.parent)))
    assert other.scene != HEADER.scene
    known = KnownScene.of(other)

    async def main(terrace: Terrace, _nursery: trio.Nursery) -> None:
        first = terrace.homes[0]
        await until(lambda: all(map(is_settled, terrace.homes)))
        scenes = first.living.parts.scenes
        spots = places(arc_of(first), 5)
        for place in spots:
            record = sealed(other, location=place, space=THRICE, nonce=place[:12])
            for home in [first, *holders_of(terrace, first, place)]:
                await home.store.merge([Put(record)])
        for home in terrace.homes[1:]:
            home.scenes[other.scene] = known

        async def asked(scene: SceneId, *, ask: bool = True, **_: Any) -> KnownScene:
            if not ask and scene not in first.scenes:
                raise Refused(RejectReason.UNKNOWN_SCENE_OR_SPACE, "it is unknown here")
            return first.scenes.setdefault(scene, known)

        scenes.known = asked  # type: ignore[method-assign]
        former = holders_of(terrace, first, spots[0])[0]
        assert first.own is not None
        first.own.blacklist = Blacklist(1, (AddressPrefix(former.node, ADDRESS_BITS),))
        await until(lambda: is_settled(first) and not any(former in holders_of(terrace, first, place) for place in spots))
        for place in spots:
            for home in holders_of(terrace, first, place):
                had = {spot_of(key) for key in terrace.net.machine(home.address).disk.peek(RECORDS)}
                assert Spot(RecordPlace(other.scene, THRICE, place)) in had

    played(main)


def test_nobody_is_active_before_he_has_everything() -> None:
    async def main(terrace: Terrace, _nursery: trio.Nursery) -> None:
        first = terrace.homes[0]
        await until(lambda: all(map(is_settled, terrace.homes)))
        spots = places(arc_of(first), 300)
        await first.store.put([Put(record_at(place)) for place in spots])
        first.replication.comparing.check_all()
        await until(lambda: lies_with_all(terrace, first, spots))
        former = holders_of(terrace, first, spots[0])[0]
        assert first.own is not None
        first.own.blacklist = Blacklist(1, (AddressPrefix(former.node, ADDRESS_BITS),))

        def is_over() -> bool:
            had = had_by(terrace)
            for segment in first.durable_copies().configurations.segments:
                newest = segment.newest
                assert newest is not None
                inside = {place for place in spots if place in segment.arc}
                members = [home for home in terrace.homes if home.member in newest.members]
                assert all(inside <= had[home.node] for home in members), "it is active and not complete"
            targets = [target_of(segment, first.member) for segment in first.copies.configurations.segments]
            return is_settled(first) and not any(former.member in target[0] for target in targets if target is not None)

        await until(is_over)
        assert former not in holders_of(terrace, first, spots[0])

    played(main, seed=2)


def test_what_a_holder_has_newer_or_alone_comes_home_and_to_the_others() -> None:
    async def main(terrace: Terrace, _nursery: trio.Nursery) -> None:
        first = terrace.homes[0]
        spots = places(arc_of(first), 40)
        await until(lambda: all(map(is_settled, terrace.homes)))
        await first.store.put([Put(record_at(place)) for place in spots[:20]])
        holder = holders_of(terrace, first, spots[0])[0]
        mine = [place for place in spots if holder in holders_of(terrace, first, place)]
        newer = [record_at(place, seq=2) for place in mine]
        things = [bytes(place[:16]) for place in mine[1:] if wanted_place(bytes(place[:16])) in arc_of(first)][:3]
        await holder.store.merge([Put(record) for record in newer])
        await holder.store.merge([Put(object_record(thing), at=wanted_place(thing)) for thing in things])
        first.replication.comparing.check_all()
        await until(lambda: first.places() >= set(mine))
        await until(lambda: {spot.object for spot in first.spots(OBJECTS)} == set(things))
        await until(lambda: is_settled(first))
        found = await first.store.get_many([first.spot(place).place for place in mine])
        assert [record.header.seq for record in found if record is not None] == [2] * len(mine)
        assert lies_with_all(terrace, first, mine)

    played(main, seed=3)


def test_a_holder_that_was_away_is_compared_when_it_is_heard_again() -> None:
    async def main(terrace: Terrace, _nursery: trio.Nursery) -> None:
        first = terrace.homes[0]
        await until(lambda: all(map(is_settled, terrace.homes)))
        spots = places(arc_of(first), 30)
        await first.store.put([Put(record_at(place)) for place in spots[:10]])
        holder = holders_of(terrace, first, spots[0])[0]
        terrace.net.cut(first.address, holder.address)
        first.replication.comparing.check_all()
        await until(lambda: not first.roster.is_believed_alive(holder.node))
        await first.store.put([Put(record_at(place)) for place in spots[10:]])
        terrace.net.mend(first.address, holder.address)
        mine = {place for place in spots if holder in holders_of(terrace, first, place)}
        await until(lambda: holder.places() >= mine)

    played(main, seed=4)


def test_what_a_holder_refuses_is_not_counted_as_brought() -> None:
    """It does not know the scene any more, so it cannot keep what belongs to it."""

    async def main(terrace: Terrace, _nursery: trio.Nursery) -> None:
        first = terrace.homes[0]
        await until(lambda: all(map(is_settled, terrace.homes)))
        spots = places(arc_of(first), 20)
        former, *others = holders_of(terrace, first, spots[0])
        (spare,) = [home for home in terrace.homes if home not in (first, former, *others)]
        await first.store.put([Put(record_at(place)) for place in spots])
        spare.scenes.clear()
        assert first.own is not None
        first.own.blacklist = Blacklist(1, (AddressPrefix(former.node, ADDRESS_BITS),))
        await until(lambda: first.living.parts.events["comparisons broken off"] > 2)
        assert not spare.places()
        left = first.replication.comparing.left
        assert left.segments > 0
        sound = {member for segment in first.copies.configurations.segments for member in segment.sound if spots[0] in segment.arc}
        assert spare.member not in sound
        spare.scenes.update(first.scenes)
        await until(lambda: is_settled(first), 90.0)
        await until(lambda: spare in holders_of(terrace, first, spots[0]) and lies_with_all(terrace, first, spots))

    played(main, seed=9)


def test_one_space_that_is_never_complete_keeps_no_other_one_from_a_new_holder(monkeypatch: pytest.MonkeyPatch) -> None:
    """As when a record has rotted past knowing, and who may know it is silent."""
    whole = SpaceComparison.run

    async def never(self: SpaceComparison) -> bool:
        return await whole(self) and self._space != THRICE

    async def main(terrace: Terrace, _nursery: trio.Nursery) -> None:
        first = terrace.homes[0]
        await until(lambda: all(map(is_settled, terrace.homes)))
        spots = places(arc_of(first), 11)[1:]
        things = [bytes(place[:16]) for place in spots if wanted_place(bytes(place[:16])) in arc_of(first)]
        former, *others = holders_of(terrace, first, spots[0])
        (spare,) = [home for home in terrace.homes if home not in (first, former, *others)]
        await first.store.put([Put(record_at(place)) for place in spots])
        await first.store.merge([Put(object_record(thing), at=wanted_place(thing)) for thing in things])
        monkeypatch.setattr(SpaceComparison, "run", never)
        assert first.own is not None
        first.own.blacklist = Blacklist(1, (AddressPrefix(former.node, ADDRESS_BITS),))
        await until(lambda: first.living.parts.events["comparisons broken off"] > 2)
        mine = {spot.object for spot in first.spots(OBJECTS) if is_filled(first, spare, spot.home)}
        assert mine
        await until(lambda: {spot.object for spot in spare.spots(OBJECTS)} >= mine)
        sound = {member for segment in first.copies.configurations.segments for member in segment.sound if spots[0] in segment.arc}
        assert spare.member not in sound
        monkeypatch.setattr(SpaceComparison, "run", whole)
        await until(lambda: is_settled(first), 90.0)

    played(main, seed=9)


def is_filled(owner: Home, holder: Home, location: Location) -> bool:
    """Whether it is to have what lies there, and is not complete."""
    segment = owner.copies.configurations.at(THIRDS, location)
    assert segment is not None
    target = target_of(segment, owner.member)
    return target is not None and holder.member in target[0] and holder.member not in segment.sound


def test_who_has_no_room_for_what_a_holder_has_newer_brings_it_what_it_lacks(monkeypatch: pytest.MonkeyPatch) -> None:
    async def main(terrace: Terrace, _nursery: trio.Nursery) -> None:
        first = terrace.homes[0]
        await until(lambda: all(map(is_settled, terrace.homes)))
        spots = places(arc_of(first), 20)
        await first.store.put([Put(record_at(place)) for place in spots[:10]])
        holder = holders_of(terrace, first, spots[0])[0]
        mine = [place for place in spots if holder in holders_of(terrace, first, place)]
        await holder.store.merge([Put(record_at(place)) for place in mine if place not in spots[:10]])

        async def full(puts: Sequence[Put]) -> list[NotKept]:
            return [NotKept(RejectReason.STORAGE_FULL, first.member.node) for _ in puts]

        monkeypatch.setattr(first.replication.comparing, "_merge", full)
        first.replication.comparing.check_all()
        await until(lambda: {place for place in mine if place in spots[:10]} <= holder.places())
        await until(lambda: first.living.parts.events["comparisons broken off"] > 0)

    played(main, seed=3)
