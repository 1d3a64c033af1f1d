"""Records into a scene: sealed, sent to whoever owns their places, and again until each is durable or refused (specs/18-data.md, Writes).

What is sent again is sealed anew where the scene, or what lies at the place, went on meanwhile.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING

from scenefold.base.errors import LocalFault, Refused
from scenefold.base.limits import CLIENT_BATCH_BYTES, CLIENT_TRIES_MAX, PAYLOAD_BYTES_MAX
from scenefold.base.reasons import RejectReason
from scenefold.client.delivery import Delivered, deliver
from scenefold.client.doubt import Doubt
from scenefold.client.leases import Edit
from scenefold.client.sealing import Draft, Opened, SceneIdentity, seal_all
from scenefold.client.split import frames
from scenefold.client.together import together
from scenefold.client.tombstones import is_tombstone
from scenefold.client.versions import SEQ_MAX
from scenefold.client.wishes import Placed, Wish
from scenefold.crypto import EXPECTS_NOTHING, NONCE_BYTES, RecordHeader
from scenefold.crypto.record_header import version_key
from scenefold.wire import PutItem

if TYPE_CHECKING:
    from scenefold.client.access import SceneAccess

_BEHIND = frozenset({RejectReason.MODE_FORBIDS, RejectReason.KEY_REVOKED})
"""What a node says to whoever signs under a log position that is over."""

_REMEDIES = {
    RejectReason.STORAGE_FULL: "free space on the nodes or add a node",
    RejectReason.TOO_FEW_COPIES: "`scenectl cluster status` shows the nodes and their blacklists: add nodes, or take some off a blacklist",
    RejectReason.UNKNOWN_SCENE_OR_SPACE: "`scenectl space list` shows the spaces of the scene",
}
_WITHOUT = "write or delete it without an expectation"
_HEALED = (
    "let whoever has the very record send it again, or change the scene's members or spaces and write anew; if it lasts, drain that node"
)


async def put(access: SceneAccess, wishes: Sequence[Wish], *, fresh: bool) -> list[Placed]:
    """See `SceneAccess.put`."""
    doubt = Doubt("a write", lambda index: access.where(wishes[index]), "read it, then decide whether to write again")
    with doubt.no_refusal(), access.calls.leases.edit() as edit:
        return await _put(access, wishes, fresh, doubt, edit)


async def _put(access: SceneAccess, wishes: Sequence[Wish], fresh: bool, doubt: Doubt, edit: Edit) -> list[Placed]:
    """`doubt`: by number of the wish, over all the records that it is signed as. `edit`: around all of it."""
    placed: list[Placed | None] = [None] * len(wishes)
    pending = list(range(len(wishes)))
    current = list(wishes)
    routes = [wish.route for wish in wishes]
    for attempt in range(CLIENT_TRIES_MAX):
        await access.check([wishes[index] for index in pending])
        items = dict(zip(pending, await _sealed(access, [current[index] for index in pending], edit), strict=True))
        outcomes = await deliver(access.calls, items, routes, doubt, access.identity.layouts.needed)
        behind: list[int] = []
        for index, item in items.items():
            outcome = outcomes[index]
            placed[index] = Placed(outcome.reason, _digest_of(item), outcome.node, outcome.location)
            is_stale = outcome.reason == RejectReason.STALE_VERSION
            if outcome.reason == 0:
                header = RecordHeader.decode(item.header)
                access.setbacks.wrote(wishes[index].key, version_key(header), is_deleted=is_tombstone(wishes[index].payload))
            is_settled = outcome.reason == 0 or (is_stale and fresh)
            if is_stale and fresh:
                doubt.settle(index)
            if outcome.reason in _BEHIND and attempt + 1 < CLIENT_TRIES_MAX and access.log is not None:
                behind.append(index)
            elif not is_settled and (not is_stale or index in doubt):
                await _explain(access, outcome.reason, wishes[index])
                raise _refused(access, outcome, wishes[index])
        if behind:
            # The log went on without us. What was not stored is signed anew, under the position that is known now.
            await access.refresh()
        stale = [index for index in pending if _is_stale(placed[index]) and not fresh]
        pending = behind + await _over_stale(access, wishes, current, stale)
        if not pending:
            break
    else:
        remedy = "somebody else writes there all the time; try again"
        raise Refused(RejectReason.BUSY, f"{len(pending)} records are overtaken again and again", remedy=remedy)
    return [outcome for outcome in placed if outcome is not None]


async def _over_stale(access: SceneAccess, wishes: Sequence[Wish], current: list[Wish], stale: Sequence[int]) -> list[int]:
    """Which of these may replace what is there, and are above it from now on."""
    again: list[int] = []
    there = await access.get([wishes[index].key for index in stale])
    for index, found in zip(stale, there, strict=True):
        # What was expected is there, yet ours was not newer: this clock is behind that of the version's writer.
        if _may_replace(wishes[index], found):
            again.append(index)
            if found is not None:
                await _check_room(access, wishes[index], found)
                expect = found.digest if wishes[index].expect == EXPECTS_NOTHING else wishes[index].expect
                current[index] = wishes[index]._replace(expect=expect, above=found.seq)
    return again


async def _explain(access: SceneAccess, reason: int, wish: Wish) -> None:
    """A record of the wrong kind is refused as ill-formed. Of a space that is younger than what we know we know its kind now."""
    if reason == RejectReason.ILL_FORMED:
        await access.refresh()
        access.identity.check_kind(wish.space, wish.object)


async def _check_room(access: SceneAccess, wish: Wish, there: Opened) -> None:
    """Refused (busy) if no version is above that which is there, whoever writes it. Only the scene's log goes above it."""
    if there.seq < SEQ_MAX or there.version[0] < access.identity.position:
        return
    await access.refresh()
    if there.version[0] >= access.identity.position:
        remedy = "any change of the scene's members or spaces frees the place"
        last = f"the last to write there was the key {there.version[2]:08x}, who need not have chosen that number"
        what = f"the record there has the highest version that there is; {last}"
        raise Refused(RejectReason.BUSY, what, where=access.where(wish), remedy=remedy)


