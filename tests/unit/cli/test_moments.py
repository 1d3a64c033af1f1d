"""If this fails, a frame that was asked for is another one, or is asked of what holds no frames."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from scenectl.moment_values import moment_of
from scenectl.program import main
from scenefold.scene.importers import Moment
from unit.scene.gltf_maker import Maker


@pytest.fixture
def film(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """A triangle that goes somewhere."""
    monkeypatch.delenv("SCENEFOLD_PROFILE", raising=False)
    maker = Maker()
    maker.node(mesh=maker.mesh())
    sampler = {"input": maker.accessor(np.array([0, 9], "<f4")), "output": maker.accessor(np.array([[0, 0, 0], [9, 0, 0]], "<f4"))}
    maker.add("animations", name="walk", samplers=[sampler], channels=[{"sampler": 0, "target": {"node": 0, "path": "translation"}}])
    return str(maker.write(tmp_path))


@pytest.mark.parametrize(
    ("given", "moment"),
    [
        ({}, None),
        ({"time": 0.5}, Moment(0.5)),
        ({"frame": 0}, Moment(0.0)),
        ({"frame": 12}, Moment(0.5)),
        ({"frame": 12, "fps": 30.0, "animation": "walk"}, Moment(0.4, "walk")),
    ],
)
def test_frames_and_times_are_moments(given: dict[str, float | str], moment: Moment | None) -> None:
    options = {"frame": None, "fps": None, "time": None, "animation": None} | given
    assert moment_of("here", **options) == moment  # type: ignore[arg-type]


@pytest.mark.parametrize("verb", ["render still", "scene import"])
@pytest.mark.parametrize(
    ("options", "said"),
    [
        ("--frame 1 --time 1", "a frame and a time"),
        ("--fps 24", "there is none"),
        ("--time 1 --fps 24", "there is none"),
        ("--animation walk", "no moment of it"),
        ("--time -1", "--time"),
        ("--time nan", "--time"),
        ("--frame 1 --fps 0", "--fps"),
        ("--frame 1.5", "--frame"),
    ],
)
def test_moments_that_are_none_are_wrong_usage(verb: str, options: str, said: str, film: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*verb.split(), film, *options.split()]) == 2
    told = capsys.readouterr().err
    assert said in told and told.count("\n") == 1


def test_a_scene_of_the_cluster_holds_one_moment(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["render", "still", "--scene", "fox", "--profile", "studio", "--frame", "3"]) == 2
    assert "the one moment that it was imported at" in capsys.readouterr().err


def test_an_import_hears_of_the_moment(film: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["scene", "import", film, "--dry-run", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["not_carried"] == ["animations, shown at rest (1)"]
    assert main(["scene", "import", film, "--dry-run", "--json", "--frame", "3"]) == 0
    assert json.loads(capsys.readouterr().out)["not_carried"] == []
    assert main(["scene", "import", film, "--dry-run", "--time", "3", "--animation", "fly"]) == 1
    assert "choose one of those that it has: 'walk'" in capsys.readouterr().err
