"""If one fails, a reader who takes bytes from anybody goes by a version that its owner may not speak for."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from scenefold.base.location import Arc
from scenefold.crypto import wanted_place
from scenefold.store import Put, version_of
from scenefold.wire import Configuration, Copy, CopyState
from unit.peer.line.street import rot
from unit.peer.replication.holders import arc_of, entrust, play, some_places
from unit.peer.replication.terrace import OBJECTS, Home, Terrace, object_record, record_at
from unit.peer.replication.test_showing import IN_BODY, IN_HEADER, copies, key

NO_CUSTODY = Copy(CopyState.NO_CUSTODY, 0, b"", None)
NOTHING = Copy(CopyState.NOTHING, 0, b"", None)


async def versions(owner: Home, *keys: Any) -> tuple[Copy, ...]:
    found = await copies(owner, *keys, digests_only=True)
    assert all(one == Configuration(0, (owner.member,), 1) for one in found.holders), "by itself alone"
    return found.copies


def test_an_owner_says_which_versions_lie_at_its_places_and_gives_no_records_so() -> None:
    async def story(terrace: Terrace) -> None:
        owner, holder, _ = terrace.homes
        there, absent = some_places(owner, 2)
        name = bytes(some_places(owner, 5)[3])[:16]
        record, thing = record_at(there), object_record(name)
        await owner.store.put([Put(record)])
        await owner.store.merge([Put(thing, at=wanted_place(name))])
        keys = key(there), key(absent), key(wanted_place(name), OBJECTS, name), key(some_places(holder, 1)[0])
        digest, other = version_of(record.header_bytes), version_of(thing.header_bytes)
        assert await versions(owner, *keys) == (
            Copy(CopyState.DIGEST, 0, digest, None),
            NOTHING,
            Copy(CopyState.DIGEST, 0, other, None),
            NO_CUSTODY,
        )
        for any_copy, digests_only in ((False, False), (True, False), (True, True)):
            found = await copies(owner, *keys, any_copy=any_copy, digests_only=digests_only)
            assert set(found.copies) == {NO_CUSTODY}, "as a holder it has nothing"

    play(story)


def test_without_a_lease_or_while_something_is_unsettled_it_says_nothing() -> None:
    async def story(terrace: Terrace) -> None:
        owner = terrace.homes[0]
        spots = some_places(owner, 2)
        await owner.store.put([Put(record_at(spots[0]))])
        keys = [key(spot) for spot in spots]
        owner.leased = False
        assert await versions(owner, *keys) == (NO_CUSTODY, NO_CUSTODY)
        owner.leased = True
        settled, asked = owner.replication.spreading.records_settled, []

        async def unsettled(spots: Any, found: Any, until: float) -> bool:
            asked.append((list(spots), list(found)))
            return await settled(spots, found, until) and len(asked) > 1

        owner.replication.spreading.records_settled = unsettled  # type: ignore[method-assign]
        assert await versions(owner, *keys) == (NO_CUSTODY, NO_CUSTODY)
        assert (await versions(owner, *keys))[1] == NOTHING
        assert [None if one is None else one.header_bytes for one in asked[0][1]] == [record_at(spots[0]).header_bytes, None]

    play(story)


@pytest.mark.expect_log("damaged|changed")
def test_of_what_has_rotted_the_version_is_told_if_it_is_known() -> None:
    async def story(terrace: Terrace) -> None:
        owner = terrace.homes[0]
        first, second = some_places(owner, 2)
        await owner.store.put([Put(record_at(first)), Put(record_at(second))])
        rot(owner, [first], IN_BODY)
        rot(owner, [second], IN_HEADER)
        body, header = await versions(owner, key(first), key(second))
        assert body.digest == version_of(record_at(first).header_bytes), "others have it"
        assert header == Copy(CopyState.DAMAGED, 0, b"", None)

    play(story)


def test_a_holder_that_owns_some_of_it_says_of_each_what_it_is_there() -> None:
    async def story(terrace: Terrace) -> None:
        owner, holder, other = await entrust(terrace)
        theirs, mine = some_places(owner, 1)[0], some_places(holder, 1)[0]
        await holder.store.merge([Put(record_at(theirs)), Put(record_at(mine))])
        found = await copies(holder, key(theirs), key(mine), digests_only=True)
        assert [found.holders[copy.holders].members for copy in found.copies] == [
            (owner.member, holder.member, other.member),
            (holder.member,),
        ]

    play(story)


def test_an_arc_that_changes_meanwhile_is_looked_at_again() -> None:
    async def story(terrace: Terrace) -> None:
        owner = terrace.homes[0]
        (spot,) = some_places(owner, 1)
        keeper, headers, arc = owner.living.parts.keeper, owner.store.record_headers, arc_of(owner)
        looks = 0

        async def slow(spots: Any) -> Any:
            nonlocal looks
            looks += 1
            found = await headers(spots)
            if looks == 1:
                await owner.store.put([Put(record_at(spot))])
                # What went and came back is equal, and another object.
                keeper.holding = replace(keeper.holding, arc=Arc(arc.first, arc.last))
            return found

        owner.store.record_headers = slow
        (copy,) = await versions(owner, key(spot))
        assert (looks, copy.state) == (2, CopyState.DIGEST)

    play(story)