async def _sealed(access: SceneAccess, wishes: Sequence[Wish], edit: Edit) -> list[PutItem]:
    """Under a lease from before the first signature until after the last one, where edits need one."""
    spaces = sorted({wish.space for wish in wishes})
    for _ in range(CLIENT_TRIES_MAX):
        identity = await edit.hold(access, spaces)
        items = await _seal(access, wishes, identity)
        if edit.may_send(identity, spaces):
            return items
    what = "a lease for edits runs out each time before the records are signed: this computer has too much to do"
    raise Refused(RejectReason.BUSY, what, where=f"scene {access.name}", remedy="try again in a while; nothing was written")


async def _seal(access: SceneAccess, wishes: Sequence[Wish], identity: SceneIdentity) -> list[PutItem]:
    wall, token = access.calls.world.clock.wall(), access.calls.world.entropy.token
    drafts = [
        Draft(
            wish.space,
            wish.location,
            wish.payload,
            wish.expect,
            # Several may be for one place, and the last of them is to stay.
            access.sequencer.next(wall, wish.above and wish.above + number),
            token(NONCE_BYTES),
            wish.content_position,
            wish.object,
        )
        for number, wish in enumerate(wishes)
    ]
    items: list[PutItem] = []
    sizes = [len(draft.payload) for draft in drafts]
    for index, size in enumerate(sizes):
        if size > PAYLOAD_BYTES_MAX:
            where = access.where(wishes[index])
            raise LocalFault(f"{size} bytes do not fit a record of {PAYLOAD_BYTES_MAX}", where=where, remedy="split it")
    access.calls.key_use.take(identity.genesis, identity.sealing_key[0], len(drafts), f"scene {access.name}")
    batches = list(frames(range(len(drafts)), sizes, CLIENT_BATCH_BYTES))
    sealed: list[list[PutItem]] = [[] for _ in batches]

    async def seal(number: int, batch: list[int]) -> None:
        part = [drafts[index] for index in batch]
        sealed[number] = await access.in_crypto_lane(seal_all, identity, access.writer, access.session, part)

    await together(partial(seal, number, batch) for number, batch in enumerate(batches))
    for wish in wishes:
        access.lengths.saw(wish.key, wish.payload)
    for part in sealed:
        items += part
    return items


def _refused(access: SceneAccess, outcome: Delivered, wish: Wish) -> Refused:
    reason = RejectReason(outcome.reason)
    if reason is RejectReason.DAMAGED:
        return _damaged(access, outcome, wish)
    by, words = access.calls.address_of(outcome.node), reason.name.lower().replace("_", " ")
    return Refused(reason, f"{by} refused the record: {words}", where=access.where(wish), remedy=_REMEDIES.get(reason, ""))


def _damaged(access: SceneAccess, outcome: Delivered, wish: Wish) -> Refused:
    """Only an owner can say that, and nobody can see whether it is so. So nothing is signed for its asking: not what is above all
    that clocks give, which who lies could keep, and put over what is written there later."""
    by = access.calls.address_of(outcome.node)
    what = f"{by} says that the record there is damaged: it cannot tell its version, nor whether this one may replace it"
    if wish.expect is not None:
        return Refused(RejectReason.DAMAGED, f"{what} by what it expects", where=access.where(wish), remedy=_WITHOUT)
    return Refused(RejectReason.DAMAGED, what, where=access.where(wish), remedy=_HEALED)


def _digest_of(item: PutItem) -> bytes:
    """The digest that `expect` speaks of."""
    return RecordHeader.decode(item.header).digest


def _may_replace(wish: Wish, there: Opened | None) -> bool:
    """Whether a wish that was refused for its version wants what is there now replaced."""
    if wish.expect == EXPECTS_NOTHING:
        return there is None or there.deleted
    return wish.expect is None or (there is not None and there.digest == wish.expect)


def _is_stale(placed: Placed | None) -> bool:
    return placed is not None and placed.reason == RejectReason.STALE_VERSION
