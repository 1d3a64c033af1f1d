"""If this fails, docs/gallery.md names other scenes, authors or commands than those that `make gallery` renders."""

from __future__ import annotations

from pathlib import Path

import gallery_page
from gallery_scenes import LEFT_OUT, SHOWN
from gallery_sheet import SHEET

ROOT = Path(__file__).resolve().parents[2]


def test_the_page_is_that_of_the_list() -> None:
    assert (ROOT / gallery_page.PAGE).read_text(encoding="utf-8") == gallery_page.page(), "run make gallery"
    assert (ROOT / SHEET).stat().st_size < 1_500_000


def test_each_scene_has_an_author_and_a_licence_and_none_is_left_out_besides() -> None:
    assert all(scene.author and scene.licence for scene in SHOWN)
    assert len({scene.slug for scene in SHOWN}) == len(SHOWN)
    assert not {scene.file.partition("/")[0] for scene in SHOWN if scene.is_shared} & LEFT_OUT.keys()
    assert all(LEFT_OUT.values())
