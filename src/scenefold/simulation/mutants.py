"""The product with one safeguard switched off, each by a patch of one small function or constant.

A simulation that finds none of them would find no bug of that kind either. A name that cannot be patched any more, because the
function has moved, is an error and no silent success.
"""

from __future__ import annotations

import contextlib
import importlib
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from typing import Any

from scenefold.simulation.log_mutants import deaf_to_borrowers, forgetful_memory, half, half_of_participants, stale_roster, unfenced
from scenefold.simulation.render_mutants import (
    first_reading_is_enough,
    held_for_ever,
    however_often_it_comes,
    kept_beside,
    wherever_they_come,
    without_a_node,
)


@dataclass(frozen=True, slots=True)
class Patch:
    """`make` is given what `module`'s `name` (dots go into classes) is now, and gives what takes its place."""

    module: str
    name: str
    make: Callable[[Any], Any]


def _always(value: object) -> Callable[[Any], Any]:
    return lambda _original: lambda *_args, **_named: value


def _blind_judge(original: Any) -> Any:
    """Any version may replace any other."""
    from scenefold.store.judging import Outcome, PutResult

    def judge(new: Any, present: Any) -> Any:
        result = original(new, present)
        return PutResult(Outcome.STORED, new.digest) if result.outcome is Outcome.STALE else result

    return judge


def _judge_of_copies(_original: Any) -> Any:
    """What a client's record expects is not looked at."""
    from scenefold.store.judging import judge_copy

    return judge_copy


def _hasty_submit(original: Any) -> Any:
    """Puts are answered once they are queued."""
    import trio

    from scenefold.crypto import EXPECTS_ANYTHING
    from scenefold.store.judging import Outcome, PutResult
    from scenefold.store.record_changes import PutRecords

    async def submit(self: Any, change: Any) -> Any:
        if not isinstance(change, PutRecords) or any(header.expects != EXPECTS_ANYTHING for header, _ in change.puts):
            return await original(self, change)
        with trio.move_on_after(0):
            await original(self, change)
        trio.lowlevel.spawn_system_task(_quietly, original, self, change)
        return [PutResult(Outcome.STORED, header.digest) for header, _ in change.puts]

    return submit


async def _quietly(function: Any, *arguments: Any) -> None:
    # What the mutant does behind everybody's back may fail as it likes.
    with contextlib.suppress(Exception):
        await function(*arguments)


def _deaf_helpers(_original: Any) -> Any:
    """Nobody is asked to probe for us: what does not answer directly is silent."""

    async def heard_by_others(*_args: Any) -> Any:
        from scenefold.peer.membership.probing import Verdict

        return Verdict.NOT_HEARD

    return heard_by_others


def _no_last_copy(original: Any) -> Any:
    """What was written while a piece was being copied is not copied again before the piece is let go of."""

    async def copy(self: Any, *, only: Any = None, hurry: bool = False) -> Any:
        from scenefold.peer.line.copying import Pass

        return Pass(0, 0) if hurry else await original(self, only=only, hurry=hurry)

    return copy


def _hasty_keeping(original: Any) -> Any:
    """A receiver says that it has records durably while it still writes them."""
    import trio

    async def keep_durably(*arguments: Any) -> None:
        trio.lowlevel.spawn_system_task(_quietly, original, *arguments)
        await trio.lowlevel.checkpoint()

    return keep_durably


def _forgetful_strays(_original: Any) -> Any:
    """What is not a node's own any more is dropped, and offered to nobody."""

    async def bring_home(self: Any, _owner: Any, entries: Any) -> int:
        async with self._parts.keeper.unchanging() as holding:
            gone = [(entry.spot, entry.digest) for entry in entries if not any(entry.home in piece for piece in holding.kept)]
            if gone:
                await self._parts.store.remove(gone)
        return len(gone)

    return bring_home


def _trusting_receiver(_original: Any) -> Any:
    """What another node hands over is kept as it comes."""

    def verify_copies(claims: Any) -> list[Any]:
        from scenefold.crypto import Record
        from scenefold.store import Put

        return [Put(Record(item.header, item.signature, item.ciphertext), at=item.location if item.object else None) for item, _ in claims]

    return verify_copies


