"""If this fails, an option of one way to share a render out is ignored in silence by another, or frames are others than were asked for."""

from __future__ import annotations

from pathlib import Path

import pytest

from scenectl.partition_options import FRAMES_MAX, Frames, numbered
from scenectl.program import main

WRONG = {
    "--engine tcp://127.0.0.1:8786": "rendered by nodes, and not by an engine",
    "--frames 0-3 --frame 2": "--frames and --frame are given",
    "--frames 0-3 --resume kept": "--resume is of one image",
    "--frames 0-3 --memory 1GiB": "--memory is of one image",
    "--frames 0-3 --preview looks.png": "--preview is of one image",
    "--partition visual --frames 0-3": "makes one image",
    "--partition visual --nodes 3": "--nodes is of a spatial partition",
    "--partition visual --ports 2000,2001": "--ports is of a spatial partition",
    "--partition temporal --memory 1GiB": "--memory is of a spatial partition",
    "--partition visual --pools 2": "--pools is of a spatial partition",
    "--memory 1GiB --pools auto": "--pools does not go with --memory",
    "--algorithm whole --pools 2": "each node is a pool of its own",
    "--pools 0": "pools are auto, or a number from 1 to 127",
    "--pools 128": "pools are auto, or a number from 1 to 127",
    "--pools many": "pools are auto, or a number from 1 to 127",
    "--partition temporal --resume kept": "--resume is of a spatial partition",
    "--partition temporal --frames 0-3 --frame 2": "--frames and --frame are given",
    "--partition temporal --frames 0-3 --time 2": "--frames and --time are given",
    "--partition temporal --frames 3-0": "comes before the first",
    "--partition temporal --frames 3-": "FIRST-LAST",
    "--partition temporal --frames=-3": "FIRST-LAST",
    "--partition temporal --frames many": "FIRST-LAST",
    "--partition temporal --frames 0-100000": "100,000 frames",
    "--partition visual --engine 127.0.0.1": "no address of a Dask scheduler",
    "--partition visual --engine tcp://127.0.0.1:8786 --threads 2": "--threads are of this process",
    "--partition visual --engine tcp://10.0.0.5:8786": "--trust-network",
    "--partition visual --trust-network": "--trust-network is said of the way to an engine",
    "--trust-network": "--trust-network is said of the way to an engine",
    "--partition diagonal": "diagonal",
}


@pytest.fixture(autouse=True)
def folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    for variable in ("SCENEFOLD_NODES", "SCENEFOLD_THREADS", "SCENEFOLD_PORTS", "SCENEFOLD_PROFILE"):
        monkeypatch.delenv(variable, raising=False)
    monkeypatch.chdir(tmp_path)
    Path("a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")


@pytest.mark.parametrize("options", WRONG)
def test_what_does_not_go_together_is_wrong_usage(options: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["render", "still", "a.obj", *options.split()]) == 2
    said = capsys.readouterr().err
    assert said.startswith("error: ") and said.count("\n") == 1 and WRONG[options] in said


def test_frames_are_of_a_file(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["render", "still", "--scene", "a", "--profile", "p", "--partition", "temporal", "--frames", "0-3"]) == 2
    assert "--frames is of a file" in capsys.readouterr().err


def test_a_scene_of_a_cluster_is_not_given_to_an_open_engine(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["render", "still", "--scene", "a", "--profile", "p", "--partition", "visual", "--engine", "tcp://10.0.0.5:8786"]) == 2
    assert "tls://" in capsys.readouterr().err


def test_who_starts_a_render_and_leaves_is_told_what_to_do(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["render", "start", "--scene", "a", "--profile", "p", "--partition", "visual"]) == 2
    assert "scenectl render still" in capsys.readouterr().err


def test_frames_are_both_ends_and_those_between() -> None:
    assert list(Frames.parse("3-5").numbers) == [3, 4, 5]
    assert list(Frames.parse(" 12 ").numbers) == [12]
    assert len(Frames.parse(f"1-{FRAMES_MAX}").numbers) == FRAMES_MAX
    assert str(Frames.parse("3-5")) == "3-5"


def test_their_numbers_stand_in_their_names() -> None:
    assert numbered(Path("a/fox.exr"), 7) == Path("a/fox.0007.exr")
    assert numbered(Path("fox.png"), 12345) == Path("fox.12345.png")


FRAMES = ("render", "still", "a.obj", "--partition", "temporal", "--frames", "0-3")


@pytest.mark.parametrize("is_of_variable", [False, True])
def test_frames_of_a_file_need_no_cluster(
    *, is_of_variable: bool, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Found before the file is imported into it."""
    if is_of_variable:
        monkeypatch.setenv("SCENEFOLD_PROFILE", "p")
    assert main([*FRAMES, *(() if is_of_variable else ("--profile", "p"))]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and "one moment" in said
    assert ("unset SCENEFOLD_PROFILE" if is_of_variable else "leave out --profile") in said


def test_a_folder_in_the_place_of_a_frame_is_found_before_the_work(capsys: pytest.CaptureFixture[str]) -> None:
    Path("out.0002.png").mkdir()
    assert main([*FRAMES, "-o", "out.exr"]) == 1
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and "is a folder" in said and "out.0002.png" in said


ONE_FILE = {
    ("--report", "a.obj"): "the file and --report",
    ("--report", "./b/../x.exr", "-o", "x.exr"): "-o and --report",
    ("--report", "x.png", "-o", "x.exr"): "the PNG beside -o and --report",
    ("--report", "linked", "--resume", "kept"): "--resume and --report",
    ("--environment", "sky.exr", "-o", "sky.exr"): "--environment and -o",
    ("--partition", "temporal", "--frames", "0-3", "--report", "image.0003.exr"): "frame 3 and --report",
}


@pytest.mark.parametrize("options", ONE_FILE)
def test_no_file_is_written_in_the_place_of_another(options: tuple[str, ...], capsys: pytest.CaptureFixture[str]) -> None:
    Path("b").mkdir()
    Path("linked").symlink_to("kept")
    before = Path("a.obj").read_bytes()
    assert main(["render", "still", "a.obj", *options]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and f"{ONE_FILE[options]} are one file" in said
    assert Path("a.obj").read_bytes() == before


def test_nor_by_a_fetch(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["render", "fetch", "3f9a", "-o", "x.exr", "--report", "x.exr", "--profile", "p"]) == 2
    assert "-o and --report are one file" in capsys.readouterr().err
