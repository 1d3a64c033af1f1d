"""May this public scene header be believed? (consensus.md, sections 3 and 7; specs/16-scene-log.md, The public header.) Pure.

A header vouches for itself: the scene's name for ever (genesis) is a hash of the first header, of the key that signed it and of that
which decides. From the first key each one that followed was signed by the one before; and that the scene's log came to this header,
and to no other, those who decide have signed. So a node can keep and pass on headers of scenes that it has no key of, whichever
of them it meets first, and whoever shows it.
"""

from __future__ import annotations

from scenefold.base.errors import DamagedData, Refused
from scenefold.base.reasons import RejectReason
from scenefold.crypto import HEADER_DOMAIN, PublicKey, key_id_of
from scenefold.peer.records.verification import KnownScene
from scenefold.scene.log.certified import began_with
from scenefold.scene.log.decisions import check_decided
from scenefold.scene.log.roster import unlawful
from scenefold.scene.log.succession import header_key_now, proven_header_key
from scenefold.wire import SceneLogPublic, SceneMode

FIRST_POSITION = 1


def checked_header(public: SceneLogPublic, known: KnownScene | None) -> KnownScene:
    """The scene with this header, if it was decided, and may follow what is known of the scene; Refused otherwise.

    Takes some 200 microseconds.
    """
    scene = checked_proposal(public, known)
    try:
        check_decided(public)
    except DamagedData as problem:
        raise Refused(RejectReason.SIGNATURE_INVALID, str(problem)) from problem
    if known is not None and began_with(known.public) not in (b"", began_with(public)):
        raise Refused(RejectReason.NOT_AUTHORISED, "the header names others whom its origin had decide first")
    return scene


def checked_proposal(public: SceneLogPublic, known: KnownScene | None) -> KnownScene:
    """Likewise of a header that need not be decided yet."""
    if public.scene != int.from_bytes(public.genesis[:4], "big"):
        raise Refused(RejectReason.ILL_FORMED, "the scene id is not the beginning of its genesis hash")
    if public.position <= FIRST_POSITION and public.with_genesis() != public:
        raise Refused(RejectReason.ILL_FORMED, "the genesis is not the hash of this first header")
    _check_positions(public)
    unfit = unlawful(public.participants, public.observers)
    if unfit:
        raise Refused(RejectReason.ILL_FORMED, unfit)
    expected = _check_alone(public) if known is None else _check_follows(public, known)
    try:
        scene = KnownScene.of(public)
    except DamagedData as problem:
        raise Refused(RejectReason.ILL_FORMED, str(problem)) from problem
    key = scene.keys.get(public.public_key)
    if public.succession and key_id_of(public.succession[-1].key) != public.public_key:
        raise Refused(RejectReason.ILL_FORMED, "the header is not signed by the newest of its header keys")
    if key is None:
        raise Refused(RejectReason.ILL_FORMED, "the header lacks the key that it is signed with")
    if key != expected:
        raise Refused(RejectReason.NOT_AUTHORISED, "the header names another key by the id of the scene's header key")
    try:
        key.verify(public.signature, HEADER_DOMAIN, public.signable())
    except DamagedData as problem:
        raise Refused(RejectReason.SIGNATURE_INVALID, str(problem)) from problem
    return scene


def _check_positions(public: SceneLogPublic) -> None:
    """Refused (5) for one that bears a position which it cannot have, whatever is known of the scene."""
    if public.write_floor > public.position:
        raise Refused(
            RejectReason.ILL_FORMED, "the write floor is a position that the log has not come to: nothing could be written any more"
        )
    if public.purged > public.write_floor:
        raise Refused(RejectReason.ILL_FORMED, "what was signed before the purge began could still be written")
    if public.mode is SceneMode.ENDED and not FIRST_POSITION < public.position == public.write_floor:
        raise Refused(RejectReason.ILL_FORMED, "a scene ends at the position of its last header, and not at its first one")
    if any(not entry.parent and entry.offset.number > public.position for entry in public.spaces):
        raise Refused(RejectReason.ILL_FORMED, "copies changed at a position that the log has not come to")


def _check_alone(public: SceneLogPublic) -> PublicKey:
    """The key that must have signed it, for who knows no header of the scene."""
    try:
        return proven_header_key(public)
    except DamagedData as problem:
        raise Refused(RejectReason.ILL_FORMED, str(problem)) from problem


def _check_follows(public: SceneLogPublic, scene: KnownScene) -> PublicKey:
    """The key that must have signed it. Ids are short, and somebody may have searched for a key of this very id."""
    known = scene.public
    if public.genesis != known.genesis:
        raise Refused(RejectReason.POSITION_TAKEN, "another scene has this id here")
    if (public.birth, public.first_key, public.origin_key) != (known.birth, known.first_key, known.origin_key):
        raise Refused(RejectReason.ILL_FORMED, "the header does not show how its scene began")
    if known.participants and not public.participants and public.position >= known.position:
        raise Refused(RejectReason.NOT_AUTHORISED, "the header forgets that others than its origin decide")
    if public.origin != known.origin:
        raise Refused(RejectReason.NOT_AUTHORISED, "the header names another origin than the one before")
    if [term.key for term in public.writers[:1]] != [term.key for term in known.writers[:1]]:
        raise Refused(RejectReason.ILL_FORMED, "the header names another maker of the scene than the one before")
    key = _header_key(public, known, scene.keys[known.public_key])
    if any(getattr(public, name) < getattr(known, name) for name in ("position", "write_floor", "key_epoch", "purged")):
        raise Refused(RejectReason.POSITION_BEHIND, f"the scene's log is at position {known.position} already")
    if public.position == known.position and public.signable() != known.signable():
        raise Refused(RejectReason.POSITION_TAKEN, f"position {known.position} is decided otherwise")
    check_goes_on(known, public.position)
    return key


def check_goes_on(known: SceneLogPublic, position: int) -> None:
    """Refused (9) for what would follow the end of a scene."""
    if known.mode is SceneMode.ENDED and position > known.position:
        what = f"the scene was ended at position {known.position}: nothing follows"
        raise Refused(RejectReason.MODE_FORBIDS, what, remedy="make another scene")


def _header_key(public: SceneLogPublic, known: SceneLogPublic, key: PublicKey) -> PublicKey:
    """The scene's header key as of this header. An older header is behind, and an owner who was revoked may have signed it: both are refused, the first without a word of blame."""
    if public.position < known.position and known.succession[: len(public.succession)] == public.succession:
        return key
    if public.succession[: len(known.succession)] != known.succession:
        raise Refused(RejectReason.NOT_AUTHORISED, "the header forgets a change of the key that signs it")
    if any(step.position <= known.position for step in public.succession[len(known.succession) :]):
        raise Refused(RejectReason.NOT_AUTHORISED, "the header's key changed at a position that was decided otherwise")
    try:
        return header_key_now(public, key)
    except DamagedData as problem:
        raise Refused(RejectReason.NOT_AUTHORISED, str(problem)) from problem
