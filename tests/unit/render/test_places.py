"""If this fails, one member keeps all others from rendering, or what failed long ago does."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as some

from scenefold.base.errors import Refused
from scenefold.base.reasons import RejectReason
from scenefold.render.pool.places import Places

MOST, OF_ONE = 8, 3
PEERS = ["user:ada", "user:ben", "user:eve", "node:2130706434"]


class Job:
    has_failed = is_idle = is_forgotten = False

    def forget(self) -> None:
        self.is_forgotten = True


def places() -> Places[Job]:
    return Places("organises", MOST, OF_ONE)


def test_one_asker_leaves_places_for_others() -> None:
    kept = places()
    for number in range(OF_ONE):
        kept.take(number, "user:eve", Job)
    with pytest.raises(Refused, match="as many jobs of user:eve as it may") as caught:
        kept.take(99, "user:eve", Job)
    assert caught.value.reason is RejectReason.BUSY
    kept.take(100, "user:ada", Job)


def test_what_failed_takes_no_place_and_its_words_are_kept() -> None:
    kept = places()
    first = kept.take(0, "user:eve", Job)
    first.has_failed = True
    for number in range(1, OF_ONE + 1):
        kept.take(number, "user:eve", Job)
    assert kept.get(0) is first


def test_whose_words_are_kept_no_longer_is_ended() -> None:
    kept = places()
    jobs = [kept.take(number, "user:eve", Job) for number in range(OF_ONE)]
    for number in range(OF_ONE, 10 * OF_ONE):
        jobs[-1].has_failed = True
        jobs.append(kept.take(number, "user:eve", Job))
    remaining = [job for _, job in kept.jobs()]
    assert all(job.is_forgotten != (job in remaining) for job in jobs) and len(remaining) < 3 * OF_ONE


def test_what_is_done_and_nobody_fetches_makes_way_the_oldest_first_and_only_for_as_much_as_is_wanted() -> None:
    kept = places()
    mine = [kept.take(number, "user:eve", Job) for number in range(OF_ONE)]
    mine[0].is_idle = mine[1].is_idle = True
    kept.take(OF_ONE, "user:eve", Job)
    assert [job.is_forgotten for job in mine] == [True, False, False] and kept.get(1) is mine[1]
    for number in range(10, 10 + MOST - OF_ONE):
        kept.take(number, f"user:{number}", Job)
    assert not mine[1].is_forgotten
    kept.take(99, "user:ada", Job)
    assert mine[1].is_forgotten and len(kept) == MOST
    with pytest.raises(Refused):
        kept.take(100, "user:ada", Job)


def test_who_asks_is_one_of_several_that_share_all_places() -> None:
    kept = places()
    for number in range(MOST):
        kept.take(number, f"user:{number}", Job)
    with pytest.raises(Refused, match="organises as many jobs as it may"):
        kept.take(99, "user:eve", Job)


def test_a_node_that_asks_is_named_by_address_and_whoever_hears_it_can_end_nothing() -> None:
    kept = places()
    for number in range(OF_ONE):
        kept.take(number, f"node:{0x7F000002}", Job)
    with pytest.raises(Refused, match=r"as many jobs of 127\.0\.0\.2 as it may") as caught:
        kept.take(99, f"node:{0x7F000002}", Job)
    assert "end one" not in caught.value.remedy


def test_a_place_is_given_back_by_its_own_job_only() -> None:
    kept = places()
    first = kept.take(0, "user:ada", Job)
    kept.drop(0, first)
    second = kept.take(0, "user:ben", Job)
    kept.drop(0, first)
    assert kept.get(0) is second and kept.asker(0) == "user:ben"


@given(some.lists(some.tuples(some.sampled_from(PEERS), some.sampled_from(["take", "fail", "drop", "idle"])), max_size=200))
def test_it_stays_within_bounds_whatever_comes(acts: list[tuple[str, str]]) -> None:
    kept = places()
    for number, (peer, act) in enumerate(acts):
        jobs = kept.jobs()
        if act == "take":
            try:
                kept.take(number, peer, Job)
            except Refused:
                live = [known for known, job in jobs if not job.has_failed and not job.is_idle]
                assert len(live) == MOST or sum(kept.asker(known) == peer for known in live) == OF_ONE
        elif jobs:
            known, job = jobs[number % len(jobs)]
            if act == "fail" and not job.is_idle:
                job.has_failed = True
            elif act == "idle" and not job.has_failed:
                job.is_idle = True
            elif act == "drop":
                kept.drop(known, job)
        assert all(not job.is_forgotten for _, job in kept.jobs())
        assert sum(not job.has_failed for _, job in kept.jobs()) <= MOST
        assert len(kept) <= MOST + len(PEERS) * (MOST + OF_ONE)
