"""Whose request is taken up next at a port (specs/03-wire.md, Limits). Pure: no waiting.

All requests are handled by one thread, in tasks that run in turns: of a hundred of one peer and one of another, the one has a
hundredth of the time. So a peer beside others begins only a few at a time, the next once one of them has ended; one that takes
long, as it waits for a disk or another node, takes nobody's time, and soon counts no more. And it gets at most a share of the
thread's time, by what requests and answers of that size take. A peer that is alone may begin all, and take all.
"""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass, field
from itertools import islice

TURNS_MAX = 4
"""Requests of a peer beside others that may have begun lately: a full one of reading costs two milliseconds."""
TURN_S = 0.025
"""After which a request counts as waiting for something else."""
BESIDE_S = 1.0
"""Others are beside a peer for so long after their last request."""
WORK_SHARE = 0.25
"""Of the thread's time, for a peer beside others. By the costs below it may read 30 MiB a second, or have 600 small answers."""
WORK_S_MAX = 0.25
"""What a peer that was quiet may take at once."""
WORK_S_OWED_MAX = 0.05
"""What one that was alone, and took all, owes at most when others come."""
FORGET_S = max(BESIDE_S, (WORK_S_MAX + WORK_S_OWED_MAX) / WORK_SHARE)
"""Who was quiet for so long is as if it had never been."""
REQUEST_S = 0.0004
ANSWER_BYTE_S = 8e-6 / 1024
"""What a request costs, whatever it asks, and each byte of its answer."""


@dataclass
class _Guest:
    """A peer that has requests under way, or had some lately."""

    work_at: float
    work_s: float = WORK_S_MAX
    """What it may still take, as of `work_at`."""
    begun: dict[int, float] = field(default_factory=dict)
    """When its requests under way began, the earliest first."""
    last_at: float = 0.0


class Turns:
    """Of all peers at one port."""

    def __init__(self) -> None:
        self._guests: OrderedDict[str, _Guest] = OrderedDict()
        """Whoever began a request last is the last one."""
        self._number = 0

    def wait_s(self, peer: str, now: float) -> float:
        """How long this peer's next request has to wait, unless one of its others ends before; 0: it may begin."""
        guest = self._guests.get(peer)
        if guest is None or not self._is_beside_others(peer, now):
            return 0.0
        wait_s = 0.0
        if len(guest.begun) >= TURNS_MAX:
            # If this one counts no more, so many are left at most.
            at = next(islice(reversed(guest.begun.values()), TURNS_MAX - 1, None))
            wait_s = at + TURN_S - now
        return max(0.0, wait_s, guest.work_at - guest.work_s / WORK_SHARE - now)

    def begin(self, peer: str, now: float) -> int:
        """A request is taken up; the number is for `end`."""
        self._number += 1
        guest = self._guests.setdefault(peer, _Guest(now))
        guest.begun[self._number] = guest.last_at = now
        self._guests.move_to_end(peer)
        self._forget(now)
        return self._number

    def end(self, peer: str, number: int, answer_bytes: int, now: float) -> None:
        """It is answered, or never will be."""
        guest = self._guests[peer]
        del guest.begun[number]
        gained = min(WORK_S_MAX, guest.work_s + (now - guest.work_at) * WORK_SHARE)
        guest.work_s = max(-WORK_S_OWED_MAX, gained - REQUEST_S - answer_bytes * ANSWER_BYTE_S)
        guest.work_at = now

    def _is_beside_others(self, peer: str, now: float) -> bool:
        latest = next((guest.last_at for other, guest in reversed(self._guests.items()) if other != peer), None)
        return latest is not None and latest >= now - BESIDE_S

    def _forget(self, now: float) -> None:
        """A request that never ends keeps only those from being forgotten that came after it: at most all that are connected."""
        while True:
            first, guest = next(iter(self._guests.items()))
            if guest.begun or guest.last_at >= now - FORGET_S:
                return
            del self._guests[first]
