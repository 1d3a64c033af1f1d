"""If this fails, whoever is ended while splitting or merging leaves half a record, or of two who do it at once somebody loses something."""

from __future__ import annotations

import random
from collections.abc import Awaitable, Callable
from contextlib import suppress
from pathlib import Path

import pytest
import trio
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from trio.testing import MockClock

from scenefold.base.errors import LocalFault, Refused, Unreachable
from scenefold.base.location import Location
from scenefold.client.scene import Scene
from scenefold.client.space import Space
from scenefold.client.tidying import Tidied
from scenefold.scene.layout import FILES, GEOMETRY
from scenefold.wire import GetMany, Packet, PutMany, Role
from scenefold.world import Priority
from unit.client.fake_nodes import FakeNodes
from unit.client.splits_made import AT, Ending, atom, ended_at, listed, lying, part_places
from unit.client.test_grants import Studio, card_of

WHOLE = bytes(range(256)) * 20


@pytest.fixture
def studio(tmp_path: Path) -> Studio:
    return Studio(tmp_path)


async def again(studio: Studio) -> Scene:
    """As the next process opens it."""
    return await studio.kitchen(1)


@pytest.mark.parametrize("carried_out", [False, True])
@pytest.mark.parametrize("space_id, make", [(FILES, lambda number: WHOLE[number:]), (GEOMETRY, lambda number: atom(seed=number))])
@pytest.mark.parametrize("verb", ["split", "merge"])
async def test_at_whichever_write_one_is_ended_the_record_is_whole_and_is_gone_on_with(
    autojump_clock: MockClock, studio: Studio, verb: str, space_id: int, make: Callable[[int], bytes], carried_out: bool
) -> None:
    studio.nodes = nodes = Ending()
    scene = await studio.scenes(1).create("kitchen", copies=1)
    endings = 0
    for write in range(1, 20):
        at, payload = Location.from_number(write << 150), make(write)
        mine, other = scene.space(space_id), (await again(studio)).space(space_id)
        await mine.put(at, payload)
        if verb == "merge":
            await mine.split(at)
        was_ended = await ended_at(nodes, write, lambda mine=mine, at=at: getattr(mine, verb)(at), carried_out=carried_out)
        assert await other.get(at) == payload
        assert at in await listed(other) and len(await listed(other)) == write
        if not was_ended:
            break
        endings += 1
        stored = set(await part_places(other))
        report = await getattr(other, verb)(at)
        if verb == "split":
            assert stored & set(await part_places(other)) == stored, "what was stored before was kept"
            assert (await other.split(at)).parts == report.parts
        assert await other.get(at) == payload
    else:
        pytest.fail(f"{verb} was never done")
    assert endings >= 2, "parts and entry point, whole and deletions"
    last = (await again(studio)).space(space_id)
    await last.tidy()
    assert len(await part_places(last)) == (2 * write if verb == "split" else 0)


