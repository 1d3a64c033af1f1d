"""When the key changes that signs a scene's headers: each key names the one that follows it (specs/16-scene-log.md, Succession). Pure.

An owner has the header key. If one is revoked, another owner makes a new key, and signs with the old one that it follows. So
whoever knows any header key of the scene can tell which one is right now, and a revoked owner's headers count no longer.
"""

from __future__ import annotations

from itertools import pairwise

from scenefold.base.errors import DamagedData
from scenefold.crypto import PublicKey, SigningKey
from scenefold.wire import SceneLogPublic, Succession

SUCCESSION_DOMAIN = b"scenefold/succession"


def succeeded(before: SigningKey, after: PublicKey, genesis: bytes, position: int) -> Succession:
    """The word of one header key for the next."""
    return Succession(position, after.raw, before.sign(SUCCESSION_DOMAIN, _message(genesis, position, after.raw)))


def header_key_now(public: SceneLogPublic, known: PublicKey) -> PublicKey:
    """The key that the header must be signed with, for whoever knows that `known` was the scene's header key once.

    DamagedData if the header's succession does not lead on from it to the key that the header names.
    """
    where = f"scene {public.scene:08x}"
    steps = public.succession
    if not _is_ordered(public):
        raise DamagedData("the header's succession of keys is out of order", where=where)
    begin = next((index + 1 for index, step in enumerate(steps) if step.key == known.raw), 0)
    key = known
    for step in steps[begin:]:
        key.verify(step.signature, SUCCESSION_DOMAIN, _message(public.genesis, step.position, step.key))
        key = PublicKey(step.key)
    if key.key_id != public.public_key:
        raise DamagedData("the header is signed with another key than the scene's", where=where)
    return key


def proven_header_key(public: SceneLogPublic) -> PublicKey:
    """The key that the header must be signed with, for whoever knows nothing but the scene's genesis; DamagedData if the header
    does not lead on from there."""
    if public.proven_genesis() != public.genesis or public.scene != int.from_bytes(public.genesis[:4], "big"):
        raise DamagedData("the header does not show how its scene began", where=f"scene {public.scene:08x}")
    return header_key_now(public, PublicKey(public.first_key))


def _is_ordered(public: SceneLogPublic) -> bool:
    steps = public.succession
    if not steps:
        return True
    rises = all(one.position < next_.position for one, next_ in pairwise(steps))
    return rises and steps[0].position > 1 and steps[-1].position <= public.position and len({step.key for step in steps}) == len(steps)


def _message(genesis: bytes, position: int, key: bytes) -> bytes:
    return b"".join((genesis, position.to_bytes(8, "big"), key))
