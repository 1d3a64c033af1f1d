"""If this fails, a cluster with many scenes, or with many members of each, cannot list them."""

from __future__ import annotations

from dataclasses import replace

import pytest

from scenefold.base.errors import PeerFault
from scenefold.base.ids import KeyId, SceneId
from scenefold.base.limits import SCENES_LISTED_MAX
from scenefold.wire import Lockbox, SceneLogPublic, ScenesListed, check_page, encode_frame, page_of
from unit.peer.scenes_made import first_header

HEADER = first_header()


def scene(number: int, members: int) -> SceneLogPublic:
    lockboxes = tuple(Lockbox(KeyId(member), bytes(384), bytes(384)) for member in range(members))
    return replace(HEADER, scene=SceneId(number), lockboxes=lockboxes)


@pytest.mark.parametrize(("count", "members", "pages"), [(0, 0, 1), (1, 128, 1), (SCENES_LISTED_MAX, 1, 1), (SCENES_LISTED_MAX, 128, 25)])
def test_all_scenes_are_listed_in_pages_that_fit_a_frame(count: int, members: int, pages: int) -> None:
    scenes = [scene(7 * number + 3, members) for number in range(count)]
    listed: list[SceneLogPublic] = []
    turns, more = 0, True
    while more:
        after = listed[-1].scene if listed else 0
        page = page_of(scenes, after)
        encode_frame(page)
        listed += check_page(page, after, "here")
        more, turns = page.more, turns + 1
    assert listed == scenes
    assert turns == pages


@pytest.mark.parametrize(
    "page",
    [
        ScenesListed(scenes=(), more=True),
        ScenesListed(scenes=(scene(5, 0),)),
        ScenesListed(scenes=(scene(9, 0), scene(8, 0))),
        ScenesListed(scenes=(scene(9, 0), scene(9, 0))),
    ],
    ids=["nothing, and more", "known already", "backwards", "twice"],
)
def test_a_list_that_leads_in_a_circle_is_no_list(page: ScenesListed) -> None:
    with pytest.raises(PeerFault, match="does not go on"):
        check_page(page, 5, "here")
