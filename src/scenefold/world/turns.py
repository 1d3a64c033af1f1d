"""Whose request is taken up next at a node (specs/03-wire.md, Limits). Pure: no waiting.

All requests are handled by one thread, in tasks that run in turns: of a hundred of one peer and one of another, the one has a
hundredth of the time. So a peer beside others begins only a few at a time, the next once one of them has ended; one that takes
long, as it waits for a disk or another node, takes nobody's time, and soon counts no more. And it gets at most a share of the
thread's time (shares.py). A peer that is alone may begin all, and take all. What members ask of each other all have caused, so a member
may take all unless a client asks as well, as long as nothing of it is forged; beside clients it has a share like anybody.

Requests are counted for each port, so that what is small and urgent does not wait behind a peer's own bulk.
"""

from __future__ import annotations

import math
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import islice, takewhile

from scenefold.world.ports import Priority
from scenefold.world.shares import Kind, Shares

TURNS_MAX = 4
"""Requests of a peer beside others that may have begun lately: a full one of reading costs two milliseconds. One that lives at the
limit of its share has one, as what several cost would be known only when all of them are handled."""
TURN_S = 0.025
"""After which a request counts as waiting for something else."""
TICK_S = 1e-6
"""A shorter wait is none: the clock might not move at all."""
BESIDE_S = 0.25
"""Others are beside a peer for so long after their last request."""
ACCUSED_S = 60.0
"""For so long a member may not take all beside other members after it sent what was forged."""

Guest = tuple[str, int]
"""A peer, and at which port."""


@dataclass
class _Begun:
    """Requests of one guest that are under way, or were lately."""

    at: dict[int, float] = field(default_factory=dict)
    """When each began, the earliest first."""
    last_at: float = 0.0


class Turns:
    """Of all peers at one node."""

    def __init__(self, is_member: Callable[[str], bool] = lambda _peer: False) -> None:
        self._is_member = is_member
        self._accused: dict[str, float] = {}
        """Who sent what is forged, and when it did so last, the latest last. None but members."""
        self._guests: OrderedDict[Guest, _Begun] = OrderedDict()
        """Whoever began a request last is the last one."""
        self._number = 0
        self._client_at = -math.inf
        """When a client began a request last."""
        self._shares = Shares(self.kind_of)

    def kind_of(self, peer: str, now: float) -> Kind:
        """Who is beside this peer, and what it shares with whom, depends on that."""
        if not self._is_member(peer):
            return Kind.CLIENT
        return Kind.ACCUSED if self._accused.get(peer, -math.inf) > now - ACCUSED_S else Kind.MEMBER

    def accuse(self, peer: str, now: float) -> None:
        """It sent what no honest program sends: a member is for a while beside members as well."""
        if not self._is_member(peer):
            return
        self._accused.pop(peer, None)
        self._accused[peer] = now
        for other in list(takewhile(lambda other: self._accused[other] <= now - ACCUSED_S, self._accused)):
            del self._accused[other]

    def wait_s(self, guest: Guest, now: float) -> float:
        """How long the next request of one has to wait, unless one of its others ends before; 0: it may begin."""
        if not self._is_beside_others(guest[0], now):
            return 0.0
        begun, wait_s = self._guests.get(guest), 0.0
        may_take_all = self._may_take_all(guest[0], now)
        turns_max = 1 if self._shares.is_used_up(guest[0]) and not may_take_all else TURNS_MAX
        if begun is not None and len(begun.at) >= turns_max:
            # If this one counts no more, so many are left at most.
            at = next(islice(reversed(begun.at.values()), turns_max - 1, None))
            wait_s = at + TURN_S - now
        if not may_take_all:
            wait_s = max(wait_s, self._shares.wait_s(guest[0], _is_urgent(guest), now))
        return wait_s if wait_s >= TICK_S else 0.0

    def begin(self, guest: Guest, now: float) -> int:
        """A request is taken up; the number is for `end`."""
        self._number += 1
        begun = self._guests.setdefault(guest, _Begun())
        begun.at[self._number] = begun.last_at = now
        self._guests.move_to_end(guest)
        if self.kind_of(guest[0], now) is Kind.CLIENT:
            self._client_at = now
        self._forget(now)
        return self._number

    def pay(self, guest: Guest, work_s: float, now: float) -> None:
        """What a guest asks has cost so much of the time, in part or all."""
        self._shares.pay(guest[0], work_s, _is_urgent(guest), self._may_take_all(guest[0], now), now)

    def end(self, guest: Guest, number: int) -> None:
        """It is answered, or never will be."""
        del self._guests[guest].at[number]

    def _may_take_all(self, peer: str, now: float) -> bool:
        """A member: unless a client asks; others: if they are alone."""
        if self.kind_of(peer, now) is Kind.MEMBER:
            return self._client_at < now - BESIDE_S
        return not self._is_beside_others(peer, now)

    def _is_beside_others(self, peer: str, now: float) -> bool:
        latest = next((begun.last_at for other, begun in reversed(self._guests.items()) if other[0] != peer), None)
        return latest is not None and latest >= now - BESIDE_S

    def _forget(self, now: float) -> None:
        """A request that never ends keeps only those from being forgotten that came after it: at most all that are connected."""
        while True:
            first, begun = next(iter(self._guests.items()))
            if begun.at or begun.last_at >= now - BESIDE_S:
                return
            del self._guests[first]


def _is_urgent(guest: Guest) -> bool:
    return guest[1] == Priority.HIGH
