"""If this failed, a stranger could fill the disk with log lines."""

from __future__ import annotations

import logging

import pytest

from scenefold.world.quiet import LINES_MAX, SILENCE_S, SOURCES_MAX, QuietLog


def test_one_line_a_minute_for_each_source_and_kind(caplog: pytest.LogCaptureFixture) -> None:
    quiet = QuietLog(logging.getLogger("test"), logging.INFO)
    with caplog.at_level(logging.INFO):
        said = [quiet.say(now, "a", "kind", "text") for now in (0.0, 1.0, SILENCE_S - 1, SILENCE_S, SILENCE_S + 1)]
        assert quiet.say(1.0, "b", "kind", "text")
        assert quiet.say(1.0, "a", "other", "text")
    assert said == [True, False, False, True, False]
    assert caplog.messages[:2] == ["a: text", "a: text (and 2 times more since the last line)"]


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
