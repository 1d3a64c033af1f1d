"""If this failed, some order of puts, copies, deletions, releases and crashes would make the store forget or invent records.

The store on a simulated disk, beside a model that is a dict. A crash strikes before or after exactly one commit; what was
being done then has happened wholly or not at all.
"""

from __future__ import annotations

import copy
import random
from dataclasses import dataclass, field, replace
from pathlib import Path

import pytest
import trio

from scenefold.base.errors import Refused
from scenefold.base.ids import SpaceId
from scenefold.base.location import WHOLE_LINE, Arc, Location
from scenefold.crypto import (
    EXPECTS_ANYTHING,
    EXPECTS_NOTHING,
    OBJECT_BYTES,
    PLACED_BY_NODE,
    Record,
    RecordPlace,
    object_of,
    signed_place,
    version_key,
    wanted_place,
)
from scenefold.store import Counts, Outcome, Put, Spot, Store, StoredHolding, open_store
from scenefold.world.sim import Point, SimNet, run_simulated
from unit.store.samples import NODE, NOWHERE, SCENE, SPACE, record

ADDRESS = "10.0.0.1"
LENGTH = 40
MANAGED = int(SPACE) + 2
SPACES = (int(SPACE), int(SPACE) + 1, MANAGED)
"""Those in MANAGED take objects' homes."""
GROUP = 4
OBJECTS = 6
STEPS = 60


