"""May this node be granted a lease at this position? (specs/26-modes.md, Leases.)"""

from __future__ import annotations

from enum import Enum

from scenefold.peer.modes.scene import DecidedScene
from scenefold.wire import Member


class Verdict(Enum):
    """What a question for a lease is answered."""

    GRANT = "a GRANT"
    LACKS_LOG = "what was decided since: a SetMode, or a change of those who decide"
    NOT_HERE_YET = "nothing: what the asker knows is not here yet"
    OPEN = "nothing: what is accepted at the next position would end leases"
    SILENT = "nothing: this node does not decide the next position"
    STRANGER = "12: the asker takes no part at the next position, or in another life"


def verdict(scene: DecidedScene, me: Member, asker: Member, have: int, *, steady_since: int, ends_leases: bool) -> Verdict:
    """`me`: as whom this node decides; somebody else where it must not say anything. `steady_since`: the position behind which neither the mode
    nor those who decide were changed. `ends_leases`: what is accepted at the next position may change one of these, or who observes."""
    if have > scene.position:
        return Verdict.NOT_HERE_YET
    if have < steady_since:
        return Verdict.LACKS_LOG
    if me not in scene.participants:
        return Verdict.SILENT
    if asker not in scene.everyone:
        # Who is behind may have missed its own removal.
        return Verdict.STRANGER if have == scene.position else Verdict.LACKS_LOG
    return Verdict.OPEN if ends_leases else Verdict.GRANT
