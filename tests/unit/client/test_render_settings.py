"""If this fails, what an image of a scene is by default is not what its owners have said last, or is changed under a render."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest
from trio.testing import MockClock

from scenectl.errors import REFUSED, ending_of
from scenectl.settings import settings_text
from scenefold.base.errors import LocalFault, Refused, UsageFault
from scenefold.client.contents import camera_names
from scenefold.client.modes import set_mode
from scenefold.render.client import StillOptions
from scenefold.wire import RenderSettings, SceneMode
from unit.client.fake_council import FakeCouncil
from unit.client.test_participants import hall_of, proposals


async def test_what_is_said_stays_until_something_else_is(autojump_clock: MockClock, tmp_path: Path) -> None:
    council = FakeCouncil()
    scene, _ = await hall_of(council, tmp_path)
    shown = await scene.render_settings()
    assert shown.settings == RenderSettings() and shown.position == council.newest(scene.id).position
    assert settings_text(shown) == "The scene does not say what an image of it is by default."
    await scene.change_render_settings(partial(replace, width=64, height=32, sky=(0.5, 0.0, 1.0)))
    shown = await scene.change_render_settings(partial(replace, samples=16, exposure=-0.5))
    assert shown.settings == RenderSettings(64, 32, 16, None, (0.5, 0.0, 1.0), -0.5)
    document = shown.document()
    assert document == {
        "position": shown.position,
        "width": 64,
        "height": 32,
        "samples": 16,
        "depth": None,
        "sky": [0.5, 0.0, 1.0],
        "exposure": -0.5,
        "camera": None,
    }
    assert [line.split() for line in settings_text(shown).splitlines()[1:]][2:] == [
        ["samples", "16"],
        ["sky", "0.5,0,1"],
        ["exposure", "-0.5"],
    ]
    before = len(proposals(council))
    assert (await scene.change_render_settings(partial(replace, samples=16))).position == shown.position
    assert len(proposals(council)) == before, "nothing is decided that changes nothing"
    assert (await scene.change_render_settings(lambda _: RenderSettings())).settings == RenderSettings()


async def test_what_cannot_be_said(autojump_clock: MockClock, tmp_path: Path) -> None:
    council = FakeCouncil()
    scene, _ = await hall_of(council, tmp_path, participants=0)
    for wrong, field in (
        ({"samples": 0}, "samples"),
        ({"width": 64}, "both or neither"),
        ({"sky": (1.0, -1.0, 0.0)}, "each of sky"),
        ({"depth": 33}, "depth"),
    ):
        with pytest.raises(LocalFault, match=field):
            await scene.change_render_settings(partial(replace, **wrong))
    await set_mode(scene.access, SceneMode.RENDER)
    with pytest.raises(Refused, match=r"changes in edit mode alone .*switch the scene back to edit mode first") as refused:
        await scene.change_render_settings(partial(replace, samples=2))
    assert ending_of(refused.value).exit_code == REFUSED, "as whatever else the mode forbids"
    assert (await scene.render_settings()).settings == RenderSettings()


async def test_a_camera_is_one_that_the_scene_has_once_it_has_any(autojump_clock: MockClock, tmp_path: Path) -> None:
    scene, _ = await hall_of(FakeCouncil(), tmp_path)
    assert (await scene.change_render_settings(partial(replace, camera="door"))).settings.camera == "door"
    file = tmp_path / "tetrahedron.obj"
    file.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\n")
    await scene.import_file(file)
    (name,) = await camera_names(scene.access) or []
    with pytest.raises(LocalFault, match=f"the scene has no camera 'nope' .*choose one of: '{name}'"):
        await scene.change_render_settings(partial(replace, camera="nope"))
    assert (await scene.change_render_settings(partial(replace, samples=2))).settings.camera == "door", "of before there was any"
    assert (await scene.change_render_settings(partial(replace, camera=name))).settings.camera == name


def test_who_renders_has_the_last_word() -> None:
    said = RenderSettings(64, 32, 16, 3, (0.5, 0.0, 1.0), camera="door")
    plain = StillOptions().checked()
    assert (plain.width, plain.height, plain.samples, plain.depth, plain.sky, plain.camera) == (640, 360, 64, 8, (0.0, 0.0, 0.0), None)
    told = StillOptions().checked(said)
    assert (told.width, told.height, told.samples, told.depth, told.sky, told.camera) == (64, 32, 16, 3, (0.5, 0.0, 1.0), "door")
    own = StillOptions(width=8, height=4, samples=1, depth=2, sky=(0.0, 0.0, 0.0), camera="window").checked(said)
    assert (own.width, own.height, own.samples, own.depth, own.sky, own.camera) == (8, 4, 1, 2, (0.0, 0.0, 0.0), "window")
    usual = StillOptions(samples=1, ignore_settings=True)
    assert usual.checked(said) == StillOptions(samples=1).checked() and usual.heeded(said).exposure is None
    with pytest.raises(UsageFault, match="samples is 0"):
        StillOptions(samples=0).checked(said)
