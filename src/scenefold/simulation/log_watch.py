"""The log of one scene, as it lies on all disks: each commit is looked at when it is durable, and judged (specs/17-simulation.md, Logs)."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from functools import lru_cache

from scenefold.base.errors import DamagedData
from scenefold.base.ids import NodeId
from scenefold.scene.log.values import opened_value
from scenefold.simulation import laws
from scenefold.simulation.disks import Disk, incarnation_of
from scenefold.simulation.log_agreement import Agreement, Entry
from scenefold.simulation.log_history import Attempt, LogHistory, Told, Wrong
from scenefold.simulation.log_votes import Paper, Voting
from scenefold.store.layout import HEADERS, LOGS, scene_key
from scenefold.store.log_rows import Decided, position_of, unpack_decided, unpack_votes
from scenefold.wire import LogValue, MalformedPacket, Member, SceneLogPublic, digest_of_header

_REMEMBERED_MAX = 512
"""What one disk has all others have, too, a moment later."""

Violated = Callable[[str, str, tuple[int, ...]], None]
"""Law, words, slots."""


class LogWatch:
    """`disks` and `nodes` by slot; `put_back`: the incarnation of the backup that a disk was last put back to. `violated` is told of what does
    not hold; `tell` of what happens, for the story."""

    def __init__(
        self,
        disks: Mapping[int, Disk],
        nodes: Mapping[int, NodeId],
        put_back: Mapping[int, bytes],
        violated: Violated,
        tell: Callable[[int | None, str], None],
    ) -> None:
        self.history = LogHistory()
        self.agreement = Agreement()
        self.voting = Voting()
        self.on_decided: Callable[[SceneLogPublic], None] = lambda _: None
        """Called with each header that is decided, when it is seen first."""
        self.first: SceneLogPublic | None = None
        """The header that the scene was found with, once it is there."""
        self._disks, self._nodes, self._put_back = disks, nodes, put_back
        self._violated, self._tell = violated, tell
        self._headers: dict[str, int] = {}
        """The position of the one that lies on each disk."""

    def follow(self, header: SceneLogPublic) -> None:
        """From now on this is the scene. What lies on disks already is looked at, too."""
        self.first = header
        for slot in self._disks:
            self._look_at_header(slot)
            self._look_at_rows(slot, sorted(self._disks[slot].peek(LOGS)))

    def committed(self, slot: int) -> None:
        """Something has just become durable on a disk."""
        if self.first is None:
            return
        disk, name = self._disks[slot], scene_key(self.first.scene)
        shown = self._headers.get(self._name(slot), 0)
        if any(key == name for key, _ in disk.replaced(HEADERS)):
            self._look_at_header(slot)
        rows = [key for key, _ in disk.replaced(LOGS)]
        if rows:
            self._look_at_rows(slot, rows, shown)

    def shown(self, who: str, header: SceneLogPublic) -> None:
        """A client has taken this for decided."""
        assert self.first is not None
        if header.genesis == self.first.genesis:
            self._say(self.agreement.shown(who, _entry_of(header)))

    def told(self, attempt: Attempt) -> None:
        """A client has been told what became of what it asked for."""
        if attempt.told is Told.COMMITTED:
            self._say(self.agreement.acknowledged(attempt.request, attempt.position))
        self._tell(None, f"{attempt} is told {attempt.told.value}{f' at {attempt.position}' if attempt.position else ''}")

    def participants(self) -> list[Member]:
        """Those who decide what is next, by the newest that anybody knows; nobody as long as the origin decides."""
        return sorted(self.voting.deciders.get(self.agreement.newest + 1, ()), key=lambda member: member.node)

    def judge(self, wrong: Iterable[Wrong]) -> None:
        """What was found otherwise."""
        self._say(wrong)

    # -------------------------------------------------------------------------------------------------------- disks

    def _look_at_header(self, slot: int) -> None:
        header = self._header_on(slot)
        if header is None:
            return
        self._is_decided(slot, _entry_of(header), header)
        self._say(self.agreement.holds(f"{self._name(slot)}, header", header.position), slot)
        self._headers[self._name(slot)] = header.position

    def _header_on(self, slot: int) -> SceneLogPublic | None:
        assert self.first is not None
        stored = self._disks[slot].written(HEADERS).get(scene_key(self.first.scene))
        header = None if stored is None else _header(bytes(stored))
        return header if header is not None and header.genesis == self.first.genesis else None

    def _look_at_rows(self, slot: int, keys: Iterable[bytes], shown: int = 0) -> None:
        """What is decided first: what is voted for stands behind it. `shown`: the position of the header that lay there before."""
        assert self.first is not None
        table, genesis = self._disks[slot].peek(LOGS), self.first.genesis
        rows = [key for key in keys if key.startswith(genesis) and key in table]
        for key in sorted(rows, key=lambda key: position_of(key) or 1 << 64):
            try:
                if position_of(key):
                    self._look_at_decided(slot, unpack_decided(key, memoryview(table[key])), shown)
                else:
                    self._look_at_votes(slot, memoryview(table[key]))
            except DamagedData as problem:
                self._tell(slot, str(problem))

    def _look_at_decided(self, slot: int, row: Decided, shown: int) -> None:
        assert self.first is not None
        try:
            entry, header = _decided(row.position, row.value.data, row.value.body)
        except MalformedPacket as problem:
            self._violated(laws.ONE_VALUE, f"{self._name(slot)} has no value at position {row.position}: {problem}", (slot,))
            return
        proof = row.certificate
        voters = [vote.member for vote in proof.votes]
        self._say(self.voting.certified(self._member(slot), row.position, proof.ballot, row.value.digest, voters), slot)
        self._is_decided(slot, entry, header)
        # A log may go on behind a header that was shown, where nobody tells what lies between.
        self._say(self.agreement.extends(self._name(slot), row.position, shown), slot)

    def _look_at_votes(self, slot: int, stored: memoryview) -> None:
        assert self.first is not None
        votes = unpack_votes(self.first.genesis, stored)
        accepted = votes.slot.accepted
        paper = Paper(votes.position, votes.slot.promised, None if accepted is None else (accepted.ballot, accepted.value.digest))
        wrote = self.voting.put_back if self._put_back.get(slot) == votes.incarnation else self.voting.wrote
        self._say(wrote(Member(self._nodes[slot], votes.incarnation), paper), slot)
        # As above.
        header = self._header_on(slot)
        if header is not None and header.position >= votes.position - 1:
            self._say(self.agreement.holds(self._name(slot), votes.position - 1), slot)

    def _is_decided(self, slot: int, entry: Entry, header: SceneLogPublic) -> None:
        is_new = entry.position not in self.agreement.entries
        self._say(self.agreement.shown(self._name(slot), entry), slot)
        if header.participants:
            deciders = frozenset(one.member for one in header.participants)
            self._say(self.voting.decides(header.position + 1, deciders), slot)
        if is_new:
            self.on_decided(header)
            self._tell(slot, f"is the first to have {entry} decided, for request {entry.request.hex()[:8] or 'unknown'}")

    def _name(self, slot: int) -> str:
        incarnation = incarnation_of(self._disks[slot]) or b""
        return f"n{slot} ({incarnation.hex()[:6]}{', put back' if self._put_back.get(slot) == incarnation else ''})"

    def _member(self, slot: int) -> Member:
        return Member(self._nodes[slot], incarnation_of(self._disks[slot]) or b"")

    def _say(self, wrong: Iterable[Wrong], *slots: int) -> None:
        for law, what in wrong:
            self._violated(law, what, slots)


@lru_cache(_REMEMBERED_MAX)
def _header(stored: bytes) -> SceneLogPublic | None:
    try:
        return SceneLogPublic.decode(stored)
    except MalformedPacket:
        return None


@lru_cache(_REMEMBERED_MAX)
def _entry_of(header: SceneLogPublic) -> Entry:
    return Entry(header.position, digest_of_header(header), header.request, header.previous)


@lru_cache(_REMEMBERED_MAX)
def _decided(position: int, data: bytes, body: bytes) -> tuple[Entry, SceneLogPublic]:
    header = opened_value(LogValue(data, body)).public
    return _entry_of(header)._replace(position=position), header