def _trusting_comparison(original: Any) -> Any:
    """Whatever a holder has otherwise is the newest, also where it is older."""

    def compare(arc: Any, own: Any, theirs: Any, found: Any) -> None:
        original(arc, own, theirs, found)
        found.newer[:] = [other for key, other in theirs.items() if key not in own or own[key].rank != other.rank]

    return compare


def _wanting_all(_original: Any) -> Any:
    async def wanted(_self: Any, named: Any) -> list[Any]:
        return list(named)

    return wanted


def _overwriting(original: Any) -> Any:
    """What a holder has given takes the place of what lay there, whichever is newer."""

    async def take(self: Any, puts: Any, *rest: Any) -> None:
        from scenefold.crypto import RecordHeader, RecordPlace
        from scenefold.store import Spot

        store, headers = self._parts.store, [put.record.header for put in puts if put.at is None]
        spots = [Spot(RecordPlace(header.scene, header.space, header.location), b"") for header in headers]
        present = await store.record_headers(spots)
        gone = [(spot, RecordHeader.decode(bytes(header)).digest) for spot, header in zip(spots, present, strict=True) if header]
        await store.remove(gone)
        await original(self, puts, *rest)

    return take


def _one_witness(original: Any) -> Any:
    """Who recovers a gap hears one node, and takes all others as heard."""

    async def hear_out(self: Any, member: Any) -> None:
        if member == self.roll.asked[0]:
            await original(self, member)
        else:
            self.roll.hear(member, ())

    return hear_out


def _asked_by_age(_original: Any) -> Any:
    """Deletions go when they are old enough, whoever else may have something older."""

    async def carry_out(self: Any, order: Any, _scene: Any, spots: Any) -> dict[int, str]:
        await self._asked.look(order)
        await self._asked.drop(list(spots), list(order.items))
        return {}

    return carry_out


def _asked_of_holders(original: Any) -> Any:
    """Before a deletion goes only those are asked who hold copies for its owner."""

    def members_to_ask(self: Any, order: Any) -> list[Any]:
        configurations = self._parts.keeper.copies.configurations
        holders = {member for segment in configurations.segments for member in segment.holders(configurations.me)}
        return [member for member in original(self, order) if member in holders]

    return members_to_ask


def _only_itself(_original: Any) -> Any:
    """Copies are placed as if nobody had a blacklist."""
    return lambda _blacklist, node, *, owner: node == owner


