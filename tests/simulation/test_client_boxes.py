"""If this fails, a record that was put at a position is missing from a query of a box that holds it."""

from __future__ import annotations

import random
from collections.abc import Sequence

import pytest

from scenefold.base.location import FIRST, LAST, LINE_LENGTH, Location
from scenefold.client.access import SceneAccess
from scenefold.client.positions import found_in_box
from scenefold.client.runs import STEPS_MAX, Run, stepped
from scenefold.client.space import Space
from scenefold.scene.log import LoggedSpace
from scenefold.scene.log.affine import Affine
from simulation.test_client_on_moving_bounds import client
from unit.peer.data_nodes import LEFT, RIGHT, Neighbours, with_nodes
from unit.peer.scenes_made import SPACE

COUNT = 100


def logged(dimensions: int, curve: str = "hilbert", transform: Affine | None = None) -> LoggedSpace:
    low, high = (-1.0,) * dimensions, (1.0,) * dimensions
    return LoggedSpace(SPACE, "boxes", dimensions, curve, low, high, transform or Affine.identity(dimensions))  # type: ignore[arg-type]


class Boxes:
    """Records put at positions of one space, and what boxes of it hold."""

    def __init__(self, neighbours: Neighbours, space: LoggedSpace) -> None:
        self.space = space
        self.records: Space = client(neighbours).space(SPACE)
        self.access: SceneAccess = self.records._access

    async def put(self, positions: Sequence[Sequence[float]], payloads: Sequence[bytes]) -> list[Location]:
        wanted = self.space.locations_of([list(position) for position in positions])
        return await self.records.put_fresh(list(zip(wanted, payloads, strict=True)))

    async def box(self, low: Sequence[float], high: Sequence[float], *, deleted: bool = False) -> list[Location]:
        found = [found.location async for found in found_in_box(self.access, self.space, low, high, deleted=deleted)]
        assert len(set(found)) == len(found)
        return found

    async def payloads(self, low: Sequence[float], high: Sequence[float]) -> list[bytes]:
        found = await self.records.get_many(await self.box(low, high))
        assert None not in found
        return sorted(payload for payload in found if payload is not None)


@pytest.mark.parametrize("dimensions", range(1, 9))
@pytest.mark.parametrize("curve", ["hilbert", "z-order"])
def test_equal_positions_are_all_in_the_box_of_that_position(dimensions: int, curve: str) -> None:
    async def test(neighbours: Neighbours, *_: object) -> None:
        boxes = Boxes(neighbours, logged(dimensions, curve))
        point = (0.3,) * dimensions
        payloads = sorted(b"%d" % number for number in range(COUNT))
        await boxes.put([point] * COUNT, payloads)
        assert await boxes.payloads(point, point) == payloads
        assert await boxes.payloads([0.29] * dimensions, [0.31] * dimensions) == payloads
        assert await boxes.box([-0.5] * dimensions, [0.29] * dimensions) == [], "nobody wanted a place there"

    with_nodes(test, LEFT, RIGHT)


@pytest.mark.parametrize("dimensions", [1, 3, 4, 6])
@pytest.mark.parametrize("transform", [Affine(0.01, (5.0,) * 8), Affine(1e6, (0.0,) * 8)])
def test_they_are_when_the_space_has_been_moved_and_scaled(dimensions: int, transform: Affine) -> None:
    async def test(neighbours: Neighbours, *_: object) -> None:
        moved = Affine(transform.factor, transform.offset[:dimensions])
        boxes = Boxes(neighbours, logged(dimensions, transform=moved))
        low, high = boxes.space.world_box
        point = [(one + 2 * other) / 3 for one, other in zip(low, high, strict=True)]
        await boxes.put([point] * COUNT, [b"%d" % number for number in range(COUNT)])
        assert len(await boxes.box(point, point)) == COUNT

    with_nodes(test, LEFT, RIGHT)


