"""If this fails, `render report` does not say what reports say, or ends in a traceback over a file that is none."""

from __future__ import annotations

import errno
import json
from pathlib import Path
from typing import Any

import pytest

from scenectl import render_report, still
from scenectl.program import main
from scenectl.render_report import REPORTS_MAX, keep_report, read_report
from scenefold.base.errors import LocalFault

REPORT: dict[str, Any] = {
    "partition": "visual",
    "scene": "kitchen",
    "paths": 1000,
    "rays_passed_per_path": 0.0,
    "bytes_passed": 0,
    "bytes_returned": 2048,
    "efficiency": 0.75,
    "render_seconds": {"prepare": 0.5, "render": 1234.0},
    "render_nodes": [{"bytes_read": 100, "processor_seconds": 5.0, "memory_most": 1 << 20}],
    "image_sha256": "ab" * 32,
}


@pytest.fixture(autouse=True)
def folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.delenv("SCENEFOLD_PROFILE", raising=False)
    monkeypatch.chdir(tmp_path)
    Path("a.json").write_text(json.dumps(REPORT))
    Path("b.json").write_text(json.dumps(REPORT | {"image_sha256": "cd" * 32, "scene": "\x1b[2J"}))


def test_a_column_for_each_render(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["render", "report", "a.json", "b.json"]) == 0
    lines = {line[:26].strip(): line[26:].split() for line in capsys.readouterr().out.splitlines()}
    assert lines[""] == ["a.json", "b.json"]
    assert lines["seconds"] == ["1,234.50", "1,234.50"]
    assert lines["memory of a node, at most"] == ["1.0", "MiB", "1.0", "MiB"]
    assert lines["image sha256"] == ["abababababab", "cdcdcdcdcdcd"]
    assert "moves of cells" not in lines, "nobody says anything of them"


def test_words_of_a_report_steer_no_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["render", "report", "b.json"]) == 0
    assert "\x1b" not in capsys.readouterr().out


def test_whether_the_images_are_the_same(capsys: pytest.CaptureFixture[str]) -> None:
    for files, same in ((["a.json", "a.json"], True), (["a.json", "b.json"], False)):
        assert main(["render", "report", *files, "--json"]) == 0
        document = json.loads(capsys.readouterr().out)
        assert document["same_image"] is same and [row["report"] for row in document["renders"]] == files


BAD = {
    "nowhere.json": "cannot read the report",
    "folder": "cannot read the report",
    "words.json": "no JSON",
    "deep.json": "no JSON",
    "other.json": "no report of a render",
}


@pytest.mark.parametrize("name", BAD)
def test_what_is_no_report_is_one_clear_error(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    Path("folder").mkdir()
    Path("words.json").write_bytes(b"\xff\xfe")
    Path("deep.json").write_text("[" * 100_000)
    Path("other.json").write_text('{"scene": "kitchen"}')
    assert main(["render", "report", "a.json", name]) == 1
    said = capsys.readouterr().err
    assert said.startswith("error: ") and said.count("\n") == 1 and BAD[name] in said and name in said


@pytest.mark.parametrize("count", [0, REPORTS_MAX + 1])
def test_none_and_too_many_are_wrong_usage(count: int, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["render", "report", *["a.json"] * count]) == 2
    assert "name from 1 to 64" in capsys.readouterr().err


def test_a_name_without_a_cluster(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["render", "report", "3f9a", "--profile", "nowhere"]) == 1
    assert "no cluster profile" in capsys.readouterr().err


def test_a_file_that_is_called_like_a_render_is_a_file(capsys: pytest.CaptureFixture[str]) -> None:
    Path("3f9a").write_text(json.dumps(REPORT))
    assert main(["render", "report", "3f9a"]) == 0
    assert "kitchen" in capsys.readouterr().out


def test_a_report_names_any_file() -> None:
    odd = REPORT | {"file": "ro\udce9m.glb", "scene": "Küche"}
    keep_report(Path("kept.json"), odd)
    assert read_report(Path("kept.json")) == odd


def test_a_report_that_cannot_be_written_leaves_the_older_one(monkeypatch: pytest.MonkeyPatch) -> None:
    keep_report(Path("kept.json"), REPORT)

    def full(path: Path, data: bytes) -> int:
        with path.open("wb") as file:
            file.write(data[:10])
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(LocalFault, match=r"cannot write the report: No space left.*kept.json"):
        keep_report(Path("kept.json"), REPORT | {"scene": "other"})
    assert read_report(Path("kept.json")) == REPORT
    assert sorted(path.name for path in Path().iterdir()) == ["a.json", "b.json", "kept.json"]


def test_it_is_printed_all_the_same(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    Path("a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")

    async def made(*_: object) -> dict[str, Any]:
        return REPORT

    def full(_: Path, _document: object) -> None:
        raise LocalFault("cannot write the report", where="kept.json", remedy="choose another")

    monkeypatch.setattr(still, "make_still", made)
    monkeypatch.setattr(still, "report_text", lambda _: "the report")
    monkeypatch.setattr(render_report, "keep_report", full)
    assert main(["render", "still", "a.obj", "--report", "kept.json"]) == 1
    said = capsys.readouterr()
    assert said.out == "the report\n" and said.err.count("\n") == 1
