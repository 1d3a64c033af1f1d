"""Places for jobs on a node: so many at a time, of these so many of one asker; what failed takes none. Pure.

Of what failed the words are kept, for whoever asks, and of each asker the last few only. What is done and nobody fetches keeps its place
until another job wants it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

from scenefold.base.errors import Refused
from scenefold.base.ids import address_of
from scenefold.base.reasons import RejectReason
from scenefold.crypto import node_named


class Job(Protocol):
    """What has a place."""

    @property
    def has_failed(self) -> bool: ...

    @property
    def is_idle(self) -> bool:
        """Done, and nobody has asked for it for a while: maybe whoever wanted it is no more."""

    def forget(self) -> None:
        """It has no place, and nobody will ask for it: end what is left of it. Called once it has failed, or is idle."""


J = TypeVar("J", bound=Job)


@dataclass(frozen=True, slots=True)
class _Place(Generic[J]):
    peer: str
    job: J


class Places(Generic[J]):
    """By the jobs' ids."""

    def __init__(self, what: str, most: int, most_of_one: int) -> None:
        """`what` a node does with jobs, for whoever is turned away."""
        self._what, self._most, self._most_of_one = what, most, most_of_one
        self._places: dict[int, _Place[J]] = {}

    def __len__(self) -> int:
        return len(self._places)

    def get(self, job: int) -> J | None:
        """What has this id; None for nothing."""
        place = self._places.get(job)
        return None if place is None else place.job

    def asker(self, job: int) -> str:
        """Who took the place; empty if nobody did."""
        place = self._places.get(job)
        return "" if place is None else place.peer

    def jobs(self) -> list[tuple[int, J]]:
        """All, the oldest first."""
        return [(number, place.job) for number, place in self._places.items()]

    def check(self, peer: str) -> None:
        """Refused (13) if there is no place for one more of this peer."""
        live = [place.peer for place in self._places.values() if not place.job.has_failed and not place.job.is_idle]
        if len(live) >= self._most:
            raise Refused(RejectReason.BUSY, f"this node {self._what} as many jobs as it may", remedy="try again later")
        if live.count(peer) >= self._most_of_one:
            node = node_named(peer)
            whose, remedy = (peer, "end one, or try again later") if node is None else (address_of(node), "try again later")
            raise Refused(RejectReason.BUSY, f"this node {self._what} as many jobs of {whose} as it may", remedy=remedy)

    def take(self, number: int, peer: str, make: Callable[[], J]) -> J:
        """A place for a new job, if there is one (`check`)."""
        self.check(peer)
        self._make_way(peer)
        job = make()
        self._places[number] = _Place(peer, job)
        failed = [known for known, place in self._places.items() if place.peer == peer and place.job.has_failed]
        for oldest in failed[: -self._most_of_one]:
            self._places.pop(oldest).job.forget()
        return job

    def _make_way(self, peer: str) -> None:
        """End what is idle, the oldest first, if its place is needed."""
        for asker, most in ((peer, self._most_of_one), ("", self._most)):
            held = {
                number: place.job
                for number, place in self._places.items()
                if not place.job.has_failed and (not asker or place.peer == asker)
            }
            idle = [number for number, job in held.items() if job.is_idle]
            for number in idle[: max(0, len(held) + 1 - most)]:
                self._places.pop(number).job.forget()

    def drop(self, number: int, job: J) -> None:
        """Give a place back, if it is still this job's."""
        place = self._places.get(number)
        if place is not None and place.job is job:
            del self._places[number]
