"""A list of scenes, page by page (packets 37 and 38): headers with many members do not all fit a frame. Pure."""

from __future__ import annotations

from collections.abc import Sequence

from scenefold.base.errors import PeerFault
from scenefold.base.limits import SCENES_LISTED_MAX, SCENES_PAGE_BYTES_MAX
from scenefold.wire.own_packets import ScenesListed
from scenefold.wire.scene_headers import SceneLogPublic


def page_of(scenes: Sequence[SceneLogPublic], after: int) -> ScenesListed:
    """The answer to who knows the scenes up to `after`. `scenes`: all of them, by their ids."""
    left = [public for public in scenes if public.scene > after]
    page: list[SceneLogPublic] = []
    size = 0
    for public in left[:SCENES_LISTED_MAX]:
        size += len(public.encode())
        if page and size > SCENES_PAGE_BYTES_MAX:
            break
        page.append(public)
    return ScenesListed(scenes=tuple(page), more=len(page) < len(left))


def check_page(answer: ScenesListed, after: int, where: str) -> tuple[SceneLogPublic, ...]:
    """The scenes of a page; PeerFault if it does not go on, so that nobody is led in a circle."""
    ids = [after, *(public.scene for public in answer.scenes)]
    if ids != sorted(set(ids)) or (answer.more and len(ids) == 1):
        raise PeerFault("a list of scenes that does not go on", where=where)
    return answer.scenes
