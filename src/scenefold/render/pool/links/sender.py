"""The sending end of a link: what is under way, and what is to be sent again when (specs/30-ray-links.md).

Pure; time comes in as seconds. Items are whatever was sent: they come back once they are acknowledged.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Generic, TypeVar

from scenefold.base.errors import PeerFault
from scenefold.render.pool.links.receiver import WINDOW
from scenefold.render.pool.links.round_trip import RoundTrip

T = TypeVar("T")

BYTES_MAX = 4 * 1024 * 1024
"""Under way on a link,"""
BYTES_FIRST = 512 * 1024
"""as long as nobody knows how fast it is so much,"""
BYTES_MIN = 128 * 1024
"""and at least so much, however slow it is."""
SLOW_S = 2.0
"""A packet that takes longer to be acknowledged waits behind too many others, or is too large: so much less is allowed under way."""
QUICK_S = 1.0
"""Of one that took less its size more is allowed."""
GIVE_UP_S = 60.0
OVERTAKEN_MAX = 16
"""A packet is lost if one that left so many sendings later is acknowledged,"""
OVERTAKEN_TRIPS = 2.0
"""or one that left so many round trips later."""


@dataclass(slots=True)
class _UnderWay(Generic[T]):
    item: T
    size: int
    order: int
    """The how manieth sending of the link this was."""
    sent_at: float
    first: tuple[int, float]
    """Order and moment of its first sending."""
    is_lost: bool = False

    @property
    def was_repeated(self) -> bool:
        return self.order != self.first[0]


class Sender(Generic[T]):
    """Numbers items from 1, and holds each until it is acknowledged."""

    def __init__(self) -> None:
        self.next_number = 1
        self.bytes_under_way = 0
        self._under_way: dict[int, _UnderWay[T]] = {}
        """By number, ascending."""
        self._orders = 0
        self._went_on_at = 0.0
        """When something new was acknowledged, or the link was idle, last."""
        self._trip = RoundTrip()
        self._bytes_max = BYTES_FIRST
        self._judged_to = 0
        """Sendings up to this one left by another bound."""

    def __len__(self) -> int:
        """Packets under way."""
        return len(self._under_way)

    def may_send(self, size: int) -> bool:
        """Whether there is credit for one more packet of so many bytes."""
        if not self._under_way:
            return True
        return self.next_number - next(iter(self._under_way)) < WINDOW and self.bytes_under_way + size <= min(BYTES_MAX, self._bytes_max)

    @property
    def frame_bytes(self) -> int:
        """What a packet may take on this link: two are under way, or more."""
        return min(BYTES_MAX, self._bytes_max) // 2

    def send(self, item: T, size: int, now: float) -> None:
        """The item leaves as number `next_number`."""
        assert self.may_send(size)
        if not self._under_way:
            self._went_on_at = now
        order = self._next_order()
        self._under_way[self.next_number] = _UnderWay(item, size, order, now, (order, now))
        self.bytes_under_way += size
        self.next_number += 1

    def left(self, number: int, now: float) -> None:
        """It took until now to hand a packet over."""
        sent = self._under_way.get(number)
        if sent is not None:
            sent.first = sent.first if sent.was_repeated else (sent.order, now)
            sent.sent_at = now

    def acknowledge(self, all_until: int, selective: bytes, now: float) -> list[T]:
        """What is thereby known to have come. PeerFault if it was never sent."""
        above = int.from_bytes(selective, "little")
        if all_until + above.bit_length() >= self.next_number:
            raise PeerFault("a packet is acknowledged that was never sent", where=f"number {all_until + above.bit_length()}")
        came = [number for number in self._under_way if number <= all_until or above >> (number - all_until - 1) & 1]
        if not came:
            return []
        known = [self._under_way.pop(number) for number in came]
        self.bytes_under_way -= sum(one.size for one in known)
        self._went_on_at = now
        for one in known:
            if one.was_repeated:
                self._trip.went_on()
            else:
                self._trip.measured(max(0.0, now - one.sent_at))
            self._judge(one, now - one.first[1])
        self._find_lost(*max(self._sending_that_came(one, now) for one in known), now)
        return [one.item for one in known]

    def _judge(self, came: _UnderWay[T], took_s: float) -> None:
        """How much may be under way, by how long a packet took since it left first, with all that was under way then."""
        if took_s < QUICK_S:
            self._bytes_max = min(BYTES_MAX, self._bytes_max + came.size)
        elif took_s > SLOW_S and came.first[0] > self._judged_to:
            self._bytes_max = max(BYTES_MIN, int(self._bytes_max * SLOW_S / took_s))
            self._judged_to = self._orders

    def _sending_that_came(self, sent: _UnderWay[T], now: float) -> tuple[int, float]:
        """Order and moment of a sending of this packet: its last one only if there was time for that to be acknowledged."""
        trip_s = self._trip.srtt_s
        in_time = not sent.was_repeated or (trip_s is not None and sent.sent_at + trip_s <= now)
        return (sent.order, sent.sent_at) if in_time else sent.first

    def _find_lost(self, order: int, sent_at: float, now: float) -> None:
        """A sending has come: those that left long before it have not. No packet is sent again more than once a round trip."""
        trips_s = None if self._trip.srtt_s is None else OVERTAKEN_TRIPS * self._trip.srtt_s
        for sent in self._under_way.values():
            if sent.was_repeated and (trips_s is None or now < sent.sent_at + trips_s):
                continue
            is_late = trips_s is not None and sent.order < order and sent.sent_at + trips_s <= sent_at
            sent.is_lost = sent.is_lost or is_late or sent.order + OVERTAKEN_MAX <= order

    def due(self, now: float) -> tuple[int, T] | None:
        """A packet to be sent again now, with its number. Ask until there is none."""
        for number, sent in self._under_way.items():
            if sent.is_lost:
                return self._again(number, sent, now)
        if self._under_way and now >= self._timer_at():
            self._trip.ran_out()
            number, sent = next(iter(self._under_way.items()))
            return self._again(number, sent, now)
        return None

    @property
    def due_at(self) -> float | None:
        """When to ask `due` next, if nothing is acknowledged before; None as long as nothing is under way."""
        if not self._under_way:
            return None
        return 0.0 if any(sent.is_lost for sent in self._under_way.values()) else self._timer_at()

    def is_given_up(self, now: float) -> bool:
        """Whether nothing new was acknowledged for too long."""
        return bool(self._under_way) and now - self._went_on_at >= GIVE_UP_S

    def _again(self, number: int, sent: _UnderWay[T], now: float) -> tuple[int, T]:
        sent.order, sent.sent_at, sent.is_lost = self._next_order(), now, False
        return number, sent.item

    def _timer_at(self) -> float:
        lowest = next(iter(self._under_way.values()))
        return max(lowest.sent_at, self._went_on_at) + self._trip.timeout_s

    def _next_order(self) -> int:
        self._orders += 1
        return self._orders
