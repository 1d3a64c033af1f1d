"""A client that nobody has answered yet (specs/11-peers.md, First contact).

Whoever starts without a network, or behind one that drops what is sent, shall hear so soon, however many nodes are known: so until anybody has
answered at all, each call has one bound for all its tries, and those that may be asked are asked shortly one after the other while the former ones
still try. From the first answer on, nodes are known to be there, and each request has its own time.
"""

from __future__ import annotations

import math
from collections.abc import Awaitable, Callable
from typing import TypeVar

import trio

from scenefold.base.errors import Unreachable
from scenefold.base.limits import (
    CLIENT_ASKED_MAX,
    CLIENT_CONTACT_ASKED_MAX,
    CLIENT_CONTACT_NEXT_S,
    CLIENT_CONTACT_S,
    CLIENT_NEXT_S,
)
from scenefold.client.hedging import more_telling

Result = TypeVar("Result")
SILENT = "no answer in time"


class NoContact(Unreachable):
    """The bound is over. What was sent before may have been taken all the same."""


class FirstContact:
    """Of one client. Used from the Trio thread only."""

    def __init__(self) -> None:
        self.is_made = False
        self._ends: dict[str, Unreachable | None] = {}
        """How it ended at whom was asked, by address; None: no try has ended."""
        self._problem: Unreachable | None = None
        self._scopes: set[trio.CancelScope] = set()

    @property
    def next_after_s(self) -> float:
        """Seconds of silence of one node after which another one is asked as well."""
        return CLIENT_NEXT_S if self.is_made else CLIENT_CONTACT_NEXT_S

    @property
    def at_a_time(self) -> int:
        """Nodes that are asked one question at a time."""
        return CLIENT_ASKED_MAX if self.is_made else CLIENT_CONTACT_ASKED_MAX

    def made(self) -> None:
        """Somebody has answered, whatever it said: who waits is bounded by its requests alone."""
        self.is_made = True
        for scope in self._scopes:
            scope.deadline = math.inf

    def asked(self, address: str) -> None:
        """One more is being asked."""
        self._ends.setdefault(address, None)

    def failed(self, address: str, problem: Unreachable) -> None:
        """One more could not be reached."""
        before = self._ends.get(address)
        self._ends[address] = problem if before is None else more_telling(before, problem)
        self._problem = problem if self._problem is None else more_telling(self._problem, problem)

    @property
    def reasons(self) -> dict[str, str]:
        """What is known of each that was asked, by address, while nobody has answered."""
        return {} if self.is_made else {address: SILENT if end is None else end.what for address, end in self._ends.items()}

    async def bounded(self, call: Callable[[], Awaitable[Result]]) -> Result:
        """What the call gives or raises; NoContact if nobody answers anything in time."""
        if self.is_made:
            return await call()
        with trio.CancelScope(deadline=trio.current_time() + CLIENT_CONTACT_S) as scope:
            self._scopes.add(scope)
            try:
                return await call()
            finally:
                self._scopes.discard(scope)
        raise NoContact(SILENT if self._problem is None else self._problem.what)
