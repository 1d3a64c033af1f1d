"""What clients do all the time: write, replace, compare and set, delete, read, ask for ranges (specs/17-simulation.md, Workload).

A few dozen hot places are everybody's, so that clients meet there: ends of the line, both sides of every founder's bound,
and others; a wider set gives handovers something to carry. What an act is, and where, is drawn from the seed.
"""

from __future__ import annotations

import random
from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import trio

from scenefold.base.errors import DamagedData, PeerFault, Refused, Unreachable
from scenefold.base.ids import SpaceId
from scenefold.base.location import FIRST, LAST, LINE_LENGTH, Location, even_right_bounds
from scenefold.base.reasons import RejectReason
from scenefold.client.managed import ManagedPlace
from scenefold.client.scene import Scene
from scenefold.client.sealing import Opened
from scenefold.client.space import ABSENT
from scenefold.client.wishes import Wish
from scenefold.scene.layout import META, RENDERS
from scenefold.simulation.copying import KEPT, KEPT_OBJECTS
from scenefold.simulation.outcome import Workload

Key = tuple[SpaceId, Location]
ACT_S_MAX = 8.0
"""A user gives up; what was sent may still happen."""
WIDE_PLACES = 200
HOT_PLACES = 12
"""Beside those at the founders' bounds."""
PAUSE_S = {"data": 0.5, "all": 0.5, "members": 1.4, "keys": 0.6, "purges": 0.5, "turns": 0.5, "logs": 0.5, "renders": 0.5}
"""Seconds between the acts of one client, on average."""
_ACTS = {
    "put": 20,
    "put absent": 8,
    "put over": 16,
    "delete": 4,
    "get": 22,
    "get many": 13,
    "put many": 7,
    "range": 6,
    "get wide": 2,
    "put wide": 3,
    "put managed": 2,
    "replace managed": 3,
    "delete managed": 1,
    "get managed": 3,
    "list managed": 1,
}
DELETES_MORE = 5
"""Times as often where deletions are purged."""
MANAGED = b""
PAYLOAD_BYTES = (8, 8, 40, 200, 3_000)
WIDE_BYTES = (2_000, 20_000)
"""Balance leaves less than 64 KiB where it is."""


def client_name(number: int) -> str:
    """The name of a client, and of its machine."""
    return f"user:c{number}"


@dataclass(frozen=True, slots=True)
class Places:
    """Where clients work."""

    hot: tuple[Location, ...]
    wide: tuple[Location, ...]
    objects: dict[SpaceId, list[ManagedPlace]] = field(default_factory=lambda: defaultdict(list))
    """Records of which the nodes chose the places, by space, and where they were. All clients share them, as they do places."""


def draw_places(seed: int, nodes: int) -> Places:
    """The places of a seed."""
    dice = random.Random(f"places/{seed}/{nodes}")
    bounds = even_right_bounds(nodes)
    at_bounds = [bound for bound in bounds if dice.random() < 0.7]
    beside = [following for bound in at_bounds if (following := bound.next()) is not None]
    anywhere = [Location.from_number(dice.randrange(LINE_LENGTH)) for _ in range(HOT_PLACES)]
    wide = [Location.from_number(number) for number in _numbers(dice)]
    return Places(tuple(sorted({FIRST, LAST, *at_bounds, *beside, *anywhere})), tuple(sorted(wide)))


def _numbers(dice: random.Random) -> list[int]:
    """Of the wide places: all over the line, or, in two seeds of three, mostly on a piece of it, which makes bounds move."""
    if dice.random() < 1 / 3:
        return [dice.randrange(LINE_LENGTH) for _ in range(WIDE_PLACES)]
    start, width = dice.randrange(LINE_LENGTH), LINE_LENGTH // dice.randint(4, 40)
    return [(start + dice.randrange(width if dice.random() < 0.9 else LINE_LENGTH)) % LINE_LENGTH for _ in range(WIDE_PLACES)]


