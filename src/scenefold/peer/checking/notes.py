"""Whether what a node's services have noted can be read: its holding, its copies, its part of the cluster's log (specs/21-verify.md). Pure.

That the bytes are those that were written is looked at elsewhere. A note that cannot be read all the same would end the node at its start.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator

from scenefold.base.errors import DamagedData
from scenefold.peer.cluster_log.held_notes import READY, unpack_page, unpack_ready
from scenefold.peer.cluster_log.lives import unpack_granted, unpack_lives
from scenefold.peer.cluster_log.numbered_lives import unpack_life
from scenefold.peer.cluster_log.voted_lease import NOTE as OWN_LIFE
from scenefold.peer.copies.copies_note import decode_copies
from scenefold.peer.copies.losses_note import NOTE as LOSSES
from scenefold.peer.copies.losses_note import decode_losses
from scenefold.peer.line.holding_note import decode_holding
from scenefold.peer.membership.blacklist import decode_blacklist
from scenefold.peer.scrub.note import NOTE as SCRUB
from scenefold.peer.scrub.note import decode_round
from scenefold.peer.upkeep import NOTE as UPKEEP
from scenefold.peer.upkeep import decode_orders
from scenefold.store import StoredHolding, StoreIdentity
from scenefold.store.checking import EVERY_KEY, Finding, Helps, Sound
from scenefold.store.checking.fixes import delete
from scenefold.store.layout import HOLDING, NOTES
from scenefold.wire import MalformedPacket, Member, SceneLogPublic, unpack_log
from scenefold.world import ReadTransaction

SPARE = frozenset({LOSSES, SCRUB, UPKEEP})
"""Notes that a node can do without."""
_READERS: tuple[tuple[str, Callable[[bytes], object]], ...] = (
    (r"cluster-log/\d{8}", unpack_log),
    (r"cluster-log/header", SceneLogPublic.decode),
    (r"cluster-log/lives", unpack_lives),
    (OWN_LIFE, unpack_life),
    (r"cluster-log/life/[0-9a-f]{8}", unpack_granted),
    (r"cluster-log/held/[0-9a-f]{2}", unpack_page),
    (READY, unpack_ready),
    (r"blacklist", decode_blacklist),
    (SCRUB, decode_round),
    (UPKEEP, decode_orders),
    (LOSSES, decode_losses),
)


def check_notes(raw: ReadTransaction) -> Iterator[Finding]:
    """Of the notes of known names. `raw`: values as they stand on the disk; damaged ones are passed over."""
    for key, value in Sound(raw).scan(NOTES, *EVERY_KEY):
        name = key.decode(errors="replace")
        read = next((reader for pattern, reader in _READERS if re.fullmatch(pattern, name)), None)
        try:
            if read is not None:
                read(bytes(value))
        except (MalformedPacket, DamagedData) as problem:
            what = f"the note cannot be read: {problem}"
            yield Finding(NOTES, name, what, Helps.MEND, delete(NOTES, key)) if name in SPARE else Finding(NOTES, name, what, Helps.WIPE)


def check_holding(stored: StoredHolding, identity: StoreIdentity) -> Iterator[Finding]:
    """Whether what the line and the copies have noted can be read, and fits the arc that puts are held against."""
    if stored.note:
        try:
            if decode_holding(stored.note).arc != stored.arc:
                yield Finding(HOLDING, "note", "the note about this node's arc does not fit the arc", Helps.WIPE)
        except DamagedData as problem:
            yield Finding(HOLDING, "note", f"the note cannot be read: {problem.what} ({problem.where})", Helps.WIPE)
    if stored.copies is not None:
        try:
            decode_copies(stored.copies, Member(identity.node, identity.incarnation))
        except DamagedData as problem:
            yield Finding(HOLDING, "copies", f"the note cannot be read: {problem.what} ({problem.where})", Helps.WIPE)
