"""A scene's mode: what it is, whether it may be acted by yet, and changing it (specs/26-modes.md, The switch, Activation).

What was decided stands in the header; whether it is active a participant says, and only one that holds a lease. Where the scene's origin
decides alone, nobody holds leases, and a mode is active as soon as it is decided.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from typing import Any

from scenefold.base.errors import LocalFault, Refused, Unreachable
from scenefold.base.reasons import RejectReason
from scenefold.client.access import SceneAccess
from scenefold.client.log_reading import ReadLog
from scenefold.client.requests import Again, request_in
from scenefold.client.sealing import scene_ended
from scenefold.scene.log import SceneLog
from scenefold.wire import Batch, BorrowLease, LeaseUse, LentLease, LogEntry, SceneLogPublic, SceneMode, SetMode
from scenefold.world import Priority

ACTIVE_S_MAX = 30.0
"""How long whoever has changed the mode waits until it is active: leases of before are over after half of that."""
UNCONFIRMED_S_MAX = 8.0
"""How long for a majority that confirms a mode which is so already: participants that have just begun have a lease soon, others have none."""
LOOK_S = 0.5


@dataclass(frozen=True, slots=True)
class ModeShown:
    """`is_active` None: nobody who was asked knows, as none of them can reach most of the others."""

    position: int
    """Of the scene's log."""
    mode: SceneMode
    is_active: bool | None

    def document(self) -> dict[str, Any]:
        """The JSON form (docs/reference/scenectl.md)."""
        return {"position": self.position, "mode": self.mode.name.lower(), "active": self.is_active}


async def mode_of(access: SceneAccess) -> ModeShown:
    """What was decided last, and whether it is active. Refused (9) if the scene was ended."""
    header = await _header(access)
    _check_goes_on(access, header)
    shown = await _shown(access, header)
    _check_goes_on(access, shown)
    return shown


async def set_mode(
    access: SceneAccess,
    mode: SceneMode,
    decided: Callable[[int], object] = id,
    so_already: Callable[[int | None], object] = id,
    *,
    force: bool = False,
    again: Again = None,
) -> ModeShown:
    """Change the mode, if it is another one, and wait until it is active, though not for ever. `decided` is told the log's position then.

    `so_already`: told in its place, by whoever knows the newest, that nothing was to be changed: since which position, None if that is not known.
    Refused (13) while a participant has lent what may still be used, which it has asked for to be given back, or an observer renders; (3) if one
    that seems alive does not say whether it suits it; (2) if it was switched again meanwhile. `force`: nobody is asked. Then renders
    come to an end, and what was lent runs out before. `again`: see `LogAccess.propose`.
    """
    header, is_ours, request = await _header(access), False, request_in(again)
    if request is None:
        # Of a change that may be in the log nobody is told that it was refused.
        _check_goes_on(access, header)
    if header.mode is not mode or request is not None:
        log, is_ours = await _switched(access, mode, again, force=force)
        header = log.header
        if is_ours:
            at = _since(log, mode) if request is None else log.state.requests[request.id]
            decided(at or header.position)
    clock = access.calls.world.clock
    began = clock.now()
    while True:
        shown = await _shown(access, header)
        if shown.mode is not mode and shown.position >= header.position:
            _check_goes_on(access, shown)
            raise _switched_again(access, mode, shown)
        waited = clock.now() - began
        is_in_vain = shown.is_active is None and not is_ours and waited >= UNCONFIRMED_S_MAX
        if (shown.is_active and shown.position >= header.position) or waited >= ACTIVE_S_MAX or is_in_vain:
            break
        await clock.sleep(LOOK_S)
    if not is_ours and shown.is_active is not None:
        so_already(await _so_since(access, mode))
    return shown


def _check_goes_on(access: SceneAccess, found: SceneLogPublic | ModeShown) -> None:
    """Refused (9) if the scene was ended: it is in no mode any more."""
    if found.mode is SceneMode.ENDED:
        raise scene_ended(found.position, access.name)


class _SoAlready(LocalFault):
    """Somebody else was faster, with the same mode."""


async def _switched(access: SceneAccess, mode: SceneMode, again: Again, *, force: bool) -> tuple[ReadLog, bool]:
    """The log in which it is so, and whether by us."""
    try:
        return await access.change_log(partial(_switching, access.name, mode), again=again, forced=force), True
    except _SoAlready:
        return await access.read_log(), False


def _switching(name: str, mode: SceneMode, log: SceneLog) -> LogEntry:
    if log.mode is mode:
        raise _SoAlready(f"somebody else has switched the scene to {mode.name.lower()} mode", where=f"scene {name}")
    return SetMode(mode)


def _switched_again(access: SceneAccess, mode: SceneMode, shown: ModeShown) -> Refused:
    wanted, there = mode.name.lower(), shown.mode.name.lower()
    what = f"the scene was switched to {there} mode since: so it is at position {shown.position} of its log"
    remedy = (
        f"`scenectl scene log {access.name} --last 3` shows by which node, and at which position; "
        f"agree with the other owners, and switch it to {wanted} mode once more"
    )
    return Refused(RejectReason.POSITION_BEHIND, what, where=f"scene {access.name}", remedy=remedy)


async def _so_since(access: SceneAccess, mode: SceneMode) -> int | None:
    with suppress(Unreachable, Refused):
        log = await access.read_log()
        return _since(log, mode) if log.state.mode is mode else None
    return None


def _since(log: ReadLog, mode: SceneMode) -> int | None:
    """The position that last brought this mode, whatever came later; None if the records do not say, as they begin behind it."""
    for signed in reversed(log.log.records):
        record = signed.decoded()
        if _set_by(record.entry) is mode:
            return record.position
    return None if log.log.snapshot is not None or mode is not SceneMode.EDIT else 1


def _set_by(entry: LogEntry) -> SceneMode | None:
    """The mode behind an entry that sets one."""
    if isinstance(entry, Batch):
        return next((mode for mode in map(_set_by, reversed(entry.entries)) if mode is not None), None)
    return entry.mode if isinstance(entry, SetMode) else None


async def _header(access: SceneAccess) -> SceneLogPublic:
    header = await access.log_or_fault().header()
    if header is None:
        raise LocalFault("the cluster does not know this scene", where=f"scene {access.name}")
    return header


async def _shown(access: SceneAccess, header: SceneLogPublic) -> ModeShown:
    if not header.participants:
        return ModeShown(header.position, header.mode, True)
    packet = BorrowLease(header.scene, header.genesis, LeaseUse.LOOK, 0)
    try:
        first = header.participants[0].member.node
        answer = await access.calls.ask_around(packet, LentLease, first=first, priority=Priority.HIGH, refusal_counts=False)
    except (Refused, Unreachable) as problem:
        if isinstance(problem, Refused) and problem.reason not in (
            RejectReason.MODE_FORBIDS,
            RejectReason.NOT_READY,
            RejectReason.NO_MAJORITY,
        ):
            raise
        return ModeShown(header.position, header.mode, None)
    if answer.position < header.position:
        # It has not heard of it yet.
        return ModeShown(header.position, header.mode, False)
    return ModeShown(answer.position, answer.mode, answer.is_active)
