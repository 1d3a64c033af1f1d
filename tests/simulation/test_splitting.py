"""If this fails, a record that is split and merged while people work, and a node dies or whoever does it is ended, cannot be read or is lost."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

import pytest
import trio

from scenefold.base.errors import Refused, Unreachable
from scenefold.base.location import Location
from scenefold.base.reasons import RejectReason
from scenefold.client.scene import Scene
from scenefold.client.space import Space
from scenefold.scene.layout import FILES
from simulation.kitchens import KitchenPlay, places_evenly
from simulation.steps import SETTLES_S

RECORDS = 6
ROUNDS, ROUNDS_MAX = 3, 12
"""More than the least only until Ben has read often enough beside them: who dies may be the one he waits for."""
READS = 4
PATIENCES = (0.004, 0.012, 0.03, 0.1, 60.0)
"""Seconds after which somebody is ended who splits or merges; the last time he is not."""


def text(place: int, number: int) -> bytes:
    return b"%d:%d:" % (place, number) + bytes(900)


@dataclass
class Work:
    """What people do meanwhile: Ada edits every other record, Ben reads all of them."""

    places: list[Location]
    ada: Scene
    ben: Scene
    newest: dict[Location, int] = field(default_factory=dict)
    tried: dict[Location, int] = field(default_factory=dict)
    may_fail: bool = False
    reads: int = 0
    done: bool = False

    @contextmanager
    def hardship(self) -> Iterator[None]:
        try:
            yield
        except Unreachable:
            assert self.may_fail
        except Refused as refusal:
            # A record may be written, split and merged more often than one looks.
            if refusal.reason not in (RejectReason.BUSY, *((RejectReason.NOT_READY,) if self.may_fail else ())):
                raise

    async def write(self) -> None:
        number = 0
        while not self.done:
            number += 1
            for index in range(0, RECORDS, 2):
                place = self.places[index]
                self.tried[place] = number
                with self.hardship():
                    await self.ada.space(FILES).put(place, text(index, number))
                    self.newest[place] = number
                await trio.sleep(0.05)

    async def read(self) -> None:
        while not self.done:
            with self.hardship():
                await self.check(self.ben.space(FILES))
                self.reads += 1
            await trio.sleep(0.02)

    async def check(self, files: Space) -> None:
        """Nothing older than what was acknowledged before, nothing that nobody wrote, nothing in halves."""
        least = dict(self.newest)
        found = await files.get_many(self.places)
        for index, (place, payload) in enumerate(zip(self.places, found, strict=True)):
            assert payload is not None
            number = int(payload.split(b":")[1])
            assert payload == text(index, number)
            assert least.get(place, 0) <= number <= self.tried.get(place, 0)


class Play(KitchenPlay):
    async def play(self, scene: Scene, ada: Scene, ben: Scene, nursery: trio.Nursery) -> None:
        files, places = scene.space(FILES), places_evenly(RECORDS)
        await files.put_many((place, text(index, 0)) for index, place in enumerate(places))
        await trio.sleep(SETTLES_S)
        work = Work(places, ada, ben, may_fail=self.count > 0)
        async with trio.open_nursery() as people:
            people.start_soon(work.write)
            people.start_soon(work.read)
            await self._split_and_merge(files, work, nursery)
            work.done = True
        assert work.reads >= READS
        await self._check(files, work)

    async def _split_and_merge(self, files: Space, work: Work, nursery: trio.Nursery) -> None:
        """Each record, again and again, by two at once; each is ended in the midst of it most of the time. A node dies at its n-th commit."""
        self.trap(nursery)

        async def one(verb: str, space: Space, place: Location, patience_s: float) -> None:
            with trio.move_on_after(patience_s), work.hardship():
                await getattr(space, verb)(place)

        mates = files, work.ada.space(FILES)
        for number in range(ROUNDS_MAX):
            if number >= ROUNDS and work.reads >= READS:
                return
            for verb in ("split", "merge"):
                for index, place in enumerate(work.places):
                    patience_s = PATIENCES[(number + index) % len(PATIENCES)]
                    async with trio.open_nursery() as both:
                        for mate in mates:
                            both.start_soon(one, verb, mate, place, patience_s)
                with work.hardship():
                    await mates[number % 2].tidy()

    async def _check(self, files: Space, work: Work) -> None:
        assert self.died == (self.count > 0), "it died in the midst of it"
        await self.stage.until(self.stage.is_quiet)
        await work.check(files)
        await files.tidy()
        report = await files.tidy(dry_run=True)
        assert (report.pending, report.left_over, report.orphaned, report.unclear) == (0, 0, 0, 0)
        for place in work.places:
            await files.merge(place)
        await work.check(files)
        last = await files.tidy()
        assert (last.in_use, last.removed) == (0, 0)
        assert [place async for place in files.query()] == work.places
        self.judge()


def test_splitting_alone_is_met_by_nobody() -> None:
    Play(8, 0).run()


CRASHES = [(seed, slot, count) for seed, (slot, count) in enumerate([(0, 3), (1, 9), (2, 6)], 1)]


@pytest.mark.expect_log("connection was cut|no connection to the node|no lease from the voter|does not answer")
@pytest.mark.parametrize(("seed", "slot", "count"), CRASHES)
def test_a_node_that_dies_meanwhile_disturbs_nobody(seed: int, slot: int, count: int) -> None:
    Play(seed, slot, count).run()
