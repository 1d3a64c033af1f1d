"""If this fails, nodes that hold the whole scene get more paths than they can trace, or paths are dealt twice or not at all."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from scenefold.render.ledger import Counts
from scenefold.render.pool.dealing import PROBE_RAYS, Dealer

RAYS = 65_536


def done(rays: int) -> Counts:
    """Of a node that was dealt so many: each made two more."""
    return Counts(created=2 * rays, retired=3 * rays, received=rays)


def test_at_first_all_get_alike() -> None:
    assert Dealer(5).deal(0, RAYS, 0.0) == [13_108, 13_107, 13_107, 13_107, 13_107]
    assert Dealer(3).deal(0, 2, 0.0) == [1, 1, 0]
    assert Dealer(2).deal(0, 0, 0.0) == [0, 0]


@given(
    paces=st.lists(st.floats(1.0, 1e7), min_size=1, max_size=16),
    rays=st.lists(st.integers(0, RAYS), min_size=1, max_size=8),
)
def test_every_ray_is_dealt_once(paces: list[float], rays: list[int]) -> None:
    dealer, now = Dealer(len(paces)), 0.0
    for number, count in enumerate(rays):
        shares = dealer.deal(number, count, now)
        assert sum(shares) == count and min(shares) >= 0
        for node, share in enumerate(shares):
            if node != number % len(paces):
                dealer.reported(number, node, done(share), now + share / paces[node])
        now += 0.1


def test_who_is_slow_gets_what_it_can_trace() -> None:
    dealer, paces = Dealer(4), [100_000.0, 100_000.0, 100_000.0, 10_000.0]
    first = dealer.deal(0, RAYS, 0.0)
    for node, share in enumerate(first):
        dealer.reported(0, node, done(share), share / paces[node])
    shares = dealer.deal(1, RAYS, 2.0)
    assert max(shares[:3]) - min(shares[:3]) <= 1
    assert abs(shares[3] - RAYS / 31) <= 1


def test_who_has_not_answered_is_presumed_to_be_as_fast_as_the_others_for_as_long_as_it_may_be() -> None:
    dealer = Dealer(3)
    first = dealer.deal(0, 30_000, 0.0)
    dealer.reported(0, 0, done(first[0]), 0.1)
    dealer.reported(0, 1, done(first[1]), 0.1)
    assert dealer.deal(1, 30_000, 0.1) == [10_000, 10_000, 10_000]
    for node in (0, 1):
        dealer.reported(1, node, done(10_000), 0.2)
    # A second later it has shown that it is not.
    late = dealer.deal(2, 30_000, 1.0)
    assert late[2] < late[0] / 5 and late[0] == late[1]


def test_who_was_very_slow_and_has_nothing_to_do_is_tried_again() -> None:
    dealer = Dealer(2)
    first = dealer.deal(0, 1_000, 0.0)
    dealer.reported(0, 0, done(first[0]), 0.001)
    assert dealer.deal(1, 1_000, 5_000.0)[1] == 0
    # It still had its part then; now it has not.
    dealer.reported(0, 1, done(first[1]), 5_000.0)
    dealer.closed(1)
    assert dealer.deal(2, 10_000, 5_000.0) == [10_000 - PROBE_RAYS, PROBE_RAYS]
    dealer.reported(2, 1, done(PROBE_RAYS), 5_000.001)
    dealer.reported(2, 0, done(10_000 - PROBE_RAYS), 5_000.1)
    assert dealer.deal(3, 10_000, 5_000.2)[1] > 500


def test_passes_with_few_paths_say_little() -> None:
    """Where an image needs no more samples: what a part takes is the way there and back."""
    dealer, paces, trip_s = Dealer(3), 300_000.0, (0.002, 0.06, 0.06)
    now = 0.0

    def render(number: int, count: int) -> list[int]:
        nonlocal now
        shares = dealer.deal(number, count, now)
        for node, share in enumerate(shares):
            dealer.reported(number, node, done(share), now + trip_s[node] + share / paces)
        now += 0.3
        return shares

    for number in range(6):
        before = render(number, RAYS)
    for number in range(6, 21):
        render(number, 12)
    after = render(21, RAYS)
    assert all(abs(one - other) < RAYS / 20 for one, other in zip(before, after, strict=True))


def test_who_stalls_gets_less_soon() -> None:
    dealer = Dealer(2)
    for number in range(3):
        for node, share in enumerate(dealer.deal(number, 20_000, float(number))):
            dealer.reported(number, node, done(share), number + 0.1)
    assert dealer.deal(3, 20_000, 3.0) == [10_000, 10_000]
    dealer.reported(3, 0, done(10_000), 3.1)
    fewer = dealer.deal(4, 20_000, 4.0)
    assert fewer[1] < 2_500
    # And its usual part again once it is done with all that it had.
    for number, rays in ((3, 10_000), (4, fewer[1])):
        dealer.reported(number, 1, done(rays), 4.1)
    dealer.reported(4, 0, done(fewer[0]), 4.1)
    assert dealer.deal(5, 20_000, 4.2)[1] > fewer[1]


def test_a_part_is_done_only_once_all_of_it_is() -> None:
    dealer = Dealer(2)
    dealer.deal(0, 20_000, 0.0)
    dealer.reported(0, 1, Counts(created=5, retired=5, received=0), 0.01)
    dealer.reported(0, 1, Counts(created=5, retired=9_999, received=10_000), 0.01)
    dealer.reported(0, 1, Counts(created=5, retired=10_004, received=10_000), 0.01)
    # Half of it came, in a frame of its own, and all of that is traced.
    dealer.reported(0, 1, Counts(created=20_000, retired=25_000, received=5_000), 0.01)
    # Nothing of this was a measurement.
    assert dealer.deal(1, 20_000, 0.02) == [10_000, 10_000]
    dealer.closed(1)
    dealer.reported(0, 1, Counts(created=5, retired=10_005, received=10_000), 0.1)
    # The owner has its own rays, and those that it sent, among what it created.
    dealer.reported(0, 0, Counts(created=20_000, retired=10_000, sent=10_000), 0.2, is_owner=True)
    shares = dealer.deal(2, 30_000, 0.2)
    assert shares == [10_000, 20_000]


def test_what_is_closed_is_nobodys_part() -> None:
    dealer = Dealer(2)
    dealer.deal(0, 20_000, 0.0)
    dealer.reported(0, 0, Counts(created=20_000, retired=10_000, sent=10_000), 0.1, is_owner=True)
    dealer.closed(0)
    assert dealer.deal(1, 20_000, 60.0) == [10_000, 10_000]
