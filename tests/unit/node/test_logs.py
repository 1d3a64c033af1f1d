"""If this fails, a node writes keys into its log when something goes wrong, or whatever a peer says to the terminal that shows it."""

from __future__ import annotations

import subprocess
import sys

import pytest

MARKER = "MARKER-of-a-scene-key"
PROGRAM = f"""
import logging
from scenefold.node.logs import set_up_logs
set_up_logs({{form!r}}, "info")
def fails(key):
    held = [key]
    raise OverflowError("a bug")
def outer():
    secret = "".join(reversed({MARKER[::-1]!r}))
    try:
        fails(secret)
    except OverflowError as error:
        raise ValueError("on top of it") from error
try:
    outer()
except ValueError as error:
    logging.getLogger("scenefold").critical("internal error", exc_info=error)
"""


@pytest.mark.parametrize("form", ["console", "json"])
def test_a_traceback_tells_where_and_no_values(form: str) -> None:
    done = subprocess.run([sys.executable, "-c", PROGRAM.format(form=form)], capture_output=True, text=True, check=True, timeout=60)
    assert "internal error" in done.stderr and "OverflowError: a bug" in done.stderr and "in fails" in done.stderr
    assert MARKER not in done.stderr


STEERING = "\x1b]0;owned\x07\x9b2J\u202edecided\r\n2026-01-01 [info] all is well"
TOLD = f"""
import logging
from scenefold.node.logs import set_up_logs
set_up_logs({{form!r}}, "info")
logging.getLogger("scenefold").warning("job %s failed: %s", 7, {STEERING!r})
try:
    raise ValueError({STEERING!r})
except ValueError as error:
    logging.getLogger("scenefold").error("a bug", exc_info=error)
logging.getLogger("scenefold").warning("%s", "x" * 100_000)
"""


@pytest.mark.parametrize("form", ["console", "json"])
def test_words_of_others_steer_no_terminal_that_shows_the_log(form: str) -> None:
    done = subprocess.run([sys.executable, "-c", TOLD.format(form=form)], capture_output=True, check=True, timeout=60)
    lines = done.stderr.decode().split("\n")
    assert all(line.isprintable() for line in lines)
    assert "owned" in lines[0] and "all is well" in lines[0], "what was said on one line is shown on one"
    assert max(map(len, lines)) < 5_000
