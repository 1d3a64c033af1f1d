"""A scene in a real cluster, made by hand: by the profile's user, for the first voter to decide."""

from __future__ import annotations

from typing import Any

from scenefold.crypto import SigningKey
from scenefold.wire import KeyEntry, SceneLogPublic, WriterEntry
from scenefold.world.profile import ClusterProfile
from unit.peer.scenes_made import FOR_EVER, HEADER_KEY, WRITER, first_header


def decider_of(profile: ClusterProfile) -> SigningKey:
    """The key of the node that decides."""
    return profile.node_secrets(profile.voter.address).signing


def scene_in(profile: ClusterProfile, **changes: Any) -> SceneLogPublic:
    """A valid first header, decided; its maker lets WRITER write."""
    maker = profile.user_secrets().signing
    fields: dict[str, Any] = {
        "origin": profile.voter.node_id,
        "keys": tuple(KeyEntry(1, key.public.raw) for key in (HEADER_KEY, maker, WRITER)),
        "writers": tuple(WriterEntry(key.key_id, 0, FOR_EVER) for key in (maker, WRITER)),
        **changes,
    }
    return first_header(maker, decider_of(profile), **fields)
