"""What has happened to a log and was not looked at yet. Bounded: what finds no room is lost, as a packet may be."""

from __future__ import annotations

from collections import deque

import trio

from scenefold.base.limits import DECIDERS_MAX, LOG_BODY_BYTES_MAX, LOG_RECORD_BYTES_MAX
from scenefold.consensus import Certificate, Event, Learn, Message, Propose, Received, Value
from scenefold.consensus.messages import Accepted

EVENTS_MAX = 1_024
BYTES_MAX = 32 * 1024 * 1024
WAIT_S_MIN = 0.001
_SIGNATURE_BYTES_MAX = 64


class Inbox:
    """Used from the Trio thread only. `lost`: how many events found no room."""

    def __init__(self) -> None:
        self._events: deque[Event] = deque()
        self._bytes = 0
        self._came = trio.Event()
        self.lost = 0

    def put(self, event: Event) -> None:
        size = size_of(event)
        if len(self._events) >= EVENTS_MAX or self._bytes + size > BYTES_MAX:
            self.lost += 1
            return
        self._events.append(event)
        self._bytes += size
        self.wake()

    def take(self) -> Event | None:
        if not self._events:
            return None
        event = self._events.popleft()
        self._bytes -= size_of(event)
        return event

    def wake(self) -> None:
        """Whoever waits is to look around, for an event or something else."""
        self._came.set()

    async def wait(self, seconds: float) -> None:
        """Until something is there, or `wake` is called, or so long."""
        if not self._events:
            # Clocks differ a little from Trio's: what is due in no time at all is looked for again a moment later.
            with trio.move_on_after(max(seconds, WAIT_S_MIN)):
                await self._came.wait()
        self._came = trio.Event()


def fits(message: Message) -> bool:
    """Whether what it brings can be kept: the wire allows more."""
    if isinstance(message, Learn) and not _fits(message.certificate):
        return False
    return all(len(value.data) <= LOG_RECORD_BYTES_MAX and len(value.body) <= LOG_BODY_BYTES_MAX for value in _values_of(message))


def _fits(certificate: Certificate) -> bool:
    return len(certificate.votes) <= DECIDERS_MAX and all(len(vote.signature) <= _SIGNATURE_BYTES_MAX for vote in certificate.votes)


def size_of(event: Event) -> int:
    """Of the values that it brings."""
    return bytes_of(event.message) if isinstance(event, Received) else 0


def bytes_of(message: Message) -> int:
    """Of the values in it."""
    return sum(len(value.data) + len(value.body) for value in _values_of(message))


def _values_of(message: Message) -> list[Value]:
    match message:
        case Propose(highest=highest, value=value):
            found = [highest, value]
        case Accepted(highest=highest):
            found = [highest]
        case Learn(value=value):
            found = [value]
        case _:
            found = []
    return [value for value in found if value is not None]