MUTANTS: dict[str, tuple[Patch, ...]] = {
    "version check": tuple(Patch("scenefold.store.record_changes", name, _blind_judge) for name in ("judge", "judge_copy")),
    "signed expectation": (Patch("scenefold.store.record_changes", "judge", _judge_of_copies),),
    "durable before ack": (Patch("scenefold.store.writer", "GroupWriter.submit", _hasty_submit),),
    "owner lease": (Patch("scenefold.peer.cluster_log.lease", "OwnerLease.holds", _always(True)),),
    "indirect probe": (Patch("scenefold.peer.membership.probing", "heard_by_others", _deaf_helpers),),
    "durable before release": (Patch("scenefold.peer.line.receiving", "keep_durably", _hasty_keeping),),
    "last copy": (Patch("scenefold.peer.line.copying", "Copier.copy", _no_last_copy),),
    "strays brought home": (Patch("scenefold.peer.line.strays", "Strays._bring_home", _forgetful_strays),),
    "settling time": (Patch("scenefold.peer.line.settling", "settling_s", _always(0.0)),),
    "participants speak at once": (Patch("scenefold.peer.scene_log.scene_owner", "SceneOwner.speaks", _always(True)),),
    "restored backup": (Patch("scenefold.peer.cluster_log.log_voter", "is_restored", _always(False)),),
    "record of this place": (Patch("scenefold.client.verifying", "check_claim", _always(None)),),
    "reader's signature check": (Patch("scenefold.client.verifying", "check_signature", _always(None)),),
    "checked handover": (Patch("scenefold.peer.line.receiving", "verify_copies", _trusting_receiver),),
    "reader's memory": (Patch("scenefold.client.setbacks", "_is_behind", _always(False)),),
    "decided header": (
        Patch("scenefold.peer.scene_log.headers", "check_decided", _always(None)),
        Patch("scenefold.scene.log.following", "check_decided", _always(None)),
    ),
    "own status only": (
        Patch("scenefold.peer.membership.hearing", "problem_of", _always("")),
        Patch("scenefold.peer.membership.hearing", "problems_of", lambda _original: lambda news: [""] * len(news)),
    ),
    "others' claims": (Patch("scenefold.peer.line.claims", "claimants", lambda _original: lambda *_args: iter(())),),
    "blacklist not looked at": (Patch("scenefold.peer.replication.placing", "forbids", _only_itself),),
    "acknowledged at one copy": (Patch("scenefold.peer.replication.settling_rule", "Rule.is_settled", _always(True)),),
    "repair trusts the first answer": (
        Patch("scenefold.peer.replication.comparing_dialogue", "_compare", _trusting_comparison),
        Patch("scenefold.peer.replication.comparing_space", "SpaceComparison._wanted", _wanting_all),
        Patch("scenefold.peer.replication.comparing_space", "SpaceComparison._take", _overwriting),
    ),
    "tombstones collected by age": (Patch("scenefold.peer.purging.purging", "Purging._carry_out", _asked_by_age),),
    "purge asks only holders": (Patch("scenefold.peer.purging.purging", "Purging.members_to_ask", _asked_of_holders),),
    "recovery hears one node": (Patch("scenefold.peer.replication.recovering_gap", "Asking._hear_out", _one_witness),),
    "vote not durable": (Patch("scenefold.peer.logs.memory", "Memory.write", forgetful_memory),),
    "no majority": (
        Patch("scenefold.consensus.participants", "Participants.majority", half_of_participants),
        Patch("scenefold.scene.log.certified", "_majority", half),
    ),
    "chain from a stale roster": (Patch("scenefold.peer.scene_log.scene_judge", "SceneJudge.after", stale_roster),),
    "no fencing": (Patch("scenefold.peer.records.verification", "KnownScene.check_mode", unfenced),),
    "lent lease ignored at the vote": (
        Patch("scenefold.peer.modes.standing", "Standing.abstains", _always(False)),
        # Consent is a courtesy, which a switch may be forced to leave out: what is right must be so without.
        Patch("scenefold.peer.modes.scene_modes", "SceneModes.veto", deaf_to_borrowers),
    ),
    "left fence": (Patch("scenefold.peer.line.holding", "behind_left_fence", _always(True)),),
    "second reading": (Patch("scenefold.render.ledger", "PassLedger.collected", first_reading_is_enough),),
    "sums of all nodes": (Patch("scenefold.render.pool.member", "Member._close", without_a_node),),
    "rays by epoch": (Patch("scenefold.render.pool.member", "Member.on_rays", wherever_they_come),),
    "credit of links": (Patch("scenefold.render.pool.links.sender", "Sender.may_send", _always(True)),),
    "packets count once": (Patch("scenefold.render.pool.links.link", "Link.is_new", however_often_it_comes),),
    "films handed on once": (Patch("scenefold.render.pool.films", "Films.forget_gathered", kept_beside),),
    "renders let go": (Patch("scenefold.render.watch", "Watch.let_go", held_for_ever),),
}


@contextmanager
def mutated(name: str | None) -> Iterator[None]:
    """The product as the mutant of this name has it; None: as it is."""
    with ExitStack() as stack:
        for patch in MUTANTS[name] if name is not None else ():
            stack.enter_context(_patched(patch))
        yield


@contextmanager
def _patched(patch: Patch) -> Iterator[None]:
    place: Any = importlib.import_module(patch.module)
    *classes, last = patch.name.split(".")
    for part in classes:
        place = getattr(place, part)
    original = getattr(place, last)
    setattr(place, last, patch.make(original))
    try:
        yield
    finally:
        setattr(place, last, original)
