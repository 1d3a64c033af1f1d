"""If this fails, a memory budget changes the image, is not held, or leaves something behind."""

from __future__ import annotations

import functools
from pathlib import Path

import numpy as np
import pytest
import trio

from scenefold.base.errors import LocalFault
from scenefold.render.image_files import image_sha256
from scenefold.render.job import RenderOptions
from scenefold.render.out_of_core import cells as cells_module
from scenefold.render.out_of_core.still import MIB, Made, OutOfCore, render_within
from scenefold.scene.sample import sample_scene_path

OPTIONS = RenderOptions(width=96, height=64, samples=8, sky=(0.3, 0.4, 0.5), layers=("albedo", "depth", "object_id"))


def made(file: Path, memory: int, threads: int = 1, options: RenderOptions = OPTIONS) -> Made:
    asked = OutOfCore(file=file, memory=memory, threads=threads)
    return trio.run(render_within, asked, options, lambda _phase, _done, _total: None)


if __name__ == "__main__":
    for mem in (1 << 30, 60 * MIB):
        m = made(sample_scene_path(), mem, 2)
        print(image_sha256(m.layers["beauty"]), m.report)
