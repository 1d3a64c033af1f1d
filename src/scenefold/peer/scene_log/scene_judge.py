"""May this be a scene's next position, and who decides the one after it? (specs/16-scene-log.md, Participants.) Pure.

Participants hold no key of the scene. They go by what is signed: the header by an owner, and what it says of the position before, of who
takes part and of the sealed log. What the records mean they cannot tell; who reads them can, and the chain holds what was decided.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

from scenefold.base.errors import DamagedData, Refused
from scenefold.base.reasons import RejectReason
from scenefold.consensus.participants import Participant, Participants
from scenefold.consensus.values import Value
from scenefold.crypto import PublicKey
from scenefold.peer.records.verification import KnownScene
from scenefold.peer.scene_log.headers import checked_proposal
from scenefold.scene.log.certified import CHANGES_MAX, changes_before
from scenefold.scene.log.decisions import check_log
from scenefold.scene.log.roster import misfit
from scenefold.scene.log.values import data_of, deciders_after, opened_value
from scenefold.wire import MalformedPacket, SceneBody, SceneLogPublic, digest_of_header, hash_of_record

_REQUEST_BYTES = 16
REQUESTS_MAX = 1_024
"""Requests that a participant remembers. A client asks for the same one again within half a minute, or looks into the log."""
_FITTING_MAX = 4


@dataclass(frozen=True, slots=True)
class SceneJudge:
    """A scene at a position that was decided, and that participants decide what follows."""

    known: KnownScene
    participants: Participants
    changes: int
    """How often those who decide have changed."""
    requests: Mapping[bytes, int] = field(default_factory=lambda: MappingProxyType({}), repr=False)
    """The positions of the newest requests, as far as this node has met them, in their order. Nothing is refused for them."""
    _fitting: OrderedDict[bytes, KnownScene] = field(default_factory=OrderedDict, init=False, repr=False, compare=False)
    """Of the newest values that may stand, the scene with each: a value comes again with every packet about it."""

    @classmethod
    def of(cls, known: KnownScene) -> SceneJudge:
        """`known`: a header that was decided, of a scene that has participants."""
        assert known.public.participants, "the origin alone decides"
        requests = MappingProxyType(_request_of(known.public))
        return cls(known, participants_after(known.public), changes_before(known.public), requests)

    @property
    def public(self) -> SceneLogPublic:
        return self.known.public

    def refuses(self, value: Value, *, is_decided: bool = False) -> RejectReason | None:
        """Takes some 300 microseconds, and longer with a long log."""
        try:
            self.check(value, is_decided=is_decided)
        except Refused as refused:
            return refused.reason
        return None

    def found(self, value: Value) -> int | None:
        try:
            return self.requests.get(opened_value(value).public.request)
        except MalformedPacket:
            return None

    def after(self, value: Value) -> SceneJudge:
        known = self.check(value, is_decided=True)
        public = known.public
        changed = public.participants != self.public.participants
        return SceneJudge(
            known,
            participants_after(public) if changed else self.participants,
            self.changes + changed,
            _newest({**self.requests, **_request_of(public)}),
        )

    def check(self, value: Value, *, is_decided: bool = False) -> KnownScene:
        """The scene with this value; Refused if it may not stand."""
        # A body may be megabytes: its digest is kept for it.
        looked_at = value.digest + hash_of_record(value.body) + bytes([is_decided])
        known = self._fitting.get(looked_at)
        if known is None:
            known = self._fitting[looked_at] = self._checked(value, is_decided=is_decided)
            if len(self._fitting) > _FITTING_MAX:
                self._fitting.popitem(last=False)
        return known

    def _checked(self, value: Value, *, is_decided: bool) -> KnownScene:
        try:
            body = opened_value(value)
        except MalformedPacket as problem:
            raise _ill_formed(str(problem)) from problem
        public = body.public
        if public.decision is not None:
            raise _ill_formed("what is proposed is not decided yet")
        if public.genesis != self.public.genesis or public.position != self.public.position + 1:
            raise _ill_formed(f"the value is not one for position {self.public.position + 1} of this scene")
        if value.data != data_of(deciders_after(self.public), deciders_after(public), digest_of_header(public)):
            raise _ill_formed("the value does not name what it brings, or others who decide")
        if public.previous != digest_of_header(self.public) or len(public.request) != _REQUEST_BYTES:
            raise _ill_formed("the header does not follow the one before, or names no request")
        self._check_log(body, is_decided=is_decided)
        self._check_roster(public)
        return checked_proposal(public, self.known)

    def _check_log(self, body: SceneBody, *, is_decided: bool) -> None:
        if is_decided and not body.private:
            # Newer ones hold it.
            return
        try:
            check_log(body.public, body.private)
        except DamagedData as problem:
            raise _ill_formed(str(problem)) from problem

    def _check_roster(self, public: SceneLogPublic) -> None:
        before = self.public
        problem = misfit(before.participants, before.observers, public.participants, public.observers)
        if problem:
            raise _ill_formed(problem)
        if public.participants != before.participants and self.changes >= CHANGES_MAX:
            what = f"the participants of a scene change {CHANGES_MAX} times at most"
            raise Refused(RejectReason.LIMIT_EXCEEDED, what, where=f"scene {public.scene:08x}")


def participants_after(public: SceneLogPublic) -> Participants:
    """Who decides the position behind this header's."""
    return Participants(tuple(Participant(entry.member, PublicKey(entry.key)) for entry in deciders_after(public)))


def _newest(requests: dict[bytes, int]) -> Mapping[bytes, int]:
    """Without the oldest, if they are too many. One was there before, and one more is there now."""
    if len(requests) > REQUESTS_MAX:
        del requests[next(iter(requests))]
    return MappingProxyType(requests)


def _request_of(public: SceneLogPublic) -> dict[bytes, int]:
    return {public.request: public.position} if public.request else {}


def _ill_formed(what: str) -> Refused:
    return Refused(RejectReason.ILL_FORMED, what, where="scene log")
