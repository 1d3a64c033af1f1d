"""If this failed, a stranger could fill the disk with log lines."""

from __future__ import annotations

import logging
from math import inf, nextafter

import pytest
from hypothesis import given
from hypothesis import strategies as some

from scenefold.world.quiet import LINES_MAX, SILENCE_S, SOURCES_MAX, QuietLog


def test_one_line_a_minute_for_each_source_and_kind(caplog: pytest.LogCaptureFixture) -> None:
    quiet = QuietLog(logging.getLogger("test"), logging.INFO)
    with caplog.at_level(logging.INFO):
        said = [quiet.say(now, "a", "kind", "text") for now in (0.0, 1.0, SILENCE_S - 1, SILENCE_S, SILENCE_S + 1)]
        assert quiet.say(1.0, "b", "kind", "text")
        assert quiet.say(1.0, "a", "other", "text")
    assert said == [True, False, False, True, False]
    assert caplog.messages[:2] == ["a: text", "a: text (and 2 times more since the last line)"]


@given(some.floats(0.0, 1e9), some.floats(0.01, 1e4))
def test_the_first_complaint_of_a_source_is_heard_whatever_the_time_and_the_bound(now: float, silence_s: float) -> None:
    quiet = QuietLog(logging.getLogger("test"), logging.DEBUG)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("scenefold.world.quiet.SILENCE_S", silence_s)
        assert quiet.say(now, "a", "kind", "text")


@given(some.floats(0.0, 1e9))
def test_who_was_left_out_of_a_full_minute_is_heard_in_the_next(now: float) -> None:
    quiet = QuietLog(logging.getLogger("test"), logging.DEBUG)
    for number in range(LINES_MAX):
        assert quiet.say(now, str(number), "kind", "text")
    assert not quiet.say(now, "late", "kind", "text")
    later = nextafter(now + SILENCE_S, inf)
    assert quiet.say(later, "late", "kind", "text")


def test_memory_is_bounded() -> None:
    quiet = QuietLog(logging.getLogger("test"), logging.DEBUG)
    for number in range(3 * SOURCES_MAX):
        quiet.say(0.0, str(number), "kind", "text")
    assert len(quiet._said) <= SOURCES_MAX


def test_sources_without_number_write_few_lines(caplog: pytest.LogCaptureFixture) -> None:
    quiet = QuietLog(logging.getLogger("test"), logging.INFO)
    with caplog.at_level(logging.INFO):
        said = [quiet.say(number / 1000, str(number), "kind", "text") for number in range(1000)]
        assert said == [True] * LINES_MAX + [False] * (1000 - LINES_MAX)
        assert quiet.say(SILENCE_S, "999", "kind", "text")
    assert caplog.messages[LINES_MAX:] == [
        f"{1000 - LINES_MAX} complaints like these, of many sources, were left out",
        "999: text (and 1 times more since the last line)",
    ]
