"""If this fails, the tables of specs/25-consensus.md, or the pictures of the documentation, are not what the code does, or cannot be read."""

from __future__ import annotations

from itertools import combinations
from xml.etree import ElementTree

import draw_consensus
import pytest
from consensus_pictures import LETTER_PX, LETTER_W

SVG = "{http://www.w3.org/2000/svg}"


def test_the_tables_of_the_specification_are_those_of_the_code() -> None:
    text = draw_consensus.SPECIFICATION.read_text(encoding="utf-8")
    assert draw_consensus.filled(text) == text, "run tools/draw_consensus.py"


def test_the_page_is_up_to_date() -> None:
    assert draw_consensus.PAGE.read_text(encoding="utf-8") == draw_consensus.page(), "run tools/draw_consensus.py"


@pytest.mark.parametrize("name", draw_consensus.DRAWINGS)
def test_the_picture_is_up_to_date(name: str) -> None:
    assert draw_consensus.DRAWINGS[name].file.read_text(encoding="utf-8") == draw_consensus.picture(name), "run tools/draw_consensus.py"


@pytest.mark.parametrize("name", draw_consensus.DRAWINGS)
def test_no_words_of_a_picture_lie_on_others_or_beside_it(name: str) -> None:
    picture = ElementTree.fromstring(draw_consensus.picture(name))
    width, height = map(float, picture.attrib["viewBox"].split()[2:])
    assert picture.findtext(f"{SVG}title") == draw_consensus.DRAWINGS[name].title
    words = [(text.text or "", float(text.attrib["x"]), float(text.attrib["y"])) for text in picture.iter(f"{SVG}text")]
    assert words
    boxes = [(x - len(text) * LETTER_W / 2, x + len(text) * LETTER_W / 2, y) for text, x, y in words]
    assert all(left >= 0 and right <= width and LETTER_PX <= y <= height - LETTER_PX / 4 for left, right, y in boxes)
    for (left, right, y), (other_left, other_right, other_y) in combinations(boxes, 2):
        assert right <= other_left or other_right <= left or abs(y - other_y) >= LETTER_PX


@pytest.mark.parametrize("name", draw_consensus.TABLES)
def test_every_guard_and_action_is_used_and_says_what_it_means(name: str) -> None:
    rows, guards, actions = draw_consensus.TABLES[name]
    assert {guard for row in rows for guard in row.given} == set(guards)
    assert {action for row in rows for action in row.do} == set(actions)
    assert all(function.__doc__ for function in (*guards.values(), *actions.values()))