@given(
    st.lists(
        st.tuples(st.sampled_from(["split", "merge", "tidy", "edit", "delete"]), st.integers(1, 8), st.booleans(), st.integers(2, 5)),
        max_size=8,
    )
)
@settings(max_examples=15, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_whatever_is_ended_wherever_what_was_acknowledged_is_read(tmp_path_factory: pytest.TempPathFactory, steps: list) -> None:  # type: ignore[type-arg]
    async def play() -> None:
        studio = Studio(tmp_path_factory.mktemp("studio"))
        studio.nodes = nodes = Ending()
        await studio.scenes(1).create("kitchen", copies=1)
        may_be: set[bytes | None] = {None}
        for number, (verb, write, carried_out, parts) in enumerate(steps):
            files = (await again(studio)).space(FILES)
            new = b"%d" % number + WHOLE[: 100 + number]

            async def work(files: Space = files, verb: str = verb, new: bytes = new, parts: int = parts) -> None:
                with suppress(LocalFault):  # nothing there, or split otherwise
                    match verb:
                        case "split":
                            await files.split(AT, parts)
                        case "merge":
                            await files.merge(AT)
                        case "tidy":
                            await files.tidy()
                        case "edit":
                            await files.put(AT, new)
                        case "delete":
                            await files.remove(AT)

            was_ended = await ended_at(nodes, write, work, carried_out=carried_out)
            wanted = {"edit": new, "delete": None}
            if verb in wanted:
                may_be = may_be | {wanted[verb]} if was_ended else {wanted[verb]}
            now = await (await again(studio)).space(FILES).get(AT)
            assert now in may_be
            may_be = {now}
        files = (await again(studio)).space(FILES)
        await files.tidy(orphans=True)
        found = await lying(files)
        report = await files.tidy(dry_run=True)
        assert (report.left_over, report.pending, report.orphaned, report.unclear) == (0, 0, 0, 0)
        assert len(found) == report.in_use + (may_be != {None}), "nothing is left that nobody needs"
        assert may_be == {await files.get(AT)}

    trio.run(play, clock=MockClock(autojump_threshold=0))


class Slowly(FakeNodes):
    """Every request waits for dice to say so: whoever does something at once meets in each order, by the seed."""

    dice = random.Random(0)

    async def request(self, address: str, priority: Priority, packet: Packet, timeout: float) -> Packet:
        if isinstance(packet, PutMany | GetMany):
            await trio.sleep(self.dice.random())
        reply = await super().request(address, priority, packet, timeout)
        if isinstance(packet, PutMany | GetMany):
            await trio.sleep(self.dice.random())
        return reply


async def crowd(studio: Studio, works: list[Callable[[Space], Awaitable[object]]]) -> list[object]:
    """Different writers, each with a process of his own, all at once; what each was given, or refused by."""
    given_: list[object] = [None] * len(works)

    async def run(number: int, work: Callable[[Space], Awaitable[object]]) -> None:
        files = (await studio.kitchen(1 + number % 2)).space(FILES)
        try:
            given_[number] = await work(files)
        except (Refused, LocalFault, Unreachable) as problem:
            given_[number] = problem

    async with trio.open_nursery() as nursery:
        for number, work in enumerate(works):
            nursery.start_soon(run, number, work)
    return given_


@pytest.mark.parametrize("seed", range(12))
async def test_of_several_at_once_nobody_loses_anything(autojump_clock: MockClock, studio: Studio, seed: int) -> None:
    studio.nodes = nodes = Slowly()
    nodes.dice = random.Random(seed)
    scene = await studio.scenes(1).create("kitchen", copies=1)
    await scene.grant(card_of(2), Role.WRITER)
    await scene.space(FILES).put(AT, WHOLE)
    seen: list[bytes | None] = []

    async def read(files: Space) -> None:
        for _ in range(4):
            with suppress(Refused):  # written all the time
                seen.append(await files.get(AT))

    works: list[Callable[[Space], Awaitable[object]]] = [
        lambda files: files.split(AT),
        lambda files: files.split(AT),
        lambda files: files.merge(AT),
        lambda files: files.split(AT, 3),
        lambda files: files.tidy(),
        read,
    ]
    nodes.dice.shuffle(works)
    results = await crowd(studio, works)
    assert not [one for one in results if isinstance(one, Unreachable)]
    assert set(seen) == {WHOLE}, "nobody ever reads anything else"
    files = (await again(studio)).space(FILES)
    await files.tidy()
    report = await files.tidy(dry_run=True)
    assert (report.pending, report.left_over, report.orphaned) == (0, 0, 0)
    assert await files.get(AT) == WHOLE
    assert await listed(files) == [AT]


@pytest.mark.parametrize("seed", range(8))
async def test_an_edit_that_was_acknowledged_is_never_undone_by_who_splits(autojump_clock: MockClock, studio: Studio, seed: int) -> None:
    studio.nodes = nodes = Slowly()
    nodes.dice = random.Random(seed)
    scene = await studio.scenes(1).create("kitchen", copies=1)
    await scene.grant(card_of(2), Role.WRITER)
    await scene.space(FILES).put(AT, WHOLE)

    async def edit(files: Space) -> object:
        await trio.sleep(3 * nodes.dice.random())
        (found,) = await files.read([AT])
        assert found is not None
        return await files.put(AT, found.payload + b"+", expect=found.digest)

    results = await crowd(studio, [lambda files: files.split(AT), edit, edit, lambda files: files.merge(AT), edit])
    edits = [one for one in results if isinstance(one, bytes)]
    files = (await again(studio)).space(FILES)
    assert await files.get(AT) == WHOLE + b"+" * len(edits)
    await files.tidy()
    assert await files.get(AT) == WHOLE + b"+" * len(edits)


async def test_who_gives_up_a_splitting_has_begun_anew_who_was_at_it(autojump_clock: MockClock, studio: Studio) -> None:
    studio.nodes = nodes = Ending()
    scene = await studio.scenes(1).create("kitchen", copies=1)
    files = scene.space(FILES)
    await files.put(AT, WHOLE)
    places = (await files.split(AT, dry_run=True)).parts
    entry_point = 1 + len({nodes.table.owner_of(place).address for place in places})
    assert await ended_at(nodes, entry_point, lambda: files.split(AT), carried_out=False)
    looked = await files.tidy(dry_run=True)
    assert (looked.pending, looked.removed) == (2, 0)
    before = await lying(files)
    tidied = await files.tidy()
    assert (tidied.pending, tidied.removed, tidied.left_over) == (2, 2, 0)
    after = await lying(files)
    assert list(after) == [AT] and after[AT].payload == WHOLE
    assert after[AT].digest != before[AT].digest, "who has read it before puts nothing in its place any more"
    assert (await files.split(AT)).changed is True


async def test_parts_without_their_record_stay_unless_asked_for(autojump_clock: MockClock, studio: Studio) -> None:
    scene = await studio.scenes(1).create("kitchen", copies=1)
    files = scene.space(FILES)
    await files.put(AT, WHOLE)
    await files.split(AT)
    del studio.nodes.records[FILES, AT]
    kept = (await again(studio)).space(FILES)
    report = await kept.tidy()
    assert (report.orphaned, report.removed) == (2, 0)
    assert (await kept.tidy(orphans=True)).removed == 2
    assert await lying(kept) == {}


async def test_what_a_walk_cannot_read_it_leaves_and_tells(autojump_clock: MockClock, studio: Studio) -> None:
    scene = await studio.scenes(1).create("kitchen", copies=1)
    files = scene.space(FILES)
    for at in (AT, Location.from_number(5)):
        await files.put(at, WHOLE)
        await files.split(at)
    studio.nodes.rotten.add(AT)
    report: Tidied = await (await again(studio)).space(FILES).tidy()
    assert (report.in_use, report.unclear, report.unreadable, report.removed) == (2, 2, 1, 0)
    assert any("damaged at its owner" in line for line in report.complaints)
    assert report.document()["complaints"] == report.complaints
