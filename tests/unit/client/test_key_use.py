"""If this fails, a client seals under one key until two of its random nonces are likely to be equal."""

from __future__ import annotations

from dataclasses import replace

import pytest
from trio.testing import MockClock

from scenefold.base.errors import LocalFault
from scenefold.base.location import FIRST
from scenefold.client import key_use
from scenefold.client.access import SceneAccess
from scenefold.client.key_use import SEALED_MAX, KeyUse
from scenefold.client.scene import Scene
from scenefold.scene.log import EpochKeys
from unit.client.fake_nodes import FakeNodes
from unit.client.test_records import FILES, ITEMS, _scene

KITCHEN = b"k" * 32


def test_a_run_is_held_to_its_part_of_what_a_key_is_good_for() -> None:
    use = KeyUse()
    use.take(KITCHEN, 3, SEALED_MAX, "scene kitchen")
    with pytest.raises(LocalFault, match="sealed under one key") as caught:
        use.take(KITCHEN, 3, 1, "scene kitchen")
    assert caught.value.where == "scene kitchen" and "rotate-key" in caught.value.remedy
    use.take(KITCHEN, 4, SEALED_MAX, "scene kitchen")
    use.take(b"h" * 32, 3, SEALED_MAX, "scene hall")


async def test_everything_that_is_sealed_counts_and_a_new_key_begins_anew(
    autojump_clock: MockClock, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(key_use, "SEALED_MAX", len(ITEMS) + 1)
    nodes = FakeNodes()
    scene = _scene(nodes)
    await scene.space(FILES).put_many(ITEMS)
    await scene.space(FILES).put(FIRST, b"the last one")
    asked = len(nodes.asked)
    with pytest.raises(LocalFault, match="sealed under one key"):
        await scene.space(FILES).put(FIRST, b"one more")
    assert len(nodes.asked) == asked, "it is refused before anything is sent"
    renewed = replace(scene.access.identity, keys=EpochKeys({0: bytes(24), 1: b"1" * 24}), key_epoch=1)
    await Scene(replace(scene.access, identity=renewed)).space(FILES).put(FIRST, b"under the new one")


async def test_a_scene_that_is_opened_again_goes_on_counting(autojump_clock: MockClock, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(key_use, "SEALED_MAX", 2)
    first = _scene(FakeNodes()).access
    for number in range(2):
        again = Scene(SceneAccess(first.calls, "kitchen", first.identity, first.writer, session=2 + number))
        await again.space(FILES).put(FIRST, b"%d" % number)
    with pytest.raises(LocalFault, match="sealed under one key"):
        await Scene(first).space(FILES).put(FIRST, b"one more")
