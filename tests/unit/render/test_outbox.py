"""If this fails, rays wait for ever, leave twice or not at all, or every few of them leave in a frame of their own."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenefold.base.limits import RAY_FRAME_ITEMS_MAX
from scenefold.base.rays import RAY_BYTES, RAY_WORDS
from scenefold.render.arrays import U32
from scenefold.render.ledger import Counts
from scenefold.render.pool.outbox import (
    COUNTS_BYTES,
    EMPTY_BYTES,
    FRAME_RAYS_ENOUGH,
    FRAME_RAYS_MAX,
    HURRIED_S,
    LINGER_S,
    Frame,
    PeerOutbox,
)
from scenefold.render.pool.work import TAKE_RAYS_MAX, WorkQueue


def rays(count: int, word: int = 0) -> U32:
    return np.full((count, RAY_WORDS), word, np.uint32)


def ripe(box: PeerOutbox) -> float:
    at = box.ripe_at()
    assert at is not None
    return at


def frames(box: PeerOutbox, now: float) -> list[Frame]:
    """All that leaves at this moment."""
    left = []
    while (at := box.ripe_at()) is not None and at <= now:
        frame = box.next(now)
        assert frame is not None
        left.append(frame)
    return left


def test_an_empty_box_sends_nothing() -> None:
    box = PeerOutbox()
    box.hurry()
    assert box.ripe_at() is None and box.next(0.0) is None


def test_all_that_waits_leaves_together_once_it_has_lingered() -> None:
    box = PeerOutbox()
    box.put_rays(1, 7, rays(3, 7), 10.0)
    box.put_counts(5, Counts(1, 0, 0, 0), 10.01)
    box.put_closed(2, 10.02)
    box.put_rays(1, 4, rays(2, 4), 10.03)
    box.put_rays(0, 9, rays(1, 9), 10.03)
    box.put_counts(5, Counts(1, 1, 0, 0), 10.04)
    box.put_rays(1, 7, rays(1, 8), 10.04)
    assert ripe(box) == 10.0 + LINGER_S
    (frame,) = frames(box, 10.0 + LINGER_S)
    # Of old epochs and passes first; of counts the newest.
    assert [(batch.epoch, batch.number, batch.rays[:, 0].tolist()) for batch in frame.batches] == [
        (0, 9, [9]),
        (1, 4, [4, 4]),
        (1, 7, [7, 7, 7, 8]),
    ]
    assert frame.counts == [(5, Counts(1, 1, 0, 0))] and frame.closed == [2]
    assert frame.size == EMPTY_BYTES + COUNTS_BYTES + 7 * RAY_BYTES
    assert box.ripe_at() is None


def test_many_rays_leave_at_once() -> None:
    box = PeerOutbox()
    box.put_rays(1, 1, rays(FRAME_RAYS_ENOUGH - 1), 5.0)
    assert ripe(box) == 5.0 + LINGER_S
    box.put_rays(1, 2, rays(1), 5.001)
    assert ripe(box) <= 5.001


def test_who_has_nothing_else_to_do_sends_at_once_but_not_again_and_again() -> None:
    box = PeerOutbox()
    box.put_rays(1, 1, rays(1), 5.0)
    box.hurry()
    assert ripe(box) == 5.0 and len(frames(box, 5.0)) == 1
    # That it hurried once counts no more.
    box.put_rays(1, 1, rays(1), 5.001)
    assert ripe(box) == 5.001 + LINGER_S
    box.hurry()
    assert ripe(box) == 5.0 + HURRIED_S
    assert not frames(box, 5.0 + HURRIED_S - 1e-6) and len(frames(box, 5.0 + HURRIED_S)) == 1


def test_counts_that_are_the_last_leave_at_once() -> None:
    box = PeerOutbox()
    box.put_rays(1, 1, rays(1), 4.99)
    box.put_counts(1, Counts(1), 5.0, are_last=True)
    (frame,) = frames(box, 5.0)
    assert len(frame.batches) == 1 and frame.counts == [(1, Counts(1))]


def test_rays_that_nothing_follows_leave_at_once() -> None:
    box = PeerOutbox()
    box.put_counts(1, Counts(1), 4.99)
    box.put_rays(1, 1, rays(1), 5.0, are_all=True)
    (frame,) = frames(box, 5.0)
    assert len(frame.batches) == len(frame.counts) == 1


def test_counts_alone_are_not_hurried() -> None:
    box = PeerOutbox()
    box.put_counts(1, Counts(1), 5.0)
    box.put_closed(2, 5.0)
    box.hurry()
    assert ripe(box) == 5.0 + LINGER_S


@given(st.lists(st.tuples(st.integers(0, 2), st.integers(0, 5), st.integers(1, FRAME_RAYS_MAX)), min_size=1, max_size=12))
def test_no_frame_is_too_large_and_every_ray_leaves_once(puts: list[tuple[int, int, int]]) -> None:
    box = PeerOutbox()
    put: dict[tuple[int, int], int] = {}
    for epoch, number, count in puts:
        box.put_rays(epoch, number, rays(count), 0.0)
        put[epoch, number] = put.get((epoch, number), 0) + count
    left = frames(box, LINGER_S)
    came: dict[tuple[int, int], int] = {}
    for frame in left:
        assert 0 < sum(len(batch.rays) for batch in frame.batches) <= FRAME_RAYS_MAX
        for batch in frame.batches:
            came[batch.epoch, batch.number] = came.get((batch.epoch, batch.number), 0) + len(batch.rays)
    assert came == put
    assert len(left) == -(-sum(put.values()) // FRAME_RAYS_MAX)
    assert box.ripe_at() is None
    # And it knows that nothing waits.
    box.put_rays(0, 0, rays(FRAME_RAYS_ENOUGH - 1), 9.0)
    assert ripe(box) == 9.0 + LINGER_S


def test_a_frame_has_room_for_so_many_passes() -> None:
    box = PeerOutbox()
    for number in range(RAY_FRAME_ITEMS_MAX + 1):
        box.put_rays(0, number, rays(1), 0.0)
        box.put_counts(number, Counts(1), 0.0)
        box.put_closed(number, 0.0)
    first, second = frames(box, LINGER_S)
    assert (len(first.batches), len(first.counts), len(first.closed)) == (RAY_FRAME_ITEMS_MAX,) * 3
    assert (len(second.batches), len(second.counts), second.closed) == (1, 1, [RAY_FRAME_ITEMS_MAX])


@given(st.dictionaries(st.integers(0, 9), st.lists(st.integers(1, TAKE_RAYS_MAX), min_size=1, max_size=3), max_size=6))
def test_a_tracer_gets_the_largest_heaps_as_many_as_it_may(heaps: dict[int, list[int]]) -> None:
    queue = WorkQueue()
    for number, counts in heaps.items():
        for count in counts:
            queue.put(number, rays(count))
    taken: dict[int, int] = {}
    while some := queue.take_some():
        sizes = [len(work.rays) for work in some]
        assert sum(sizes) <= TAKE_RAYS_MAX
        for work in some:
            assert queue.is_busy(work.number)
            taken[work.number] = taken.get(work.number, 0) + len(work.rays)
    assert taken == {number: sum(counts) for number, counts in heaps.items()}
    assert not len(queue)


def test_threads_that_have_nothing_to_do_share_what_there_is() -> None:
    queue = WorkQueue()
    for number in range(8):
        queue.put(number, rays(8_000))
    assert [len(queue.take_share(4 - taken)) for taken in range(4)] == [2, 2, 2, 2]
    # Also of one heap in one piece.
    queue.put(3, rays(60_000, 3))
    parts = [queue.take_share(4 - taken) for taken in range(4)]
    assert [sum(len(work.rays) for work in part) for part in parts] == [15_000] * 4
    for number in range(8):
        queue.put(number, rays(100))
    # So little is not worth more than one hand-over.
    assert len(queue.take_share(4)) == 8


def test_small_heaps_of_several_passes_go_together() -> None:
    queue = WorkQueue()
    for number, count in ((1, 10), (2, 30), (3, 20)):
        queue.put(number, rays(count))
    assert [(work.number, len(work.rays)) for work in queue.take_some()] == [(2, 30), (3, 20), (1, 10)]
    assert queue.take_some() == []
    with pytest.raises(KeyError):
        queue.done(4)
