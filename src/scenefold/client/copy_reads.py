"""Reads that holders of copies answer where the owner is slow or away (specs/20-copies.md, Reads).

The owner is asked first. If it says nothing for longer than nineteen of twenty answers took lately, or did not answer the last
time, those who hold copies are asked as well, as placement gives them; whatever comes first counts. An owner that adopted a place is asked
after them, until it is the sooner one (adopters.py). Where far more of a call lies with one owner than with others, they are asked from the
beginning (wide_reads.py).
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Iterable, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import NamedTuple

import trio

from scenefold.base.ids import NodeId, SceneId, SpaceId
from scenefold.base.limits import CIPHERTEXT_BYTES_MAX
from scenefold.base.location import Location
from scenefold.client.adopters import Gone, Turn
from scenefold.client.asked_holders import AskedHolders, Groups
from scenefold.client.bad_copies import BadCopies
from scenefold.client.calls import Calls
from scenefold.client.copy_words import NOTHING
from scenefold.client.hedging import helped
from scenefold.client.shares import UsualBytes
from scenefold.client.verifying import Key
from scenefold.client.wide_reads import AskOnce, WideRead
from scenefold.crypto import version_of
from scenefold.scene.log import Layouts
from scenefold.wire import RecordBytes

AskOwner = Callable[[NodeId, list[int]], Awaitable[None]]
Judge = Callable[[Sequence[Key], Sequence[RecordBytes]], Awaitable[Sequence[bool]]]
"""Which of some records are certainly what a writer put there."""


class Wanted(NamedTuple):
    """Records of one call, by their numbers in it."""

    keys: Sequence[Key]
    homes: Sequence[Location]
    position: int
    """How far the reader knows the scene's log."""
    take: Callable[[int, RecordBytes | None], None]
    """Told what somebody says that counts; None: nothing is there."""
    is_here: Callable[[int], bool]
    """Whether it is known what lies there, and that is sound."""
    record: Callable[[int], RecordBytes | None]
    """What is known to lie there."""


@dataclass(frozen=True, slots=True)
class CopyReads:
    """Who may be asked in an owner's stead for records of one scene, and how."""

    calls: Calls
    scene: SceneId
    layouts: Layouts
    judge: Judge | None = None
    """None: whoever reads looks at all of it himself, whoever it came from."""
    usual: UsualBytes = field(default_factory=partial(UsualBytes, CIPHERTEXT_BYTES_MAX))
    bad: BadCopies = field(default_factory=BadCopies)
    """What was met in this call."""

    def holders(self, space: SpaceId, home: Location) -> tuple[NodeId, ...]:
        """Who holds copies of a place, as far as the client knows the line, or did a moment ago; nobody if the space has no shadows."""
        offsets = self.layouts.offsets.get(space, ())
        if not offsets:
            return ()
        needed = self.layouts.needed[space]
        present = self.calls.table.holders_of(offsets, home, needed)
        former = self.calls.former.holders(self.calls.world.clock.now(), offsets, home, needed)
        return tuple(dict.fromkeys([*present, *former])) if former else present

    def owners(self, home: Location) -> set[NodeId]:
        """Under whose configuration holders may answer for a place."""
        former = self.calls.former.owners(self.calls.world.clock.now(), home)
        return {owner.node_id for owner in self.calls.table.candidates(home)} | former

    async def beside(self, ask_owner: AskOwner, wanted: Wanted, owner: NodeId, frame: list[int]) -> None:
        """Ask the owner for some of the records, and, if it is slow, the holders; `wanted.take` is told what they say that counts.

        Returns once the owner has answered or all are known otherwise. What the owner raises is raised if the holders do not know all.
        """
        groups = self.groups(wanted, frame)
        if not groups:
            await ask_owner(owner, frame)
            return
        calls, now = self.calls, self.calls.world.clock.now
        holders = AskedHolders(self, wanted)
        gone = self.gone(wanted, frame, owner)
        turn = calls.adopters.turn(now(), owner, gone)
        if turn is Turn.HOLDERS:
            with trio.move_on_after(calls.tails.usual_s(len(frame))):
                await holders.ask(groups)
        if not holders.have(frame):
            began, after_s = now(), self.patience_s(owner, len(frame)) if turn is Turn.OWNER else 0.0

            async def ask_holders() -> None:
                if 0 < after_s <= now() - began:
                    calls.tails.asked_others()
                await holders.ask(groups)

            others_know = partial(holders.have, frame)
            answered = await helped(partial(ask_owner, owner, frame), ask_holders, after_s=after_s, others_know=others_know)
            self._note(owner, len(frame), now() - began, gone, answered=answered)
        for index in filter(wanted.is_here, frame):
            record = wanted.record(index)
            for node in holders.otherwise(index, NOTHING if record is None else version_of(record.header)):
                self.bad.met(owner, node, index)

    def _note(self, owner: NodeId, records: int, seconds: float, gone: Gone, *, answered: bool) -> None:
        """The owner `answered` for so many records, or others knew sooner."""
        calls = self.calls
        if gone and answered:
            calls.adopters.was_sooner(owner, gone)
        elif gone:
            calls.adopters.was_late(calls.world.clock.now(), owner, gone)
        elif answered:
            calls.tails.note(owner, records, seconds)
        elif not calls.is_silent(owner):
            calls.tails.was_late(owner)

    def gone(self, wanted: Wanted, frame: Iterable[int], owner: NodeId) -> Gone:
        """Who else may own any of these places by the table, or did a moment ago, and is there no more."""
        if not self.calls.knows_changes:
            return frozenset()
        others = set().union(*(self.owners(wanted.homes[index]) for index in frame)) - {owner}
        return frozenset(filter(self.calls.is_gone, others))

    def patience_s(self, owner: NodeId, records: int) -> float:
        """How long it is waited for alone. Who did not answer the last time, or is slow all the time, is hardly worth it."""
        is_late = self.calls.is_silent(owner) or self.calls.tails.is_behind(owner)
        return 0.0 if is_late else self.calls.tails.limit_s(records)

    async def wide(self, ask_once: AskOnce, wanted: Wanted, owner: NodeId, frame: list[int], least: int) -> None:
        """Read them from the owner and all holders at once. Raises what the owner raises if others cannot help either."""
        await WideRead(self, ask_once, wanted, owner, frame, least).run()

    async def tell(self, wanted: Wanted) -> None:
        """Tell owners what was met at holders that does not count."""
        await self.bad.tell(self.calls, self.scene, wanted.keys)

    async def instead(self, wanted: Wanted, frame: list[int]) -> None:
        """Ask the holders alone: the owner has said that it has lost these."""
        await AskedHolders(self, wanted).ask(self.groups(wanted, frame))

    async def forged(self, wanted: Wanted, told: Sequence[tuple[int, RecordBytes]]) -> set[int]:
        """Those of some records of which nobody can say that a writer put them there."""
        if self.judge is None or not told:
            return set()
        verdicts = await self.judge([wanted.keys[index] for index, _ in told], [record for _, record in told])
        return {index for (index, _), is_sound in zip(told, verdicts, strict=True) if not is_sound}

    def groups(self, wanted: Wanted, frame: Iterable[int]) -> Groups:
        """Those of the keys that anybody holds copies of, by who does."""
        groups: Groups = {}
        for index in frame:
            if holders := self.holders(wanted.keys[index][0], wanted.homes[index]):
                groups.setdefault(holders, []).append(index)
        return groups