def place(index: int) -> Location:
    """The places of the test: a home of an object, three behind it, the next home."""
    return Location.from_number((index // GROUP << 32) + index % GROUP)


def object_record(number: int, seq: int) -> Record:
    """A version of the object whose home is the first place of that group."""
    fixed = record(0, seq=seq, text=b"%d" % seq, space=MANAGED)
    header = fixed.header._replace(location=signed_place(number.to_bytes(OBJECT_BYTES, "big")), placement=PLACED_BY_NODE)
    return Record(header.encode(), fixed.signature, fixed.ciphertext)


def spot_of_object(kept: Record, at: Location) -> Spot:
    return Spot(RecordPlace(SCENE, SpaceId(MANAGED), at), object_of(kept.header))


async def objects_in(store: Store, name: bytes) -> list[Spot]:
    """Where an object lies, by a walk over everything."""
    page = await store.manifest(WHOLE_LINE, None, 10_000)
    return [entry.spot for entry in page.entries if entry.object == name]


@dataclass
class Model:
    """What should be in a store."""

    records: dict[Spot, Record] = field(default_factory=dict)
    arc: Arc | None = None
    note: bytes | None = None

    def owns(self, location: Location) -> bool:
        return self.arc is not None and location in self.arc

    def merge(self, spot: Spot, new: Record) -> bool:
        """Whether it is there now."""
        present = self.records.get(spot)
        if present is not None and present != new and version_key(new.header) <= version_key(present.header):
            return False
        self.records[spot] = new
        return True

    def put(self, spot: Spot, new: Record) -> Outcome:
        if not self.owns(spot.place.location):
            return Outcome.NOT_OWNED
        present = self.records.get(spot)
        if present == new:
            return Outcome.STORED
        expects = new.header.expects
        if expects != EXPECTS_ANYTHING and expects != (EXPECTS_NOTHING if present is None else present.header.digest):
            return Outcome.EXISTS
        return Outcome.STORED if self.merge(spot, new) else Outcome.STALE

    def holding(self) -> StoredHolding | None:
        return None if self.note is None else StoredHolding(self.arc, self.note)


class Trial:
    """One store through several lives, beside its model."""

    def __init__(self, seed: int) -> None:
        self.dice = random.Random(seed)
        self.model = Model()
        self.before = Model()
        """The model before the step that a crash struck; the same as `model` otherwise."""
        self.removable: list[tuple[Spot, bytes]] = []
        self.choices: list[dict[Spot, Record]] = []
        """What else a crash may leave."""
        self.seq = 0
        self.incarnation = b""
        """Of this life: once it is renewed, the life that goes on can hold nothing."""

    async def step(self, store: Store) -> None:
        self.before = copy.deepcopy(self.model)
        name = self.dice.choice(["put", "put", "put", "managed", "merge", "remove", "arc", "list", "slide", "read", "renew"])
        await getattr(self, f"_{name}")(store)
        self.before = self.model

    # -------------------------------------------------------------------------------------------------- what is done

    def _fixed(self) -> tuple[Spot, Record]:
        self.seq += 1
        seq = self.seq if self.dice.random() < 0.7 else self.dice.randint(1, self.seq)
        number = place(self.dice.randrange(LENGTH)).number
        new = record(number, seq=seq, text=b"%d" % self.dice.randrange(3), space=self.dice.choice(SPACES))
        return Spot(RecordPlace(new.header.scene, new.header.space, new.header.location)), new

    def _expecting(self, spot: Spot, new: Record) -> tuple[Spot, Record]:
        """A record that expects something, or what lies there; sometimes it is the very one that does."""
        there = self.model.records.get(spot)
        if there is not None and self.dice.random() < 0.1:
            return spot, there
        expects = [EXPECTS_ANYTHING, EXPECTS_NOTHING, NOWHERE, there.header.digest if there else EXPECTS_ANYTHING]
        return spot, replace(new, header_bytes=new.header._replace(expects=self.dice.choice(expects)).encode())

    async def _put(self, store: Store) -> None:
        wanted = [self._expecting(*self._fixed()) for _ in range(self.dice.randint(1, 4))]
        expected = [self.model.put(spot, new) for spot, new in wanted]
        results = await store.put([Put(new) for _, new in wanted])
        assert [result.outcome for result in results] == expected

    def _object(self) -> tuple[Record, dict[Spot, Record]]:
        """A new version of some object, and what else is there."""
        self.seq += 1
        new = object_record(self.dice.randrange(1, OBJECTS + 1), self.seq)
        others = {spot: kept for spot, kept in self.model.records.items() if spot.object != object_of(new.header)}
        # Where it goes is the store's choice.
        self.choices = [others | {Spot(RecordPlace(SCENE, SpaceId(MANAGED), WHOLE_LINE.first), b"?"): new}]
        return new, others

    async def _managed(self, store: Store) -> None:
        new, others = self._object()
        before = next((spot.place.location for spot in self.model.records if spot not in others), None)
        [result] = await store.put([Put(new)])
        self.choices = []
        if not self.model.owns(wanted_place(object_of(new.header))):
            assert result.outcome is Outcome.NOT_OWNED
            return
        assert result.outcome is Outcome.STORED and result.location is not None and self.model.owns(result.location)
        assert before is None or not self.model.owns(before) or result.location == before, "it stays where it is"
        self.model.records = others | {spot_of_object(new, result.location): new}

    async def _merge(self, store: Store) -> None:
        if self.dice.random() < 0.7:
            spot, new = self._fixed()
            expected = self.model.merge(spot, new)
            [result] = await store.merge([Put(new)])
            assert (result.outcome is Outcome.STORED) == expected
            return
        new, others = self._object()
        at = place(self.dice.randrange(LENGTH))
        [result] = await store.merge([Put(new, at=at)])
        self.choices = []
        assert result.outcome is Outcome.STORED, "no version of it is as high"
        [spot] = await objects_in(store, object_of(new.header))
        assert self.model.owns(spot.place.location) if self.model.owns(spot.home) else spot.place.location == at
        self.model.records = others | {spot: new}

    async def _list(self, store: Store) -> None:
        piece, limit = self._piece(), self.dice.randint(1, 9)
        entries, cursor = [], None
        while True:
            page, cursor, _ = await store.manifest(piece, cursor, limit)
            entries += page
            if cursor is None:
                break
        expected = sorted((spot, kept.header.digest) for spot, kept in self.model.records.items() if spot.place.location in piece)
        assert [(entry.spot, entry.digest) for entry in entries] == expected
        assert await store.arc_totals(piece) == Counts(len(entries), sum(entry.size for entry in entries))
        self.removable += expected

    async def _remove(self, store: Store) -> None:
        chosen = [self.removable.pop(self.dice.randrange(len(self.removable))) for _ in range(min(4, len(self.removable)))]
        gone = {spot for spot, digest in chosen if spot in self.model.records and self.model.records[spot].header.digest == digest}
        for spot in gone:
            del self.model.records[spot]
        assert await store.remove(chosen) == len(gone)

    async def _arc(self, store: Store) -> None:
        arc = None if self.dice.random() < 0.2 else self._piece()
        note = self.dice.randbytes(3)
        if store.identity.incarnation != self.incarnation:
            with pytest.raises(Refused):
                await store.put_holding(arc, note)
            return
        self.model.arc, self.model.note = arc, note
        await store.put_holding(arc, note)

    async def _slide(self, store: Store) -> None:
        cut = self.dice.randrange(1, LENGTH)
        parts = [Arc(place(0), place(cut - 1)), Arc(place(cut), place(LENGTH - 1))]
        sliding = {
            spot.object: (spot, next(part for part in parts if spot.home in part))
            for spot in self.model.records
            if spot.object and all(spot.home not in part or spot.place.location not in part for part in parts)
        }
        arc = self.model.arc
        assert await store.parted(parts[0]) == sum(arc is not None and spot.home in arc for spot, _ in sliding.values())
        assert await store.slide(parts, 100) == len(sliding)
        for name, (spot, part) in sliding.items():
            [now] = await objects_in(store, name)
            assert now.place.location in part
            self.model.records[now] = self.model.records.pop(spot)

    async def _read(self, store: Store) -> None:
        spots = [self.dice.choice(list(self.model.records)) for _ in range(3) if self.model.records]
        assert await store.read(spots) == [self.model.records[spot] for spot in spots]

    async def _renew(self, store: Store) -> None:
        if self.dice.random() < 0.3:
            self.model.arc = self.model.note = None
            await store.renew_identity()

    def _piece(self) -> Arc:
        first, last = sorted(self.dice.randrange(LENGTH) for _ in range(2))
        return Arc(place(first), place(last))

    # ------------------------------------------------------------------------------------------------ what is there

    async def settle(self, store: Store) -> None:
        """Take over what is there after a crash: it must be the model before the step, or after it."""
        page = await store.manifest(WHOLE_LINE, None, 10_000)
        found = await store.read([entry.spot for entry in page.entries])
        there = {entry.spot: kept for entry, kept in zip(page.entries, found, strict=True) if isinstance(kept, Record)}
        holding = await store.holding()
        assert len(there) == len(found)
        if (there, holding) != (self.before.records, self.before.holding()):
            assert _kept(there) in [_kept(self.model.records), *(_kept(records) for records in self.choices)]
            assert holding == self.model.holding()
        arc_now = None if holding is None else holding.arc
        self.model = Model(there, arc_now, None if holding is None else holding.note)
        self.before, self.choices = self.model, []
        self.incarnation = store.identity.incarnation
        assert store.record_count == len(there)


def _kept(records: dict[Spot, Record]) -> list[bytes]:
    """What is kept, whatever places the store chose."""
    return sorted(kept.encode() for kept in records.values())


async def trial(seed: int) -> None:
    net, run = SimNet(seed), Trial(seed)
    for life in range(6):
        with trio.CancelScope() as scope:

            def crash(scope: trio.CancelScope = scope) -> None:
                net.crash(ADDRESS, torn=run.dice.random() < 0.5)
                scope.cancel()

            world = net.world(f"node:{NODE}", ADDRESS)
            async with open_store(world, Path("data"), NODE) as store:
                assert store.identity.boot == life + 1
                await run.settle(store)
                net.trap(ADDRESS, run.dice.choice([Point.BEFORE_COMMIT, Point.AFTER_COMMIT]), run.dice.randint(2, STEPS), crash)
                for _ in range(STEPS):
                    await run.step(store)
                crash()
        await trio.sleep(2)


@pytest.mark.parametrize("seed", range(25))
def test_no_order_of_changes_and_crashes_confuses_the_store(seed: int) -> None:
    run_simulated(seed, trial, seed)
