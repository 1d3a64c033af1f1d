"""If this fails, a scene whose key changes while people work in it, and a node dies, cannot be read, or loses what was written."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

import pytest
import trio

from scenefold.base.errors import Refused, Unreachable
from scenefold.base.location import Location
from scenefold.base.reasons import RejectReason
from scenefold.client.progress import ProgressState
from scenefold.client.scene import Scene
from scenefold.crypto import RecordHeader
from scenefold.scene.layout import META, RENDERS
from simulation.kitchens import RESTART_S, KitchenPlay, places_evenly
from simulation.steps import SETTLES_S

RECORDS = 40
SLOWLY = 100.0
"""Bytes a second: a walk takes some eight seconds."""


@dataclass
class Work:
    """What people do meanwhile: Ada overwrites every other record, Ben reads all of them."""

    places: list[Location]
    ada: Scene
    ben: Scene
    newest: dict[Location, int] = field(default_factory=dict)
    tried: dict[Location, int] = field(default_factory=dict)
    may_fail: bool = False
    """Whether a node dies: what it alone holds can be neither read nor written until it is back."""
    reads: int = 0
    done: bool = False

    @contextmanager
    def hardship(self) -> Iterator[None]:
        try:
            yield
        except Unreachable:
            assert self.may_fail
        except Refused as refusal:
            if not self.may_fail or refusal.reason not in (RejectReason.NOT_READY, RejectReason.BUSY):
                raise

    async def write(self) -> None:
        number = 0
        while not self.done:
            number += 1
            for place in self.places[::2]:
                self.tried[place] = number
                with self.hardship():
                    await self.ada.space(META).put(place, b"%d" % number)
                    self.newest[place] = number
                await trio.sleep(0.05)

    async def read(self) -> None:
        while not self.done:
            with self.hardship():
                await self._read()
            await trio.sleep(0.05)

    async def _read(self) -> None:
        least = dict(self.newest)
        found = await self.ben.space(META).get_many(self.places)
        for place, payload in zip(self.places, found, strict=True):
            assert payload is not None
            assert least.get(place, 0) <= int(payload) <= self.tried.get(place, 0)
        self.reads += 1


class Play(KitchenPlay):
    async def play(self, scene: Scene, ada: Scene, ben: Scene, nursery: trio.Nursery) -> None:
        places = places_evenly(RECORDS)
        await scene.space(META).put_many((place, b"0") for place in places)
        objects = [await scene.space(RENDERS).put_managed(b"thing %d" % index) for index in range(6)]
        await trio.sleep(SETTLES_S)
        work = Work(places, ada, ben, may_fail=self.count > 0)
        async with trio.open_nursery() as people:
            people.start_soon(work.write)
            people.start_soon(work.read)
            await trio.sleep(1.0)
            await self._rotate(scene, nursery)
            work.done = True
        assert work.reads > 3
        await self._check(await self.stage.client.scenes.open("kitchen"), work, objects)

    async def _rotate(self, scene: Scene, nursery: trio.Nursery) -> None:
        """A new key, two walks that are ended in their midst, and one that is not; a node dies at its n-th commit."""
        self.trap(nursery)
        for end in ("rotate", "walk", "walk", "finish"):
            with trio.CancelScope() as scope:

                def stop(state: ProgressState, end: str = end, scope: trio.CancelScope = scope) -> None:
                    if end == "walk" and state.done:
                        scope.cancel()

                try:
                    if end == "rotate":
                        await scene.rotate_key()
                    else:
                        await scene.reencrypt(stop, SLOWLY)
                except Unreachable:
                    assert self.count
                    # The keeper of the log was away: nobody knows, so one looks.
                    await trio.sleep(2 * RESTART_S)
                    if end == "finish":
                        await scene.reencrypt()

    async def _check(self, scene: Scene, work: Work, objects: list[Location]) -> None:
        await self.stage.until(self.stage.is_quiet)
        found = await scene.space(META).get_many(work.places)
        for place, payload in zip(work.places, found, strict=True):
            assert payload is not None
            assert work.newest.get(place, 0) <= int(payload) <= work.tried.get(place, 0)
        assert await scene.space(RENDERS).managed.get(objects) == [b"thing %d" % index for index in range(6)]
        epoch = (await scene.members()).key_epoch
        assert epoch == 1
        records = await scene.access.fetch([(META, place) for place in work.places])
        assert {RecordHeader.decode(record.header).key_epoch for record in records if record is not None} == {epoch}
        report = await scene.reencrypt()
        assert (report.renewed, report.unreadable, report.walks) == (0, 0, 1)
        self.judge()


def test_a_rotation_alone_is_met_by_nobody() -> None:
    Play(8, 0).run()


CRASHES = [(seed, slot, count) for seed, (slot, count) in enumerate([(0, 1), (0, 2), (0, 9), (1, 1), (1, 8), (2, 3), (2, 20)], 1)]


@pytest.mark.expect_log("connection was cut|no connection to the node|no lease from the voter|does not answer")
@pytest.mark.parametrize(
    ("seed", "slot", "count"), [pytest.param(*each, marks=pytest.mark.long if each[0] not in (2, 4) else ()) for each in CRASHES]
)
def test_a_rotation_disturbs_nobody(seed: int, slot: int, count: int) -> None:
    Play(seed, slot, count).run()