@pytest.mark.parametrize("dimensions", [3, 4, 5, 8])
def test_a_run_goes_on_from_the_end_of_the_line_at_its_beginning(dimensions: int) -> None:
    async def test(neighbours: Neighbours, *_: object) -> None:
        boxes = Boxes(neighbours, logged(dimensions, "z-order"))
        corner, other = (1.0,) * dimensions, (-1.0,) * dimensions
        assert boxes.space.locations_of([corner])[0].number > LAST.number - 64
        first = await boxes.put([other] * 5, [b"first %d" % number for number in range(5)])
        assert first[0] == FIRST
        stored = await boxes.put([corner] * COUNT, [b"%d" % number for number in range(COUNT)])
        assert any(location.number < COUNT + 5 for location in stored)
        assert set(stored) <= set(await boxes.box(corner, corner))
        assert set(await boxes.box(other, other)) >= set(first)
        assert len(await boxes.box(other, corner)) == COUNT + 5

    with_nodes(test, LEFT, RIGHT)


@pytest.mark.parametrize("dimensions", [3, 4, 8])
def test_what_was_deleted_makes_room_and_is_not_listed(dimensions: int) -> None:
    async def test(neighbours: Neighbours, *_: object) -> None:
        boxes = Boxes(neighbours, logged(dimensions))
        point = (0.3,) * dimensions
        for number in range(20):
            [location] = await boxes.put([point], [b"%d" % number])
            assert await boxes.payloads(point, point) == [b"%d" % number]
            await boxes.records.delete(location)
            assert await boxes.box(point, point) == []
        assert len(await boxes.box(point, point, deleted=True)) == 1, "the place was used again and again"
        stored = await boxes.put([point] * COUNT, [b"%d" % number for number in range(COUNT)])
        for location in stored[: COUNT // 2]:
            await boxes.records.delete(location)
        assert await boxes.box(point, point) == stored[COUNT // 2 :]
        assert [location async for location in boxes.records.query()] == stored[COUNT // 2 :]
        assert [location async for location in boxes.records.query(deleted=True)] == stored
        again = await boxes.put([point] * COUNT, [b"%d" % number for number in range(COUNT)])
        assert sorted(again) == stored, "what is there is kept, and what was deleted comes back to free places"
        assert await boxes.payloads(point, point) == sorted(b"%d" % number for number in range(COUNT))

    with_nodes(test, LEFT, RIGHT)


@pytest.mark.parametrize("seed", range(6))
def test_a_box_holds_whatever_was_put_in_it_however_dense_it_is(seed: int) -> None:
    async def test(neighbours: Neighbours, *_: object) -> None:
        dice = random.Random(seed)
        dimensions = dice.choice([2, 3, 4, 5])
        boxes = Boxes(neighbours, logged(dimensions, dice.choice(["hilbert", "z-order"])))
        step = 2.0 ** (1 - boxes.space.lattice.curve.cell_bits)
        points = [tuple(0.25 + step * dice.randrange(3) for _ in range(dimensions)) for _ in range(150)]
        stored = await boxes.put(points, [b"%d" % number for number in range(len(points))])
        for location in dice.sample(stored, 30):
            await boxes.records.delete(location)
        there = {location async for location in boxes.records.query()}
        for _ in range(10):
            low, high = zip(
                *(sorted(0.25 + step * (dice.randrange(3) + 0.5 * dice.random()) for _ in range(2)) for _ in points[0]), strict=True
            )
            cells = boxes.space.cell_box(low, high)
            wanted = boxes.space.in_cells(boxes.space.locations_of(points), cells)
            inside = {location for location, is_inside in zip(stored, wanted, strict=True) if is_inside}
            assert inside & there <= set(await boxes.box(low, high))

    with_nodes(test, LEFT, RIGHT, seed=seed)


def test_a_run_ends_at_a_gap_and_where_nobody_would_have_looked_further() -> None:
    run, start = Run(), Location.from_number(LINE_LENGTH - 2)
    assert not run.keeps(stepped(start, -1), inside=False)
    assert run.keeps(start, inside=True)
    assert all(run.keeps(stepped(start, step), inside=False) for step in range(1, STEPS_MAX))
    assert not run.keeps(stepped(start, STEPS_MAX), inside=False)
    assert run.keeps(start, inside=True)
    assert not run.keeps(stepped(start, 2), inside=False)
    assert not run.keeps(stepped(start, 3), inside=False), "it has ended"
