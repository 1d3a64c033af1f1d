"""If this fails, a lying peer writes to the user's terminal what it likes: colours, titles, whole lines."""

from __future__ import annotations

import json
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenefold.base.printable import CHARACTERS_MAX, printable, printable_json, printable_lines

STEERING = "".join(
    map(chr, [*range(32), *range(0x7F, 0xA0), 0x061C, *range(0x200B, 0x2010), *range(0x2028, 0x202F), *range(0x2060, 0x2070), 0xFEFF])
)
"""Controls, escapes, marks of direction, separators of lines."""
ANY = st.text(st.characters() | st.sampled_from(STEERING) | st.characters(categories=["Cs"]))


def test_what_a_terminal_acts_on_is_not_passed_on() -> None:
    assert printable("\x1b]0;owned\x07\x1b[31mno\u202egnp\r\n") == r"\x1b]0;owned\x07\x1b[31mno\u202egnp\r\n"
    assert printable("kein Platz für – «mehr» 空") == "kein Platz für – «mehr» 空"
    assert not any(char.isprintable() for char in STEERING)


def test_of_too_long_a_text_it_is_seen_that_it_was_cut() -> None:
    assert printable("x" * CHARACTERS_MAX) == "x" * CHARACTERS_MAX
    assert printable("x" * (CHARACTERS_MAX + 1)) == "x" * (CHARACTERS_MAX - 1) + "…"


@given(ANY, st.integers(1, 50))
def test_what_comes_out_is_printable_and_short(text: str, most: int) -> None:
    shown = printable(text, most)
    assert shown.isprintable() and len(shown) <= most
    assert printable(shown, most) == shown


@given(st.lists(ANY.map(lambda text: text.replace("\n", ""))))
def test_lines_stay_lines_and_nothing_else_gets_through(lines: list[str]) -> None:
    shown = printable_lines("\n".join(lines)).split("\n")
    assert len(shown) == max(1, len(lines))
    assert all(line.isprintable() for line in shown)


@given(st.recursive(ANY | st.integers() | st.none(), lambda inner: st.lists(inner) | st.dictionaries(ANY, inner)))
def test_json_says_the_same_and_steers_no_terminal(document: object) -> None:
    shown = printable_json(document, indent=2)
    assert json.loads(shown) == document
    assert shown.replace("\n", "").isprintable()


@pytest.mark.parametrize("value", [math.inf, -math.inf, math.nan])
def test_what_json_has_no_number_for_is_null(value: float) -> None:
    """`Infinity` is no JSON: `jq` would end, and so would whatever reads all of the output for one number of it."""
    shown = printable_json({"a": [1.5, value, {"b": (value,)}], "c": "\x1b"})
    assert json.loads(shown, parse_constant=pytest.fail) == {"a": [1.5, None, {"b": [None]}], "c": "\x1b"}
