"""If this fails, rays are lost or counted twice between two nodes, or a link takes more memory than it may, or stands still for ever.

Chance carries packets and acknowledgements: it loses, doubles and reorders them, and Hypothesis plays chance.
"""

from __future__ import annotations

import heapq
import random
from collections.abc import Sequence
from dataclasses import dataclass, field

import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenefold.base.errors import PeerFault
from scenefold.render.pool.links.receiver import DELAY_S, UNSAID_PACKETS_MAX, WINDOW, Receiver
from scenefold.render.pool.links.round_trip import RTO_S_MAX, RTO_S_MIN, UNKNOWN, UNMEASURED_MAX, RoundTrip
from scenefold.render.pool.links.sender import BYTES_MAX, GIVE_UP_S, OVERTAKEN_MAX, Sender

TRIP_S = 0.01


@dataclass
class Wire:
    """A sender, a receiver, and what is under way between them; time goes from one event to the next."""

    seed: int
    loss: float
    doubling: float
    spread_s: float
    now: float = 0.0
    sender: Sender[int] = field(default_factory=Sender)
    receiver: Receiver = field(default_factory=Receiver)
    came: list[int] = field(default_factory=list)
    acknowledged: list[int] = field(default_factory=list)
    sendings: int = 0
    acknowledgements: int = 0

    def __post_init__(self) -> None:
        self.chance = random.Random(self.seed)
        self.flying: list[tuple[float, int, int | tuple[int, bytes], int]] = []
        self.flights = 0

    def carry(self, what: int | tuple[int, bytes], size: int) -> None:
        """A packet's number and size, or an acknowledgement."""
        for _ in range(1 + (self.chance.random() < self.doubling)):
            if self.chance.random() >= self.loss:
                self.flights += 1
                heapq.heappush(self.flying, (self.now + TRIP_S / 2 + self.chance.random() * self.spread_s, self.flights, what, size))

    def run(self, sizes: list[int]) -> None:
        """Until all items, 0, 1, 2, …, of these sizes have come and are known to have come."""
        waiting = list(enumerate(sizes))
        for _ in range(20_000):
            while waiting and self.sender.may_send(waiting[0][1]):
                item, size = waiting.pop(0)
                number = self.sender.next_number
                self.sender.send(item, size, self.now)
                self.carry(number, size)
                self.sendings += 1
            assert len(self.sender) <= WINDOW
            assert self.sender.bytes_under_way <= max(BYTES_MAX, *sizes)
            while (again := self.sender.due(self.now)) is not None:
                self.carry(again[0], sizes[again[1]])
                self.sendings += 1
            if self.receiver.due_at is not None and self.receiver.due_at <= self.now:
                self.carry(self.receiver.acknowledge(), 0)
                self.acknowledgements += 1
            if not waiting and not len(self.sender):
                return
            times = [self.flying[0][0]] if self.flying else []
            times += [at for at in (self.sender.due_at, self.receiver.due_at) if at is not None]
            self.now = max(self.now, min(times))
            while self.flying and self.flying[0][0] <= self.now:
                _, _, what, size = heapq.heappop(self.flying)
                self.land(what, size)
        pytest.fail("it stands still")

    def land(self, what: int | tuple[int, bytes], size: int) -> None:
        if isinstance(what, tuple):
            assert len(what[1]) <= WINDOW // 8
            self.acknowledged += self.sender.acknowledge(*what, self.now)
        elif self.receiver.take(what, size, self.now):
            self.came.append(what - 1)


@given(
    seed=st.integers(0, 2**32),
    loss=st.floats(0, 0.6),
    doubling=st.floats(0, 1),
    spread_s=st.sampled_from([0.0, 0.001, 0.1, 3.0]),
    sizes=st.lists(st.sampled_from([1, 256, 600_000, BYTES_MAX, 2 * BYTES_MAX]), min_size=1, max_size=60),
)
def test_whatever_a_network_does_each_packet_counts_once(
    seed: int, loss: float, doubling: float, spread_s: float, sizes: list[int]
) -> None:
    wire = Wire(seed, loss, doubling, spread_s)
    wire.run(sizes)
    assert sorted(wire.came) == sorted(wire.acknowledged) == list(range(len(sizes)))


