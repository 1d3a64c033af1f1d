"""The films of one node in one job: its own, the copy of another's, and what comes while films are gathered (specs/31-attempts.md).

Each is the sum of the passes of its set, which changes with it in one step. Nothing here waits; callers see to it that one thing at a time
happens to each film. Adding takes long, so that is done in workers.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from functools import cached_property

import numpy as np

from scenefold.base.errors import PeerFault, Refused
from scenefold.base.ids import NodeId, address_of
from scenefold.base.reasons import RejectReason
from scenefold.render.film import Film, GoesOn
from scenefold.render.job import Job
from scenefold.render.pass_sums import PassSums


class Summed:
    """A film, and the set of its passes."""

    def __init__(self, job: Job) -> None:
        self._job = job
        self.passes: set[int] = set()

    @cached_property
    def film(self) -> Film:
        """Made when it is first wanted: whether a node may hold it is found out before."""
        return Film(self._job.window.width, self._job.window.height, self._job.columns)

    def add(self, number: int, sums: PassSums, first_path: int, stride: int, goes_on: GoesOn) -> None:
        """A closed pass, with all of its sums; once, however often it is said."""
        if number not in self.passes:
            self.film.add(sums, first_path, stride, goes_on)
            self.passes.add(number)

    def merge(self, other: Summed) -> None:
        """Another film, of other passes. PeerFault if they are not."""
        if not self.passes.isdisjoint(other.passes):
            raise PeerFault("passes would count twice")
        self.film.merge(other.film)
        self.passes |= other.passes

    def clear(self) -> None:
        """It is part of another film now."""
        self.__dict__.pop("film", None)
        self.passes.clear()


class Films:
    """Of one node. Kept from one attempt to the next."""

    def __init__(self, job: Job) -> None:
        self._job = job
        self.own = Summed(job)
        self._copies: dict[NodeId, Summed] = {}
        self._coming: Film | None = None
        self._came: dict[NodeId, set[int]] = {}
        """Parts of each neighbour's film, of this gathering."""
        self._gathering = 0
        self._gathered = 0

    @property
    def gathered(self) -> int:
        """The newest gathering of which all films are the organiser's, as far as is known here; 0 if there was none."""
        return self._gathered

    def copy_of(self, node: NodeId) -> Summed:
        """The copy of a node's film that is kept here; empty as long as nothing of it is."""
        return self._copies.setdefault(node, Summed(self._job))

    def adopt(self, roster: Collection[NodeId]) -> None:
        """The copies of those that take no part any more are ours."""
        for node in [node for node in self._copies if node not in roster]:
            self.own.merge(self._copies.pop(node))

    # Gathering -----------------------------------------------------------------------------------------------

    def begin(self, gathering: int) -> None:
        """What others send from now on counts for this gathering. Refused if there is a later one."""
        self._check(gathering)
        if gathering > self._gathering:
            self._gathering, self._coming, self._came = gathering, None, {}

    def merge_part(self, gathering: int, sender: NodeId, index: int, payload: bytes) -> None:
        """A part of a film that is gathered. Refused if it is of an older gathering; PeerFault if it does not fit, or came before."""
        self._check(gathering)
        came = self._came.setdefault(sender, set())
        if index in came:
            raise PeerFault("a part of a film came twice", where=f"part {index} of the film of {address_of(sender)}")
        if self._coming is None:
            self._coming = Film(self._job.window.width, self._job.window.height, self._job.columns)
        self._coming.merge_part(index, payload)
        came.add(index)

    def check_came(self, gathering: int, sender: NodeId) -> None:
        """All of a neighbour's film must be here, as it says. PeerFault."""
        self._check(gathering)
        came = len(self._came.get(sender, ()))
        if came != self.part_count:
            raise PeerFault(f"{came} of {self.part_count} parts of a film came", where=f"the film of {address_of(sender)}")

    def check_samples(self, passes: Collection[int], paths_of: Callable[[int], int]) -> None:
        """At the organiser: what has come must have a sample of each path of these passes, but for our own. PeerFault. Adaptive ones have fewer."""
        samples = 0 if self._coming is None else int(self._coming.rows.samples.sum(dtype=np.int64))
        due = sum(map(paths_of, set(passes) - self.own.passes))
        if samples > due or (samples < due and self._job.adaptive is None):
            raise PeerFault(
                f"the films of others have {samples} samples, and their passes have {due}", where="the films that were gathered"
            )

    def part(self, index: int) -> bytes:
        """Of all that is gathered here, and of our own, which stays."""
        return self.own.film.part(index, self._coming)

    @property
    def part_count(self) -> int:
        """Of each film."""
        return self.own.film.part_count

    def take_gathered(self, passes: Collection[int]) -> None:
        """At the organiser: all has come, of these passes beside our own. It is in our film now, and counts no more beside it."""
        if self._coming is not None:
            self.own.film.merge(self._coming)
        self.own.passes |= set(passes)
        self._coming, self._gathered = None, self._gathering
        self._copies.clear()

    def forget_gathered(self, gathering: int) -> None:
        """At the others: all films are the organiser's, by the gathering of a number."""
        if gathering > self._gathered:
            self._gathered, self._coming = gathering, None
            self.own.clear()
            self._copies.clear()

    def _check(self, gathering: int) -> None:
        if gathering < self._gathering or gathering <= self._gathered:
            raise Refused(RejectReason.NOT_READY, "that film is of an older gathering")
