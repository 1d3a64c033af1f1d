"""If this fails, a lying peer writes to the user's terminal what it likes: colours, titles, whole lines."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from scenefold.base.printable import CHARACTERS_MAX, printable


def test_what_a_terminal_acts_on_is_not_passed_on() -> None:
    assert printable("\x1b]0;owned\x07\x1b[31mno\u202egnp\r\n") == "?]0;owned??[31mno?gnp??"
    assert printable("kein Platz für – «mehr» 空") == "kein Platz für – «mehr» 空"


@given(st.text())
def test_what_comes_out_is_printable_and_short(text: str) -> None:
    assert printable(text).isprintable() and len(printable(text)) <= CHARACTERS_MAX
