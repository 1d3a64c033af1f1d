"""The headers of a cluster, and what they hold for one member: scenes that somebody granted. Plain functions for a worker thread.

A gift says of itself what it is called and who gave it. That it is so must be checked with the giver's card (Scenes): every public key is
known to all, and whoever has one can seal something to it.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from typing import NamedTuple

from scenefold.base.errors import DamagedData
from scenefold.client.births import verified_header_key
from scenefold.crypto import SealingKey
from scenefold.scene.log import Contents, own_lockbox
from scenefold.wire import Lockbox, SceneLogPublic

_log = logging.getLogger("scenefold.client")


class Gift(NamedTuple):
    """A lockbox that opens for us, and the header that it lies in."""

    header: SceneLogPublic
    lockbox: Lockbox
    contents: Contents


def believed(headers: Sequence[SceneLogPublic]) -> list[SceneLogPublic]:
    """Those that prove to be of their scenes, and to have been decided. The others are left out: a list shows the rest."""
    good = []
    for header in headers:
        try:
            verified_header_key(header)
            good.append(header)
        except DamagedData as problem:
            _log.warning("scene %08x: its header is not believed: %s", header.scene, problem)
    return good


def gifts_in(headers: Sequence[SceneLogPublic], sealing: SealingKey) -> list[Gift]:
    """What opens. What is damaged, or not signed by the header key that it speaks of, or never decided, is left out likewise."""
    gifts = []
    for header in headers:
        try:
            found = own_lockbox(header, sealing)
            if found is not None:
                if verified_header_key(header) != found[1].header_key:
                    raise DamagedData("it speaks of another header key than the scene's")
                gifts.append(Gift(header, *found))
        except DamagedData as problem:
            _log.warning("scene %08x: what it holds for us is not believed: %s", header.scene, problem)
    return gifts
