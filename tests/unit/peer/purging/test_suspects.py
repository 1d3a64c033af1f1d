"""If one fails, who comes back brings what was deleted and purged, or loses what nobody else has, or shows it to strangers."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from dataclasses import replace

import pytest
import trio

from scenefold.base.errors import Refused
from scenefold.base.location import Location
from scenefold.base.reasons import RejectReason
from scenefold.crypto import DISCARD_DOMAIN, Record, SigningKey
from scenefold.peer.purging.showing import Showing
from scenefold.peer.purging.suspects import Suspects, told
from scenefold.peer.records.verification import KnownScene
from scenefold.store import Put
from scenefold.wire import (
    DiscardItem,
    DiscardOrder,
    DiscardSuspects,
    FetchSuspects,
    HandRecords,
    ListSuspects,
    OfferStrays,
    RecordEntry,
    SuspectsDiscarded,
    SuspectsFetched,
    SuspectsListed,
)
from scenefold.world.sim import run_simulated
from unit.peer.line.street import places
from unit.peer.replication.terrace import HEADER, USER, Home, Terrace, item_of, record_at
from unit.peer.replication.test_custody_strays import held_of
from unit.peer.scenes_made import SPACE, STRANGER, WRITER

PURGED = KnownScene.of(replace(HEADER, position=3, write_floor=3, purged=3))
"""The scene once all records of this file are older than something that may be purged."""

Test = Callable[[Terrace, Home, Home, list[Location]], Awaitable[None]]


def played(test: Test) -> None:
    """An owner, and another house; places of the owner's."""

    async def main() -> None:
        terrace = Terrace(2, is_quiet=True)
        async with trio.open_nursery() as nursery:
            await terrace.begin(nursery)
            owner, other = terrace.homes
            arc = owner.living.arc
            assert arc is not None
            await test(terrace, owner, other, places(arc, 4))
            nursery.cancel_scope.cancel()

    run_simulated(7, main, virtual_s_max=200.0, wall_s_max=60.0)


def old(place: Location, seq: int = 1) -> Record:
    return record_at(place, seq, space=SPACE)


async def returned(home: Home, records: list[Record], scene: KnownScene = PURGED) -> Suspects:
    """What these are to a house that was away while it had them."""
    store = home.living.parts.store
    await store.merge(list(map(Put, records)))
    await store.renew_identity()
    home.scenes[HEADER.scene] = scene
    suspects = Suspects(home.living.parts)
    await suspects.set_aside()
    return suspects


async def kept(home: Home) -> set[Location]:
    page = await home.living.parts.store.suspects(None, b"", 100)
    return {held.spot.place.location for held in page.records}


def test_only_of_scenes_that_something_was_purged_of_anything_is_suspect() -> None:
    async def test(_terrace: Terrace, _owner: Home, other: Home, spots: list[Location]) -> None:
        suspects = await returned(other, [old(place) for place in spots], KnownScene.of(HEADER))
        assert (await kept(other), other.places(SPACE)) == (set(), set(spots))
        assert suspects.document() == {"records": 0, "scenes": []}
        assert not await other.living.parts.store.has_former_life()

    played(test)


@pytest.mark.expect_log("set aside")
def test_what_a_former_life_has_left_is_set_aside_and_what_came_since_is_not() -> None:
    async def test(_terrace: Terrace, _owner: Home, other: Home, spots: list[Location]) -> None:
        suspects = await returned(other, [old(place) for place in spots[:3]])
        assert (await kept(other), other.places(SPACE)) == (set(spots[:3]), set())
        assert suspects.document() == {"records": 3, "scenes": [{"scene": f"{HEADER.scene:08x}", "records": 3}]}
        await other.living.parts.store.merge([Put(old(spots[3]))])
        await suspects.set_aside()
        assert (len(await kept(other)), other.places(SPACE)) == (3, {spots[3]})

    played(test)


@pytest.mark.expect_log("set aside")
def test_of_a_scene_that_nobody_knows_all_is_kept() -> None:
    async def test(_terrace: Terrace, _owner: Home, other: Home, spots: list[Location]) -> None:
        store = other.living.parts.store
        await store.merge([Put(old(place)) for place in spots])
        await store.renew_identity()
        other.scenes.clear()
        await Suspects(other.living.parts).set_aside()
        assert (await kept(other), other.places(SPACE)) == (set(spots), set())

    played(test)


