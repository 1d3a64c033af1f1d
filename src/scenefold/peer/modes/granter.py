"""May this node be granted a lease at this position? (specs/26-modes.md, Leases.)"""

from __future__ import annotations

from enum import Enum

from scenefold.peer.modes.scene import DecidedScene
from scenefold.wire import Member


class Verdict(Enum):
    """What a question for a lease is answered."""

    GRANT = "a GRANT"
    LACKS_LOG = "what was decided since"
    NOT_HERE_YET = "nothing: what the asker knows is not here yet"
    OPEN = "nothing: something is accepted at the next position"
    SILENT = "nothing: this node does not decide the next position"
    STRANGER = "12: the asker takes no part at the next position, or in another life"


def verdict(scene: DecidedScene, me: Member, asker: Member, have: int, *, has_accepted: bool) -> Verdict:
    """`me`: as whom this node decides; somebody else where it must not say anything. `has_accepted`: at the next position."""
    if have != scene.position:
        return Verdict.LACKS_LOG if have < scene.position else Verdict.NOT_HERE_YET
    if me not in scene.participants:
        return Verdict.SILENT
    if asker not in scene.everyone:
        return Verdict.STRANGER
    return Verdict.OPEN if has_accepted else Verdict.GRANT