@dataclass(slots=True)
class Tally:
    """How acts ended; what must never happen is kept in words."""

    done: int = 0
    refused: int = 0
    given_up: int = 0
    wrong: list[str] = field(default_factory=list)
    written: set[tuple[bytes, bytes]] = field(default_factory=set)
    """All that anybody wrote, and where; MANAGED where the nodes chose."""


SINGLE = ((META, RENDERS),)
"""A space in which records have places, and one in which the nodes choose them: what a client works in at a time."""
WITH_COPIES = (*SINGLE, (KEPT, KEPT_OBJECTS))


class Worker:
    """One client at work on one scene."""

    def __init__(
        self,
        name: str,
        scene: Scene,
        places: Places,
        seed: int,
        workload: Workload,
        tally: Tally,
        nonsense: Callable[[], int],
        pairs: Sequence[tuple[SpaceId, SpaceId]] = SINGLE,
    ) -> None:
        """`nonsense`: how many answers of lying nodes this client was given; then it may say so, and believe none of it."""
        self._name = name
        self._access = scene.access
        self._scene = scene
        self._pairs = pairs
        self._in = pairs[0]
        """Where this act is."""
        self._objects_seen: dict[bytes, bytes] = {}
        """The digest of what this client wrote last to an object."""
        self._places = places
        self._dice = random.Random(f"work/{seed}/{name}")
        self._pause_s = PAUSE_S[workload]
        self._deletes_more = workload == "purges"
        self._tally = tally
        self._nonsense = nonsense
        self._newest: dict[Key, tuple[Opened, int]] = {}
        """What was read last at a place, and how often the client had noticed there that it was led back."""
        self._seen: dict[Key, bytes | None] = {}
        """The digest last seen at a place; None: nothing was there."""

    async def run(self, stop: trio.Event) -> None:
        """Work until told to stop; an act that has begun is ended."""
        acts = list(_ACTS)
        weights = [_ACTS[act] * (DELETES_MORE if self._deletes_more and act.startswith("delete") else 1) for act in acts]
        while not stop.is_set():
            await trio.sleep(self._dice.random() * 2 * self._pause_s)
            if len(self._pairs) > 1:
                self._in = self._dice.choice(self._pairs)
            await self.act(self._dice.choices(acts, weights)[0])

    async def act(self, act: str) -> None:
        """One act, to its end or until patience is over."""
        heard = self._nonsense()
        with trio.move_on_after(ACT_S_MAX):
            try:
                await self._do(act)
                self._tally.done += 1
                return
            except Refused as refusal:
                self._tally.refused += 1
                is_grave = refusal.reason in (RejectReason.SIGNATURE_INVALID, RejectReason.ILL_FORMED, RejectReason.NOT_AUTHORISED)
                if is_grave and self._nonsense() == heard:
                    self._tally.wrong.append(f"{self._name}: {act} is refused: {refusal}")
                return
            except Unreachable as silence:
                # A write that was answered with nonsense may have happened; that nodes here answer so is a fault all the same.
                if isinstance(silence.__cause__, DamagedData | PeerFault) and self._nonsense() == heard:
                    self._tally.wrong.append(f"{self._name}: {act}: {silence.__cause__}")
            except (DamagedData, PeerFault) as problem:
                if self._nonsense() == heard:
                    self._tally.wrong.append(f"{self._name}: {act}: {problem}")
                return
        self._tally.given_up += 1

    async def _do(self, act: str) -> None:
        dice, hot, wide = self._dice, self._places.hot, self._places.wide
        place = dice.choice(hot)
        match act:
            case "put":
                await self._put(place, None)
            case "put absent":
                await self._put(place, ABSENT)
            case "put over":
                await self._put_over(place)
            case "delete":
                self._seen.pop(self._key(place), None)
                # Where it has deleted something itself, nothing is nothing less.
                self._newest.pop(self._key(place), None)
                await self._scene.space(self._in[0]).delete(place)
            case "get":
                await self._get([place])
            case "get many":
                await self._get(dice.sample(hot, min(6, len(hot))))
            case "get wide":
                await self._get(dice.sample(wide, 16))
            case "put many":
                await self._put_many(dice.sample(hot, 4), PAYLOAD_BYTES)
            case "put wide":
                await self._put_many(dice.sample(wide, 16), WIDE_BYTES)
            case "range":
                await self._list(*sorted(dice.sample([*hot, *wide], 2)))
            case _:
                await self._do_managed(act)

    async def _do_managed(self, act: str) -> None:
        known, dice, managed = self._places.objects[self._in[1]], self._dice, self._scene.space(self._in[1]).managed
        if act == "put managed" or not known:
            stored = await managed.put(self._payload_of(MANAGED))
            known.append(stored.place)
            self._objects_seen[stored.place.object] = stored.digest
            return
        # Mostly one of the newest, so that clients meet there.
        place = known[-1 - min(int(dice.expovariate(0.3)), len(known) - 1)]
        match act:
            case "replace managed":
                expect = self._objects_seen.pop(place.object, None) if dice.random() < 0.5 else None
                stored = await managed.replace(place, self._payload_of(MANAGED), expect=expect)
                self._objects_seen[place.object] = stored.digest
            case "delete managed":
                self._objects_seen.pop(place.object, None)
                await managed.delete(place)
            case "list managed":
                async for _ in managed.query(deleted=True):
                    pass
            case _:
                payloads = await managed.get([place, *dice.sample(known, min(2, len(known)))])
                if any(payload is not None and (MANAGED, payload) not in self._tally.written for payload in payloads):
                    self._tally.wrong.append(f"{self._name}: get: an object that nobody wrote")

    async def _put_over(self, place: Location) -> None:
        """Replace what was last seen there."""
        key = self._key(place)
        if self._seen.get(key) is None:
            await self._get([place])
        await self._put(place, self._seen.get(key) or ABSENT)

    async def _list(self, first: Location, last: Location) -> None:
        async for _ in self._scene.space(self._in[0]).query(first, last, deleted=True):
            pass

    async def _put(self, place: Location, expect: bytes | None) -> None:
        key = self._key(place)
        self._seen.pop(key, None)
        (placed,) = await self._access.put([Wish(*key, self._payload_of(place), expect)])
        if not placed.reason:
            self._seen[key] = placed.digest

    async def _put_many(self, places: list[Location], sizes: tuple[int, ...]) -> None:
        for place in places:
            self._seen.pop(self._key(place), None)
        await self._access.put([Wish(*self._key(place), self._payload_of(place, sizes)) for place in places])

    async def _get(self, places: list[Location]) -> None:
        keys = [self._key(place) for place in places]
        found = await self._access.get(keys)
        for key, place, record in zip(keys, places, found, strict=True):
            self._seen[key] = None if record is None else record.digest
            self._check_noticed(key, record)
            if record is not None and not record.deleted and (place, record.payload) not in self._tally.written:
                self._tally.wrong.append(f"{self._name}: get: what nobody wrote there")

    def _key(self, place: Location) -> Key:
        return self._in[0], place

    def _check_noticed(self, key: Key, record: Opened | None) -> None:
        """Who is given less than it has read before must notice: where there is one copy, that is all that it can do."""
        noticed = self._access.setbacks.of(key)
        before, noticed_before = self._newest.get(key, (None, 0))
        if record is not None:
            self._newest[key] = record, noticed
        elif before is not None:
            del self._newest[key]
        if before is None or noticed > noticed_before:
            return
        if record is None and self._access.setbacks.ends_deleted(key):
            # A read within another operation (before a write, in a list) has met a deletion meanwhile.
            return
        if before.version > record.version if record is not None else not before.deleted:
            self._tally.wrong.append(f"{self._name}: get: less than it has read before at {key[1].hex()[:8]}…, and does not notice")

    def _payload_of(self, place: bytes, sizes: tuple[int, ...] = PAYLOAD_BYTES) -> bytes:
        payload = self._payload(sizes)
        self._tally.written.add((place, payload))
        return payload

    def _payload(self, sizes: tuple[int, ...] = PAYLOAD_BYTES) -> bytes:
        return self._dice.randbytes(self._dice.choice(sizes))
