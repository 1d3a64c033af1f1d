"""Whose request is taken up next at a node (specs/03-wire.md, Limits). Pure: no waiting.

All requests are handled by one thread, in tasks that run in turns: of a hundred of one peer and one of another, the one has a
hundredth of the time. So a peer beside others begins only a few at a time, the next once one of them has ended; one that takes
long, as it waits for a disk or another node, takes nobody's time, and soon counts no more. And it gets at most a share of the
thread's time, by what requests and answers of that size take; but for members, whose traffic all have caused. The share is larger
the less the others take: who asks once a second takes nothing away from one that has much to do. A peer that is alone may begin all,
and take all.

Each peer has an account for each port, so that what is small and urgent does not wait behind its own bulk.
"""

from __future__ import annotations

import math
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import islice

TURNS_MAX = 4
"""Requests of a peer beside others that may have begun lately: a full one of reading costs two milliseconds."""
TURN_S = 0.025
"""After which a request counts as waiting for something else."""
BESIDE_S = 0.25
"""Others are beside a peer for so long after their last request."""
WORK_SHARE = 0.2
"""Of the thread's time, for a peer beside others that take a thirtieth of it or more. By the costs below it may read 20 MiB a second, or have 250 small answers."""
OTHERS_WEIGHT = 25.0
"""If others take less, its share is the whole but for so many times what they take: they may want more than they get."""
LATELY_S = 1.0
"""What was taken counts so long, ever less."""
WORK_S_MAX = 0.2
"""What a peer that was quiet may take at once."""
WORK_S_OWED_MAX = 0.05
"""What one that was alone, and took all, owes at most when others come."""
FORGET_S = max(BESIDE_S, (WORK_S_MAX + WORK_S_OWED_MAX) / WORK_SHARE)
"""Who was quiet for so long is as if it had never been."""
REQUEST_S = 0.0008
ANSWER_BYTE_S = 10e-6 / 1024
"""What a request costs, whatever it asks, and each byte of its answer."""

Guest = tuple[str, int]
"""A peer, and at which port."""


@dataclass
class Taken:
    """What part of the time was taken lately."""

    part: float = 0.0
    at: float = 0.0

    def now(self, now: float) -> float:
        return self.part * math.exp((self.at - now) / LATELY_S)

    def add(self, work_s: float, now: float) -> None:
        self.part, self.at = self.now(now) + work_s / LATELY_S, now


@dataclass
class _Account:
    """Of one that has requests under way, or had some lately."""

    work_at: float
    work_s: float = WORK_S_MAX
    """What it may still take, as of `work_at`."""
    begun: dict[int, float] = field(default_factory=dict)
    """When its requests under way began, the earliest first."""
    last_at: float = 0.0
    taken: Taken = field(default_factory=Taken)


class Turns:
    """Of all peers at one node. `is_free`: whether a peer's share of the time has no bound."""

    def __init__(self, is_free: Callable[[str], bool] = lambda _peer: False) -> None:
        self._is_free = is_free
        self._guests: OrderedDict[Guest, _Account] = OrderedDict()
        """Whoever began a request last is the last one."""
        self._number = 0
        self._taken = Taken()
        """By all."""

    def wait_s(self, guest: Guest, now: float) -> float:
        """How long the next request of one has to wait, unless one of its others ends before; 0: it may begin."""
        account = self._guests.get(guest)
        if account is None or not self._is_beside_others(guest, now):
            return 0.0
        wait_s = 0.0
        if len(account.begun) >= TURNS_MAX:
            # If this one counts no more, so many are left at most.
            at = next(islice(reversed(account.begun.values()), TURNS_MAX - 1, None))
            wait_s = at + TURN_S - now
        work_wait_s = account.work_at - account.work_s / self._share(guest, now) - now
        if work_wait_s > 0 and not self._is_free(guest[0]):
            wait_s = max(wait_s, work_wait_s)
        return max(0.0, wait_s)

    def begin(self, guest: Guest, now: float) -> int:
        """A request is taken up; the number is for `end`."""
        self._number += 1
        account = self._guests.setdefault(guest, _Account(now))
        account.begun[self._number] = account.last_at = now
        self._guests.move_to_end(guest)
        self._forget(now)
        return self._number

    def end(self, guest: Guest, number: int, answer_bytes: int, now: float) -> None:
        """It is answered, or never will be."""
        account = self._guests[guest]
        del account.begun[number]
        work_s = REQUEST_S + answer_bytes * ANSWER_BYTE_S
        gained = min(WORK_S_MAX, account.work_s + (now - account.work_at) * self._share(guest, now))
        account.work_s = max(-WORK_S_OWED_MAX, gained - work_s)
        account.work_at = now
        account.taken.add(work_s, now)
        self._taken.add(work_s, now)

    def _share(self, guest: Guest, now: float) -> float:
        """Of the time, for one that is beside others."""
        own = sum(self._guests[one].taken.now(now) for one in ((guest[0], 0), (guest[0], 1)) if one in self._guests)
        others = max(0.0, self._taken.now(now) - own)
        return max(WORK_SHARE, 1.0 - OTHERS_WEIGHT * others)

    def _is_beside_others(self, guest: Guest, now: float) -> bool:
        latest = next((account.last_at for other, account in reversed(self._guests.items()) if other[0] != guest[0]), None)
        return latest is not None and latest >= now - BESIDE_S

    def _forget(self, now: float) -> None:
        """A request that never ends keeps only those from being forgotten that came after it: at most all that are connected."""
        while True:
            first, account = next(iter(self._guests.items()))
            if account.begun or account.last_at >= now - FORGET_S:
                return
            del self._guests[first]