@pytest.mark.expect_log("set aside")
def test_what_the_owner_has_goes_and_what_it_lacks_stays() -> None:
    async def test(terrace: Terrace, owner: Home, other: Home, spots: list[Location]) -> None:
        same, newer, lacking, here = spots
        await owner.living.parts.store.merge([Put(old(same)), Put(old(newer, 2))])
        suspects = await returned(other, [old(place) for place in spots])
        await other.living.parts.store.merge([Put(old(here))])
        async with trio.open_nursery() as nursery:
            nursery.start_soon(suspects.run)
            with trio.fail_after(60.0):
                while len(await kept(other)) > 1:  # noqa: ASYNC110 - a walk tells nobody that it has ended
                    await trio.sleep(0.5)
            await trio.sleep(30.0)
            nursery.cancel_scope.cancel()
        assert await kept(other) == {lacking}
        assert suspects.document()["records"] == 1
        assert owner.places(SPACE) == {same, newer, here}, "no suspect was brought home; what came here since was"

    played(test)


@pytest.mark.expect_log("set aside")
def test_members_are_shown_them_and_others_are_not() -> None:
    async def test(_terrace: Terrace, _owner: Home, other: Home, spots: list[Location]) -> None:
        suspects = await returned(other, [old(place) for place in spots])
        Showing(other.living.parts, suspects, lambda user, _scene: user == USER).register(other.handlers)
        page = await other.asked(ListSuspects(HEADER.scene, b"", 3), USER)
        assert isinstance(page, SuspectsListed) and page.next is not None
        rest = await other.asked(ListSuspects(HEADER.scene, page.next, 3), USER)
        assert [held.location for held in (*page.records, *rest.records)] == sorted(spots)
        assert page.holder == other.member
        whole = RecordEntry(HEADER.scene, SPACE, spots[0], b"", old(spots[0]).header.digest)
        reply = await other.asked(FetchSuspects((replace(whole, digest=bytes(32)), whole)), USER)
        assert isinstance(reply, SuspectsFetched)
        assert ([item.header for item in reply.items], reply.missing) == ([old(spots[0]).header_bytes], (0,))
        for packet in (ListSuspects(HEADER.scene, b"", 3), FetchSuspects((whole,))):
            with pytest.raises(Refused, match="no member of scene"):
                await other.asked(packet, "user:stranger")
            with pytest.raises(Refused, match="may not send"):
                await other.asked(packet, other.node)

    played(test)


@pytest.mark.expect_log("set aside")
def test_a_writers_order_deletes_these_very_versions_at_this_very_node() -> None:
    async def test(_terrace: Terrace, owner: Home, other: Home, spots: list[Location]) -> None:
        suspects = await returned(other, [old(place) for place in spots])
        Showing(other.living.parts, suspects, lambda user, _scene: user == USER).register(other.handlers)
        items = [DiscardItem(SPACE, place, b"", old(place).header.digest) for place in spots[:2]]
        items[1] = replace(items[1], digest=bytes(32))
        order = DiscardOrder(HEADER.scene, 3, WRITER.key_id, other.member, tuple(items))

        def signed(order: DiscardOrder, key: SigningKey = WRITER) -> DiscardSuspects:
            return DiscardSuspects(replace(order, signature=key.sign(DISCARD_DOMAIN, order.signable(HEADER.genesis))))

        wrong = (
            (signed(replace(order, holder=owner.member)), RejectReason.WRONG_INCARNATION),
            (signed(replace(order, position=9)), RejectReason.NOT_READY),
            (signed(order, STRANGER), RejectReason.SIGNATURE_INVALID),
            (signed(replace(order, writer=STRANGER.key_id), STRANGER), RejectReason.NOT_AUTHORISED),
            (DiscardSuspects(replace(signed(order).order, items=order.items[:1])), RejectReason.SIGNATURE_INVALID),
        )
        for packet, reason in wrong:
            with pytest.raises(Refused) as refused:
                await other.asked(packet, USER)
            assert refused.value.reason is reason
        with pytest.raises(Refused, match="no member of scene"):
            await other.asked(signed(order), "user:stranger")
        assert len(await kept(other)) == 4
        reply = await other.asked(signed(order), USER)
        assert isinstance(reply, SuspectsDiscarded) and reply.discarded == 1
        assert await kept(other) == set(spots[1:])

    played(test)


@pytest.mark.expect_log("set aside")
def test_they_are_offered_as_what_they_are() -> None:
    async def test(_terrace: Terrace, _owner: Home, other: Home, spots: list[Location]) -> None:
        await returned(other, [old(spots[0])])
        (held,) = (await other.living.parts.store.suspects(None, b"", 1)).records
        assert (told(held).location, told(held).version.digest) == (spots[0], old(spots[0]).header.digest)

    played(test)


def test_who_was_removed_brings_nothing_home() -> None:
    async def test(terrace: Terrace, owner: Home, other: Home, spots: list[Location]) -> None:
        await owner.asked(OfferStrays((held_of(old(spots[0])),)), other.node)
        terrace.remove(1)
        for packet in (OfferStrays((held_of(old(spots[0])),)), HandRecords((item_of(old(spots[0])),))):
            with pytest.raises(Refused, match="no member"):
                await owner.asked(packet, other.node)

    played(test)
