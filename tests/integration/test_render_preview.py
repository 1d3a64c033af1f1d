"""If this fails, whoever waits for a render sees nothing of it on the way, or a preview is asked for where there can be none, and nobody says so."""

from __future__ import annotations

import subprocess
import time
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from integration.scenectl_process import command, environment, scenectl
from loopback import addresses, ports_option

KERNELS_S = 240.0
"""The first render after a change of the kernels compiles them."""
ROOM = "v 0 0 0\nv 4 0 0\nv 4 0 4\nv 0 0 4\nv 0 3 0\nv 4 3 0\nf 1 2 3 4\nf 1 2 6 5\n"

pytestmark = pytest.mark.timeout(360)


def render(folder: Path, *more: str | Path) -> list[str | Path]:
    image = ["--sky", "0.5,0.6,0.7", "--size", "160x90", "--threads", "1", "--json", "-o", folder / "o.exr"]
    return ["render", "still", folder / "room.obj", *image, *more]


def pixels_of(path: Path) -> np.ndarray:
    with Image.open(path) as image:
        return np.asarray(image, np.float64)


def test_a_picture_is_there_before_the_image_and_looks_like_it(tmp_path: Path) -> None:
    (tmp_path / "room.obj").write_text(ROOM)
    looks = tmp_path / "looks.png"
    wanted = ["--preview", looks, "--preview-every", "1", "--exposure", "0", "--samples", "1024"]
    words = command(*render(tmp_path, "--nodes", "2", "--ports", ports_option(*addresses(2)), *wanted))
    with subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, env=environment(None), text=True) as process:
        try:
            until = time.monotonic() + KERNELS_S
            while not looks.exists():
                assert process.poll() is None and time.monotonic() < until
                time.sleep(0.01)
            assert not (tmp_path / "o.exr").exists()
            first = pixels_of(looks)
            _, said = process.communicate(timeout=KERNELS_S)
        finally:
            process.kill()
    assert process.returncode == 0, said
    image = pixels_of(tmp_path / "o.png")
    assert first.shape == image.shape == (90, 160, 3)
    # Few samples, but no pixel without: a scattered pass has some in every part of the image.
    assert np.abs(first - image).mean() < image.std() / 2


@pytest.mark.parametrize(
    ("options", "code", "words"),
    [
        (["--preview", "looks.jpg"], 2, "a preview is a PNG file"),
        (["--preview-every", "5"], 2, "--preview-every goes with --preview"),
        (["--preview", "looks.png", "--preview-every", "0"], 2, "--preview-every"),
        (["--preview", "o.png"], 2, "--preview are one file"),
        (["--preview", "missing/looks.png"], 1, "the output folder does not exist"),
        (["--preview", "looks.png", "--partition", "visual"], 2, "--preview"),
        (["--preview", "looks.png", "--memory", "512MiB"], 2, "--preview"),
    ],
)
def test_what_cannot_be_shown_is_said_before_anything_is_done(tmp_path: Path, options: list[str], code: int, words: str) -> None:
    (tmp_path / "room.obj").write_text(ROOM)
    inside = [tmp_path / word if word.endswith((".png", ".jpg")) else word for word in options]
    refused = scenectl(*render(tmp_path, *inside), limit_s=60.0)
    assert words in refused.refusal(code)
    assert not list(tmp_path.glob("*.exr"))