@pytest.mark.parametrize(("loss", "doubling"), [(0.05, 0.0), (0.0, 0.05), (0.5, 0.5)])
def test_more_packets_than_a_window_holds(loss: float, doubling: float) -> None:
    wire = Wire(5, loss, doubling, 0.02)
    wire.run([256] * (5 * WINDOW))
    assert sorted(wire.came) == list(range(5 * WINDOW))
    assert wire.sendings < 5 * WINDOW * (6 if loss == 0.5 else 2.5)


def test_without_faults_each_is_sent_once_and_few_acknowledgements_come_back() -> None:
    wire = Wire(1, 0.0, 0.0, 0.0)
    wire.run([256] * 1600)
    assert wire.sendings == 1600
    assert wire.acknowledgements <= 1600 / UNSAID_PACKETS_MAX


def _bits(numbers: Sequence[int]) -> bytes:
    """Selective, where nothing is known to have come until then."""
    return sum(1 << number - 1 for number in numbers).to_bytes(WINDOW // 8, "little")


def test_what_is_overtaken_is_sent_again_before_the_timer_runs_out() -> None:
    sender: Sender[str] = Sender()
    later = ["b"] * OVERTAKEN_MAX
    for item in ["a", *later]:
        sender.send(item, 1, 0.0)
    # So many may be overtaken by one on their way.
    all_but_first = list(range(2, OVERTAKEN_MAX + 2))
    assert len(sender.acknowledge(0, _bits(all_but_first[:-1]), 0.01)) == OVERTAKEN_MAX - 1
    assert sender.due(0.01) is None
    assert sender.acknowledge(0, _bits(all_but_first), 0.01) == ["b"]
    assert sender.due_at == 0.0
    assert sender.due(0.01) == (1, "a")
    assert sender.due(0.01) is None
    assert sender.due_at == pytest.approx(0.01 + RTO_S_MIN)


def test_the_timer_sends_the_lowest_alone_and_backs_off() -> None:
    sender: Sender[str] = Sender()
    sender.send("once", 1, 0.0)
    sender.acknowledge(1, b"", 0.1)
    sender.send("a", 1, 0.1)
    sender.send("b", 1, 0.1)
    waits, now = [], 0.1
    for _ in range(5):
        due_at = sender.due_at
        assert due_at is not None
        assert sender.due(due_at - 1e-6) is None
        assert sender.due(due_at) == (2, "a")
        waits.append(due_at - now)
        now = due_at
    assert waits == pytest.approx([RTO_S_MIN, 2 * RTO_S_MIN, 4 * RTO_S_MIN, RTO_S_MAX, RTO_S_MAX])
    assert sender.acknowledge(2, b"", now) == ["a"]
    # Which of its sendings came nobody knows, so it proves nothing of "b".
    assert sender.due(now) is None
    assert sender.due(now + RTO_S_MIN) == (3, "b")


class Pipe:
    """A line of so many bytes a second that holds what was put into it, and on which nothing is lost; acknowledgements come back at once."""

    def __init__(self, bytes_per_s: float) -> None:
        self.rate, self.free_at = bytes_per_s, 0.0
        self.under_way: list[tuple[float, int]] = []

    def put(self, number: int, size: int, now: float) -> None:
        self.free_at = max(self.free_at, now) + size / self.rate
        self.under_way.append((self.free_at, number))


@pytest.mark.parametrize("bits_per_s", [1e6, 10e6, 1e9])
def test_a_slow_line_is_not_filled_with_what_came_already(bits_per_s: float) -> None:
    """As much as can be sent waits to be; after the first half minute almost all that is sent is new."""
    sender: Sender[int] = Sender()
    receiver = Receiver()
    pipe = Pipe(bits_per_s / 8)
    now, new_bytes, again_bytes = 0.0, 0, 0
    while now < 330.0 and new_bytes < 300e6:
        while (again := sender.due(now)) is not None:
            number, size = again
            pipe.put(number, size, now)
            again_bytes += size * (now > 30.0)
        while sender.may_send(size := min(1_180_000, sender.frame_bytes)):
            number = sender.next_number
            sender.send(size, size, now)
            pipe.put(number, size, now)
            new_bytes += size * (now > 30.0 or bits_per_s > 1e8)
        came = min(pipe.under_way)
        due_at = sender.due_at
        assert due_at is not None
        now = min(came[0], max(now, due_at))
        if came[0] <= now:
            pipe.under_way.remove(came)
            receiver.take(came[1], 1, now)
            sender.acknowledge(*receiver.acknowledge(), now)
    assert again_bytes < 0.02 * new_bytes
    assert new_bytes >= min(300e6, 0.97 * 300 * bits_per_s / 8)


def test_after_an_outage_as_much_may_be_under_way_as_before() -> None:
    sender: Sender[str] = Sender()
    sender.send("x", BYTES_MAX // 2, 0.0)
    sender.acknowledge(1, b"", 30.0)
    assert sender.frame_bytes < BYTES_MAX // 16
    now = 30.0
    for number in range(2, 12):
        size = sender.frame_bytes
        sender.send("y", size, now)
        sender.send("y", size, now)
        now += 0.1
        sender.acknowledge(2 * number - 1, b"", now)
    assert sender.frame_bytes == BYTES_MAX // 2


def test_a_link_is_given_up_after_a_silence_and_not_while_it_is_idle() -> None:
    sender: Sender[str] = Sender()
    assert not sender.is_given_up(1e9)
    sender.send("a", 1, 1e6)
    assert not sender.is_given_up(1e6 + GIVE_UP_S - 0.1)
    assert sender.is_given_up(1e6 + GIVE_UP_S)
    sender.acknowledge(1, b"", 1e6 + GIVE_UP_S)
    assert not sender.is_given_up(1e9)


@pytest.mark.parametrize(("all_until", "selective"), [(3, b""), (2**64 - 1, b""), (0, bytes([4])), (1, bytes([2])), (0, b"\xff" * 32)])
def test_who_acknowledges_what_was_never_sent_breaks_the_protocol(all_until: int, selective: bytes) -> None:
    sender: Sender[str] = Sender()
    sender.send("a", 1, 0.0)
    sender.send("b", 1, 0.0)
    with pytest.raises(PeerFault, match="never sent"):
        sender.acknowledge(all_until, selective, 0.0)
    assert len(sender) == 2


@pytest.mark.parametrize("number", [0, WINDOW + 3, 2**64 - 1])
def test_a_number_outside_of_the_window_breaks_the_protocol(number: int) -> None:
    receiver = Receiver()
    assert receiver.take(1, 1, 0.0)
    assert receiver.take(2, 1, 0.0)
    assert receiver.take(WINDOW + 2, 1, 0.0)
    with pytest.raises(PeerFault, match="window"):
        receiver.take(number, 1, 0.0)


def test_acknowledgements_wait_for_more_to_say_unless_something_is_wrong() -> None:
    receiver = Receiver()
    receiver.take(1, 1, 5.0)
    assert receiver.due_at == 5.0 + DELAY_S
    receiver.take(3, 1, 5.01)
    assert receiver.due_at == 5.01, "2 is missing"
    assert receiver.acknowledge() == (1, bytes([2]))
    assert receiver.due_at is None
    assert receiver.take(2, 1, 6.0)
    assert not receiver.take(2, 1, 6.01)
    assert receiver.due_at == 6.01, "what was said of it got lost"
    assert receiver.acknowledge() == (3, b"")


def test_the_timeout_follows_the_round_trip() -> None:
    trip = RoundTrip()
    assert trip.timeout_s == UNKNOWN * RTO_S_MIN
    trip.measured(2.0)
    assert trip.timeout_s == 2.0 + 4 * 1.0
    for _ in range(100):
        trip.measured(2.0)
    assert trip.timeout_s == pytest.approx(3.0)
    trip.ran_out()
    assert trip.timeout_s == pytest.approx(6.0)
    trip.went_on()
    assert trip.timeout_s == pytest.approx(3.0)
    for _ in range(UNMEASURED_MAX):
        trip.ran_out()
        trip.went_on()
    assert trip.timeout_s == pytest.approx(6.0), "nothing comes back before it runs out"
    trip.measured(2.0)
    assert trip.timeout_s == pytest.approx(3.0)
    fresh = RoundTrip()
    fresh.ran_out()
    fresh.went_on()
    assert fresh.timeout_s == 2 * UNKNOWN * RTO_S_MIN, "nothing was measured yet"
