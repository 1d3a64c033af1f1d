"""Which answers may still come on one connection. Pure.

To each request one answer, also after its asker gave up: that comes late and is dropped. Whoever sends anything else is no
honest program, and could have us read for ever.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Generic, TypeVar

from scenefold.base.errors import PeerFault

GIVEN_UP_MAX = 4_096
"""Requests given up that may still be answered; a node that owes more has been silent for minutes, and costs a new connection if it
answers the oldest after all."""
_ID_MODULUS = 1 << 32

T = TypeVar("T")


class Asked(Generic[T]):
    """The requests of one connection, each with who waits for its answer."""

    def __init__(self) -> None:
        self._waiting: dict[int, T] = {}
        self._given_up: dict[int, None] = {}
        self._last_id = 0

    @property
    def waiting(self) -> Sequence[T]:
        return list(self._waiting.values())

    def ask(self, who: T) -> int:
        """The id of a new request. 0 is for packets without an answer; few ids are in use, so the next free one is near."""
        while True:
            self._last_id = (self._last_id + 1) % _ID_MODULUS
            if self._last_id and self._last_id not in self._waiting and self._last_id not in self._given_up:
                self._waiting[self._last_id] = who
                return self._last_id

    def give_up(self, number: int, *, was_sent: bool) -> None:
        """Nobody waits for this one any more, if it was not answered yet."""
        if self._waiting.pop(number, None) is None or not was_sent:
            return
        self._given_up[number] = None
        if len(self._given_up) > GIVEN_UP_MAX:
            del self._given_up[next(iter(self._given_up))]

    def answered(self, number: int | None) -> T | None:
        """Who waits for this answer; None if he gave up. PeerFault if nobody asked, or has his answer. `number` None: it has none."""
        if number in self._waiting:
            return self._waiting.pop(number)
        if number in self._given_up:
            del self._given_up[number]
            return None
        raise PeerFault("the peer sent an answer that nobody asked for")
