"""What must hold of a log that nodes run, watched on their disks and in what clients were told. `Broken` is raised where it does not.

Two judges. The *history*: no two values at one position, logs are prefixes of one another, no request twice, nothing acknowledged lost,
real-time order, nothing rejected decided. And the *laws* of the machine's own tests, which see sooner that a disk forgets: what is
voted for counts only once it is on one.
"""

from __future__ import annotations

from dataclasses import dataclass

from scenefold.consensus import Accepted, Decide, Message, Outcome, Persist, Promise, Propose, Rejected, Slot
from scenefold.peer.logs import Answer
from scenefold.store.layout import LOGS
from scenefold.store.log_rows import Decided, decided_key, position_of, unpack_decided, unpack_votes, votes_key
from scenefold.wire import Member
from scenefold.world.sim import SimDisk
from unit.consensus.laws import Broken, Laws
from unit.consensus.logs_made import GENESIS, Book, request_of


@dataclass
class Asked:
    """What a client asked for, when, and what it was told in the end."""

    request: str
    begun_at: float
    ended_at: float | None = None
    answer: Answer | None = None


class Watch:
    def __init__(self, first: Book, members: dict[str, Member]) -> None:
        self.laws = Laws(first)
        self.books = [first]
        """By position: what all know who have decided so far."""
        self.asked: list[Asked] = []
        self.minds_disks = True
        """False: only the history is judged."""
        self.broken: Broken | None = None
        """The first thing that was found: it is raised where nobody catches it."""
        self._members = members

    # -------------------------------------------------------------------------------------------------------- disks

    def committed(self, address: str, disk: SimDisk) -> None:
        """A node's disk has changed."""
        try:
            for key, _ in sorted(disk.replaced(LOGS), reverse=True):  # what is decided before what is voted for behind it
                if key == votes_key(GENESIS):
                    self._voted(address, disk)
                elif position_of(key):
                    self._decided(address, disk, unpack_decided(key, memoryview(disk.peek(LOGS)[key])))
        except Broken as broken:
            self.broken = self.broken or broken

    def restarted(self, address: str, disk: SimDisk) -> None:
        """What is on its disk when it starts is all that it knows."""
        if not self.minds_disks or votes_key(GENESIS) not in disk.peek(LOGS):
            return
        try:
            position, slot = slot_on(disk)
            self.laws.restarted(self._members[address], position, slot)
        except Broken as broken:
            self.broken = self.broken or broken

    def _voted(self, address: str, disk: SimDisk) -> None:
        position, slot = slot_on(disk)
        if position > len(self.books):
            raise Broken(f"{address} votes at {position}, and the one before is decided nowhere")
        if self.minds_disks and slot != Slot():
            self.laws.wrote(self._members[address], position, Persist(slot), self.books[position - 1])

    def _decided(self, address: str, disk: SimDisk, row: Decided) -> None:
        position, value, certificate = row
        if position > 1 and decided_key(GENESIS, position - 1) not in disk.peek(LOGS):
            raise Broken(f"position {position} is decided at {address}, and the one before is not")
        if position == len(self.books):
            if self.books[-1].refuses(value) is not None:
                raise Broken(f"I3: position {position} at {address} does not follow from those before it")
            self.books.append(self.books[-1].after(value))
        if position >= len(self.books):
            raise Broken(f"position {position} is decided at {address}, and the one before nowhere")
        if self.books[position].head != value.digest.hex():
            raise Broken(f"I1: position {position} is decided twice")
        if self.minds_disks:
            self.laws.wrote(self._members[address], position, Decide(position, value, certificate), self.books[position])

    # ---------------------------------------------------------------------------------------------------- rule D

    def sent(self, address: str, disk: SimDisk, message: Message) -> None:
        """What a node shows of itself must be on its disk already."""
        facts = message.facts if isinstance(message, Propose | Accepted | Rejected) else ()
        for fact in facts if self.minds_disks else ():
            if fact.member != self._members[address]:
                continue
            position, slot = slot_on(disk)
            is_there = slot.promised >= fact.ballot if isinstance(fact, Promise) else slot.accepted_ballot >= fact.ballot
            if fact.position > position or (fact.position == position and not is_there):
                self.broken = self.broken or Broken(f"D: {address} shows {fact}, and has written {slot} of position {position}")

    # ------------------------------------------------------------------------------------------------------ clients

    def begins(self, request: str, now: float) -> Asked:
        self.asked.append(Asked(request, now))
        return self.asked[-1]

    def told(self, asked: Asked, answer: Answer, now: float) -> None:
        """The answer that counts: nobody asks for this request any more."""
        asked.answer, asked.ended_at = answer, now
        if answer.outcome is Outcome.COMMITTED and self.books[-1].requests.get(asked.request) != answer.position:
            self.broken = self.broken or Broken(f"{asked.request} is acknowledged at {answer.position}, and not decided there")

    def judge_history(self) -> None:
        """What clients were told, against the log that all have come to."""
        if self.broken is not None:
            raise self.broken
        at = self.books[-1].requests
        for asked in self.asked:
            if asked.answer is None:
                continue
            if asked.answer.outcome is Outcome.COMMITTED and at.get(asked.request) != asked.answer.position:
                raise Broken(f"{asked.request} was acknowledged at {asked.answer.position}, and is at {at.get(asked.request)}")
            if asked.answer.outcome is Outcome.REJECTED and asked.request in at:
                raise Broken(f"{asked.request} was rejected, and is decided at {at[asked.request]}")
        acknowledged = sorted(
            (asked.ended_at, at[asked.request])
            for asked in self.asked
            if asked.answer is not None and asked.ended_at is not None and asked.answer.outcome is Outcome.COMMITTED
        )
        for asked in self.asked:
            if asked.request in at:
                before = [position for ended_at, position in acknowledged if ended_at < asked.begun_at]
                if before and max(before) > at[asked.request]:
                    raise Broken(f"{asked.request} was asked for after something at {max(before)} was acknowledged, and is before it")


def slot_on(disk: SimDisk) -> tuple[int, Slot]:
    """The open position, and what is promised and voted for there."""
    votes = unpack_votes(GENESIS, memoryview(disk.peek(LOGS)[votes_key(GENESIS)]))
    return votes.position, votes.slot


def log_on(disk: SimDisk) -> list[str]:
    """The requests that are decided, in their order."""
    rows = sorted((key, value) for key, value in disk.peek(LOGS).items() if position_of(key))
    return [request_of(unpack_decided(key, memoryview(value)).value) for key, value in rows]
