"""If this fails, progress floods a log, tables are crooked, or --json is no JSON."""

from __future__ import annotations

import io
import json
import subprocess
import sys
from pathlib import Path

import pytest

import scenectl
from scenectl.errors import ending_of
from scenectl.member_values import shown_member
from scenectl.output import Output, emit, emit_error, emit_event, note, size_text, table
from scenectl.progress import Progress
from scenectl.values import SPACE_NAMES, Place, Size
from scenefold.base.errors import Refused
from scenefold.base.location import FIRST, LAST
from scenefold.base.reasons import RejectReason
from scenefold.client.progress import ProgressState


def test_plain_progress_is_at_most_a_line_a_second_and_never_misses_the_end() -> None:
    clock, stream = [0.0], io.StringIO()
    with Progress(stream=stream, now=lambda: clock[0]) as progress:
        for done in range(1, 101):
            clock[0] = done * 0.03
            progress(ProgressState("import", done, 100, "records"))
        progress(ProgressState("import", 100, 100, "records"))
    lines = stream.getvalue().splitlines()
    assert lines[0] == "import: 1 of 100 records"
    assert lines[-1] == "import: 100 of 100 records"
    assert len(lines) == 4


def test_plain_progress_says_how_long_it_takes_by_the_pace_of_its_phase() -> None:
    clock, stream = [100.0], io.StringIO()
    with Progress(stream=stream, now=lambda: clock[0]) as progress:
        progress(ProgressState("geometry", 50, 1000, "triangles"))
        clock[0] += 10.0
        progress(ProgressState("geometry", 250, 1000, "triangles"))
        clock[0] += 10.0
        progress(ProgressState("geometry", 1000, 1000, "triangles"))
        progress(ProgressState("tables", 1, 5, "pages"))
        clock[0] += 10.0
        progress(ProgressState("count", 4096, None, "records"))
        clock[0] += 10.0
        progress(ProgressState("tables", 2, 5, "pages", 7200.0))
    assert stream.getvalue().splitlines() == [
        "geometry: 50 of 1000 triangles",
        "geometry: 250 of 1000 triangles, 38 s left",
        "geometry: 1000 of 1000 triangles",
        "count: 4096 records",
        "tables: 2 of 5 pages, 2.0 h left",
    ]


def test_who_says_often_that_all_is_done_is_heard_once_a_second_and_for_the_last_time_at_the_end() -> None:
    clock, stream = [0.0], io.StringIO()
    with Progress(stream=stream, now=lambda: clock[0]) as progress:
        for step in range(7):
            clock[0] = step * 0.4
            progress(ProgressState("prove", 44, 44, f"records, {step} MiB"))
        progress(ProgressState("export", 1, 2, "records"))
        clock[0] += 1.0
        for step in range(3):
            progress(ProgressState("export", 2, 2, f"records, {step} MiB"))
    told = ["prove: 44 of 44 records, 0 MiB", "prove: 44 of 44 records, 3 MiB", "prove: 44 of 44 records, 6 MiB"]
    assert stream.getvalue().splitlines() == [*told, "export: 2 of 2 records, 0 MiB", "export: 2 of 2 records, 2 MiB"]


def test_on_a_terminal_there_are_bars() -> None:
    class Terminal(io.StringIO):
        def isatty(self) -> bool:
            return True

    stream = Terminal()
    with Progress(stream=stream) as progress:
        progress(ProgressState("read", 0, 1, "file"))
        progress(ProgressState("geometry", 5, 40, "triangles"))
        progress(ProgressState("geometry", 40, 40, "triangles"))
    assert "geometry" in stream.getvalue()
    assert "40/40" in stream.getvalue()


def test_quiet_progress_says_nothing() -> None:
    stream = io.StringIO()
    with Progress(quiet=True, stream=stream) as progress:
        progress(ProgressState("import", 1, None, "records"))
    assert stream.getvalue() == ""


def test_results_are_text_or_one_json_object(capsys: pytest.CaptureFixture[str]) -> None:
    emit(Output(), {"a": 1}, "text")
    assert capsys.readouterr().out == "text\n"
    emit(Output(json=True), {"a": 1}, "text")
    assert json.loads(capsys.readouterr().out) == {"a": 1}


def test_tables_line_up() -> None:
    assert table(("node", "records"), [("127.0.0.2", 7), ("b", 12)]).splitlines() == [
        "node       records",
        "127.0.0.2        7",
        "b               12",
    ]


def test_sizes_read_well() -> None:
    assert [size_text(count) for count in (0, 1023, 1536, 3 * 2**30)] == ["0 B", "1023 B", "1.5 KiB", "3.0 GiB"]


def test_places_fill_up_both_ways() -> None:
    assert Place.parse("0").first == FIRST
    assert Place.parse("0xF").last == LAST
    assert str(Size.parse("640X360")) == "640x360"


def test_space_names_are_those_of_the_scene_layout() -> None:
    from scenefold.scene.layout import SPACES

    assert {space.name: int(space.id) for space in SPACES} == {name: index + 1 for index, name in enumerate(SPACE_NAMES)}


def test_a_name_that_others_chose_does_not_steer_the_terminal() -> None:
    shown = table(("name",), [("\x1b[2Jkitchen\n\u202e\x9b",), ("küche 厨房",)])
    assert shown.splitlines() == ["name", r"\x1b[2Jkitchen\n\u202e\x9b", "küche 厨房"]


STEERING = "\x1b]0;owned\x07\x9b2J\u202edecided\r"


def test_what_others_say_does_not_steer_the_terminal_whichever_way_it_comes(capsys: pytest.CaptureFixture[str]) -> None:
    """A refusal, a traceback, a report, an event: all are words of others."""
    refusal = Refused(RejectReason.BUSY, f"no\n{STEERING}", where=STEERING)
    emit(Output(), {}, f"two\nlines {STEERING}")
    emit(Output(json=True), {"failure": STEERING}, "")
    emit_event(Output(), {}, STEERING)
    emit_event(Output(json=True), {"failure": STEERING}, "")
    emit_error(ending_of(refusal), as_json=True, error=refusal)
    note(STEERING)
    said = capsys.readouterr()
    for line in (said.out + said.err).splitlines():
        assert line.isprintable()
    assert said.out.startswith("two\nlines \\x1b]0;owned")
    assert json.loads(said.out.splitlines()[-1])["error"]["where"] == STEERING
    assert said.err.splitlines()[-2].startswith("error: no \\x1b]0;owned")


def test_what_modules_warn_of_does_not_steer_the_terminal() -> None:
    program = f"import logging, scenectl.output as o; o.plain_logs(); logging.getLogger('scenefold').warning('told: %s', {STEERING!r})"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True, timeout=60)
    assert done.stderr == "told: \\x1b]0;owned\\x07\\x9b2J\\u202edecided\\r\n"


def test_all_that_verbs_say_leaves_by_one_door() -> None:
    """A `print` elsewhere would pass on whatever a peer said."""
    folder = Path(scenectl.__file__).parent
    assert [path.name for path in sorted(folder.glob("*.py")) if "print(" in path.read_text()] == ["output.py"]


def test_nodes_are_named_by_their_address_as_users_name_them() -> None:
    assert [shown_member(name) for name in ("user:ada", "node:2130706435", "node:x")] == ["user:ada", "node:127.0.0.3", "node:x"]
