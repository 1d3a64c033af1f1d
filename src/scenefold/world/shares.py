"""What part of a node's time each peer may take (specs/03-wire.md, Limits). Pure: no waiting.

One thread handles what all peers ask, so their time is shared by what it costs, and not by how many ask how often. A peer beside
others has an account: what it costs is taken from it, and it fills again at the peer's share. Clients have a part of the time among
them, members of the cluster another one, so that neither kind can push the other out of it: no number of busy clients keeps a handover
from ending, and no member, whatever it asks, takes more than that from them. Of those of a kind that are busy all get the same, and more
the less the others take; what nobody takes is left to who comes next. One that was quiet has saved little, so nobody hoards time.

The small and urgent port of a peer is filled first: nothing there waits for the peer's own bulk.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum
from itertools import takewhile

BUSY_SHARE = 0.5
"""Of the thread's time, for all clients that are busy beside others: with two of them a quarter each."""
MEMBERS_SHARE = 0.25
"""Likewise, for all members."""
BUSY = 0.05
"""Who takes so much counts as busy, who takes less as that part of one: many names that take little are no more than one that takes it all."""
OTHERS_WEIGHT = 25.0
"""If others take very little, a peer's share is the whole but for so many times what they take: they may want more than they get."""
LATELY_S = 1.0
"""What was taken counts so long, ever less."""
SAVED_S_MAX = 0.2
"""What a peer that was quiet may take at once."""
USED_UP_S = 0.05
"""Who has saved less lives at the limit of its share."""
URGENT_SAVED_S_MAX = 0.05
"""Likewise, at its urgent port."""
OWED_S_MAX = 10.0
"""What one owes at most: a few requests that had begun before the first of them was paid for."""
OWED_ALONE_S_MAX = 0.05
"""What one that was alone, and took all, owes at most when others come."""
LOOK_S = 0.02
"""How old the count of the busy ones may be."""


class Kind(Enum):
    """Of a peer."""

    CLIENT = 0
    """And whoever is no member."""
    MEMBER = 1
    """Only clients are others to it."""
    ACCUSED = 2
    """A member to which all are others."""

    @property
    def is_client(self) -> bool:
        return self is Kind.CLIENT


@dataclass
class _Taken:
    """What part of the time was taken lately."""

    part: float = 0.0
    at: float = 0.0

    def now(self, now: float) -> float:
        return self.part * math.exp((self.at - now) / LATELY_S)

    def add(self, work_s: float, now: float) -> None:
        self.part, self.at = self.now(now) + work_s / LATELY_S, now


@dataclass
class _Account:
    """Of one peer: what it may still take, as of `at`, at its bulk port and at its urgent one."""

    at: float
    is_client: bool = True
    bulk_s: float = SAVED_S_MAX
    urgent_s: float = URGENT_SAVED_S_MAX
    taken: _Taken = field(default_factory=_Taken)

    def fill(self, share: float, now: float) -> None:
        gained_s, self.at = (now - self.at) * share, now
        urgent_s = min(URGENT_SAVED_S_MAX, self.urgent_s + gained_s)
        self.bulk_s = min(SAVED_S_MAX, self.bulk_s + gained_s - (urgent_s - self.urgent_s))
        self.urgent_s = urgent_s

    def missing_s(self, is_urgent: bool) -> float:
        """What has to come in before it may take more."""
        if is_urgent:
            return max(0.0, -self.urgent_s)
        return URGENT_SAVED_S_MAX - self.urgent_s - self.bulk_s if self.bulk_s < 0 else 0.0


class Shares:
    """Of all peers at one node. `kind_of`: what kind of peer one is, at a time."""

    def __init__(self, kind_of: Callable[[str, float], Kind] = lambda _peer, _now: Kind.CLIENT) -> None:
        self._kind_of = kind_of
        self._accounts: dict[str, _Account] = {}
        """Who paid last is the last one."""
        self._taken = {True: _Taken(), False: _Taken()}
        """By all clients, and by all members."""
        self._busy = {True: 0.0, False: 0.0}
        self._looked_at = -math.inf

    def __len__(self) -> int:
        return len(self._accounts)

    def wait_s(self, peer: str, is_urgent: bool, now: float) -> float:
        """Until a peer beside others has paid what it owes."""
        account = self._accounts.get(peer)
        missing_s = account.missing_s(is_urgent) if account is not None else 0.0
        if account is None or not missing_s:
            return 0.0
        return max(0.0, account.at + missing_s / self.share(peer, now) - now)

    def is_used_up(self, peer: str) -> bool:
        """Whether a peer has saved next to nothing."""
        account = self._accounts.get(peer)
        return account is not None and account.bulk_s < USED_UP_S

    def pay(self, peer: str, work_s: float, is_urgent: bool, is_alone: bool, now: float) -> None:
        """It has cost so much."""
        account = self._accounts.pop(peer, None) or _Account(now)
        self._accounts[peer] = account
        account.is_client = self._kind_of(peer, now).is_client
        account.fill(1.0 if is_alone else self.share(peer, now), now)
        owed_s = OWED_ALONE_S_MAX if is_alone else OWED_S_MAX
        if is_urgent:
            account.urgent_s = max(-owed_s, account.urgent_s - work_s)
        else:
            account.bulk_s = max(-owed_s, account.bulk_s - work_s)
        account.taken.add(work_s, now)
        self._taken[account.is_client].add(work_s, now)
        self._forget(now)

    def share(self, peer: str, now: float) -> float:
        """Of the time, for one that is beside others."""
        kind, account = self._kind_of(peer, now), self._accounts.get(peer)
        own = account.taken.now(now) if account is not None else 0.0
        alike = max(0.0, self._taken[kind.is_client].now(now) - own)
        others = self._taken[not kind.is_client].now(now) + (0.0 if kind is Kind.MEMBER else alike)
        busy = max(0.0, self._busy_ones(kind.is_client, now) - _busy(own))
        part = BUSY_SHARE if kind.is_client else MEMBERS_SHARE
        return max(1.0 - OTHERS_WEIGHT * others, part / (1.0 + busy))

    def _busy_ones(self, are_clients: bool, now: float) -> float:
        if now - self._looked_at >= LOOK_S:
            self._looked_at = now
            self._busy = {True: 0.0, False: 0.0}
            for account in self._accounts.values():
                self._busy[account.is_client] += _busy(account.taken.now(now))
        return self._busy[are_clients]

    def _forget(self, now: float) -> None:
        """Who was quiet until its account was full is as if it had never been."""
        for peer in list(takewhile(lambda peer: self._is_full(peer, now), self._accounts)):
            del self._accounts[peer]

    def _is_full(self, peer: str, now: float) -> bool:
        account = self._accounts[peer]
        quiet_s = now - account.at
        if quiet_s <= LATELY_S:
            return False
        missing_s = URGENT_SAVED_S_MAX + SAVED_S_MAX - account.urgent_s - account.bulk_s
        return quiet_s > missing_s / self.share(peer, now)


def _busy(taken: float) -> float:
    return min(1.0, taken / BUSY)
