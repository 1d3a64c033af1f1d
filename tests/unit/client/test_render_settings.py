"""If this fails, what an image of a scene is by default is not what its owners have said last, or is changed under a render."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest
from trio.testing import MockClock

from scenectl.entry_text import entry_document, entry_text
from scenectl.errors import REFUSED, ending_of
from scenectl.settings import settings_text
from scenefold.base.errors import LocalFault, Refused, UsageFault
from scenefold.client.contents import camera_names
from scenefold.client.modes import set_mode
from scenefold.render.algorithms import USUAL_ALGORITHM
from scenefold.render.client import StillOptions
from scenefold.render.job import POOLS_THAT_FIT
from scenefold.render.lens import Lens
from scenefold.render.levels import Adaptive
from scenefold.render.sampling import Sampling
from scenefold.wire import PathSettings, RenderSettings, SceneMode
from unit.client.fake_council import FakeCouncil
from unit.client.test_participants import hall_of, proposals

PATHS = (
    "aperture", "focus", "sampler", "roulette_from", "clamp_direct", "clamp_indirect", "adaptive", "min_samples", "environment_rotation",
)  # fmt: skip


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
        **dict.fromkeys(PATHS),
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


async def test_how_paths_are_drawn_is_said_like_the_rest(autojump_clock: MockClock, tmp_path: Path) -> None:
    scene, _ = await hall_of(FakeCouncil(), tmp_path)
    given = {"aperture": 0.1, "focus": 2.0, "sampler": "independent", "clamp_indirect": 10.0, "adaptive": 0.05, "samples": 512}
    shown = await scene.change_render_settings(lambda said: said.changed(given))
    assert {name: value for name, value in shown.document().items() if value is not None} == {"position": shown.position, **given}
    assert ["focus", "2.0"] in [line.split() for line in settings_text(shown).splitlines()]
    assert "adaptive 0.05" in entry_text(shown.settings) and entry_document(shown.settings)["clamp_indirect"] == 10.0
    shown = await scene.change_render_settings(lambda said: said.changed({"roulette_from": 5}))
    assert shown.settings == RenderSettings(samples=512, paths=PathSettings(0.1, 2.0, "independent", 5, None, 10.0, 0.05))


async def test_what_cannot_be_said(autojump_clock: MockClock, tmp_path: Path) -> None:
    council = FakeCouncil()
    scene, _ = await hall_of(council, tmp_path, participants=0)
    for wrong, field in (
        ({"samples": 0}, "samples"),
        ({"width": 64}, "both or neither"),
        ({"sky": (1.0, -1.0, 0.0)}, "each of sky"),
        ({"depth": 33}, "depth"),
        ({"aperture": 0.1}, "aperture and focus both or neither"),
        ({"aperture": 0.1, "focus": 0.0}, "focus from 1e-06"),
        ({"sampler": "halton"}, "sampler sobol or independent"),
        ({"roulette_from": 0}, "roulette_from"),
        ({"clamp_direct": 0.0}, "clamps above 0"),
        ({"adaptive": 1.5}, "adaptive above 0"),
        ({"min_samples": 16}, "min_samples with adaptive only"),
        ({"adaptive": 0.1, "min_samples": 3}, "min_samples"),
        ({"environment_rotation": 361.0}, "environment_rotation from"),
    ):
        with pytest.raises(LocalFault, match=field):
            await scene.change_render_settings(partial(RenderSettings.changed, given=wrong))
    with pytest.raises(KeyError, match="size"):
        RenderSettings().changed({"size": 1})
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
    paths = RenderSettings(samples=512, paths=PathSettings(0.1, 2.0, "independent", 5, 3.0, 4.0, 0.05, 32, 90.0))
    told = StillOptions().checked(paths)
    assert (told.lens, told.sampling, told.adaptive) == (Lens(0.1, 2.0), Sampling("independent", 5, 3.0, 4.0), Adaptive(0.05, 32))
    assert told.environment_rotation == 90.0
    own = StillOptions(aperture=0.2, focus=3.0, sampler="sobol", clamp_direct=9.0, adaptive=0.1, environment_rotation=0.0).checked(paths)
    assert (own.lens, own.sampling, own.adaptive) == (Lens(0.2, 3.0), Sampling("sobol", 5, 9.0, 4.0), Adaptive(0.1))
    assert own.environment_rotation == 0.0
    assert StillOptions(ignore_settings=True).checked(paths) == StillOptions().checked()
    with pytest.raises(UsageFault, match="samples is 0"):
        StillOptions(samples=0).checked(said)


def test_who_says_how_cells_shall_be_has_one_pool_and_else_there_are_as_many_as_can_be() -> None:
    assert StillOptions().checked().pools == StillOptions(pools=POOLS_THAT_FIT, algorithm="kd").checked().pools == POOLS_THAT_FIT
    assert StillOptions().checked().algorithm == USUAL_ALGORITHM
    for said in (StillOptions(algorithm=USUAL_ALGORITHM), StillOptions(fixed_cells=True), StillOptions(skip_empty=True)):
        assert said.checked().pools == 1
        assert replace(said, pools=3).checked().pools == 3
