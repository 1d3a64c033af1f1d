"""A scene's mode: what it is, whether it may be acted by yet, and changing it (specs/26-modes.md, The switch, Activation).

What was decided stands in the header; whether it is active a participant says, and only one that holds a lease. Where the scene's origin
decides alone, nobody holds leases, and a mode is active as soon as it is decided.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

from scenefold.base.errors import LocalFault, Refused, Unreachable
from scenefold.base.reasons import RejectReason
from scenefold.client.access import SceneAccess
from scenefold.scene.log import SceneLog
from scenefold.wire import BorrowLease, LeaseUse, LentLease, LogEntry, SceneLogPublic, SceneMode, SetMode
from scenefold.world import Priority

ACTIVE_S_MAX = 30.0
"""How long whoever has changed the mode waits until it is active: leases of before are over after half of that."""
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
    """What was decided last, and whether it is active."""
    return await _shown(access, await _header(access))


async def set_mode(access: SceneAccess, mode: SceneMode, decided: Callable[[int], object] = id, *, force: bool = False) -> ModeShown:
    """Change the mode, if it is another one, and wait until it is active, though not for ever. `decided` is told the log's position then.

    Refused (13) while a participant has lent what may still be used, which it has asked for to be given back, or an observer renders; (3) if one
    that seems alive does not say whether it suits it. `force`: nobody is asked. Then renders come to an end, and what was lent runs out before.
    """
    header = await _header(access)
    if header.mode is not mode:
        header = (await access.change_log(partial(_switching, access.name, mode), forced=force)).header
    decided(header.position)
    clock = access.calls.world.clock
    until = clock.now() + ACTIVE_S_MAX
    while True:
        shown = await _shown(access, header)
        if (shown.is_active and shown.position >= header.position) or clock.now() >= until:
            return shown
        await clock.sleep(LOOK_S)


def _switching(name: str, mode: SceneMode, log: SceneLog) -> LogEntry:
    if log.mode is mode:
        raise LocalFault(f"somebody else has switched the scene to {mode.name.lower()} mode", where=f"scene {name}")
    return SetMode(mode)


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
