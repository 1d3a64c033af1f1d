"""If this fails, Ctrl-C or a supervisor's SIGTERM in the first moment of a program ends it with a traceback, without a word, or as a failure."""

from __future__ import annotations

import json
import signal
import subprocess
import sys

import pytest

from scenectl.__main__ import INTERRUPTED, RESULT, WORDS
from scenectl.errors import ending_of

STRUCK = """
import os, runpy, sys
class Striking:
    def find_spec(self, name, path=None, target=None):
        if name == {module!r}:
            os.kill(os.getpid(), {number})
sys.meta_path.insert(0, Striking())
sys.argv[1:] = {arguments!r}
runpy.run_module({program!r}, run_name="__main__", alter_sys=True)
"""
"""A signal comes when this module is about to be imported."""


def struck(number: signal.Signals, module: str, *arguments: str, program: str = "scenectl") -> tuple[int, bytes, bytes]:
    if signal.getsignal(number) is signal.SIG_IGN:
        pytest.skip(f"{number.name} is ignored here, as under nohup, and children inherit that")
    code = STRUCK.format(module=module, number=int(number), program=program, arguments=list(arguments))
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, timeout=60)
    return done.returncode, done.stdout, done.stderr


@pytest.mark.parametrize("module", ["cyclopts", "scenectl.program", "scenectl.cluster", "trio"])
def test_ctrl_c_while_it_starts_is_one_line(module: str) -> None:
    assert struck(signal.SIGINT, module, "cluster", "status") == (INTERRUPTED, b"", WORDS)
    code, out, err = struck(signal.SIGINT, module, "cluster", "status", "--json")
    assert (code, err, json.loads(out)) == (INTERRUPTED, WORDS, json.loads(RESULT))


@pytest.mark.parametrize("module", ["scenectl.program", "trio"])
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_who_is_told_to_end_while_it_starts_says_so(number: signal.Signals, module: str) -> None:
    assert struck(number, module, "cluster", "status") == (INTERRUPTED, b"", WORDS)


@pytest.mark.parametrize("module", ["scenectl.program", "trio"])
@pytest.mark.parametrize("verb", [("node", "run", "--address", "127.0.0.2"), ("node", "local", "1"), ("cluster", "join", "127.0.0.2")])
def test_a_service_is_stopped_in_order_while_it_starts(verb: tuple[str, ...], module: str) -> None:
    assert struck(signal.SIGTERM, module, *verb) == (0, b"", b"")
    assert struck(signal.SIGINT, module, *verb) == (INTERRUPTED, b"", WORDS)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_node_process_is_stopped_in_order_while_it_starts(number: signal.Signals) -> None:
    arguments = ("--profile", "nowhere", "--address", "127.0.0.2")
    assert struck(number, "trio", *arguments, program="scenefold.node") == (0, b"", b"")


def test_the_words_are_those_of_later() -> None:
    ending = ending_of(KeyboardInterrupt())
    assert (ending.exit_code, f"error: {ending.line}\n".encode()) == (INTERRUPTED, WORDS)
    assert json.loads(RESULT) == ending.document()
