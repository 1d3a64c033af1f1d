"""If this fails, a node writes keys into its log when something goes wrong."""

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
