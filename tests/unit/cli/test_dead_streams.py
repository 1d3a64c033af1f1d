"""If this fails, an error that cannot be printed shows a traceback, ends under another exit code, or loses the object that scripts read."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from scenectl.errors import STANDARD_OUTPUT, ending_of
from scenectl.output import writing_to

UNKNOWN = b'error: Unknown command "foo" (scenectl): see `scenectl --help`\n'
NO_PROFILE = ("key", "show", "--profile", "nowhere", "--json")

pytestmark = pytest.mark.skipif(not Path("/dev/full").exists(), reason="only Linux has /dev/full")


def ended(command: str, *arguments: str, unbuffered: str = "") -> subprocess.CompletedProcess[bytes]:
    """`command`: of a shell, in which "$@" is the program."""
    environment = os.environ | {"PYTHONUNBUFFERED": unbuffered}
    shell = ["/bin/bash", "-c", f"set -o pipefail; {command}", "bash", sys.executable, "-m", "scenectl", *arguments]
    return subprocess.run(shell, capture_output=True, timeout=60, env=environment)


@pytest.mark.parametrize("unbuffered", ["", "1"])
def test_an_object_that_finds_no_room_leaves_the_error_as_it_is(unbuffered: str) -> None:
    for arguments, code in ((NO_PROFILE, 1), (("foo", "--json"), 2)):
        done = ended('"$@" >/dev/full', *arguments, unbuffered=unbuffered)
        assert done.returncode == code
        assert done.stderr.startswith(b"error: ") and done.stderr.count(b"\n") == 1, done.stderr


def test_who_does_not_read_the_object_of_an_error_has_left() -> None:
    done = ended('"$@" | (exec <&-; sleep 2)', "foo", "--json")
    assert (done.returncode, done.stderr) == (141, UNKNOWN)


@pytest.mark.parametrize("unbuffered", ["", "1"])
def test_a_line_that_finds_no_room_costs_neither_exit_code_nor_object(unbuffered: str) -> None:
    done = ended('"$@" 2>/dev/full', "foo", "--json", unbuffered=unbuffered)
    assert done.returncode == 2
    assert json.loads(done.stdout)["exit_code"] == 2


@pytest.mark.parametrize("unbuffered", ["", "1"])
def test_a_page_that_finds_no_room_names_standard_output(unbuffered: str) -> None:
    done = ended('"$@" >/dev/full', "scene", "--help", unbuffered=unbuffered)
    assert done.returncode == 1
    assert done.stderr == b"error: No space left on device (standard output): send it to where there is room, or to /dev/null\n"


def test_an_error_of_the_system_names_the_stream_and_says_what_to_do() -> None:
    with pytest.raises(OSError) as full, writing_to(STANDARD_OUTPUT):
        raise OSError(28, "No space left on device")
    assert ending_of(full.value).where == "standard output"
    for error in (OSError(28, "No space left on device", "/x"), OSError(5, "Input/output error")):
        assert ending_of(error).remedy
