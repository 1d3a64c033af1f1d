"""If this fails, somebody renders by what a node answered that may still take edits (specs/26-modes.md, What storage nodes do in render mode)."""

from __future__ import annotations

from pathlib import Path

import pytest
from trio.testing import MockClock

from scenefold.base.errors import Refused
from scenefold.base.location import Location
from scenefold.base.reasons import RejectReason
from scenefold.wire import SceneMode, SetMode
from unit.client.fake_nodes import FakeNodes
from unit.client.test_spaces import scene_of

PLACE = Location.from_number(77)


async def test_in_render_mode_an_answer_of_before_is_none(autojump_clock: MockClock, tmp_path: Path) -> None:
    nodes = FakeNodes()
    scene = await scene_of(nodes, tmp_path)
    await scene.space(10).put(PLACE, b"record")
    nodes.behind = {owner.address for owner in nodes.table.owners}
    assert (await scene.space(10).get(PLACE)) is not None, "in edit mode nobody asks"
    await scene.access.change_log(lambda _: SetMode(SceneMode.RENDER))
    with pytest.raises(Refused, match="render mode") as refused:
        await scene.space(10).get(PLACE)
    assert refused.value.reason is RejectReason.NOT_READY
    nodes.behind = set()
    assert (await scene.space(10).get(PLACE)) is not None
