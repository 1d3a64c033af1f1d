"""Cycles with one of our scenes, in a process of its own: its package, bpy, needs a Python that has it."""

from __future__ import annotations

import json
import subprocess
import tempfile
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
import numpy.typing as npt

from scenefold.render.arrays import MaterialColumn
from scenefold.render.flat import flat_triangles
from scenefold.render.in_memory import OneNodeJob

_WAIT_S = 600.0


class Cycles:
    """Within it, `image` renders one. OSError if that Python does not run; RuntimeError with its last words if it ends."""

    name = "cycles"

    def __init__(self, python: str, one: OneNodeJob, threads: int, roulette_from: int) -> None:
        self._place = tempfile.TemporaryDirectory(prefix="beside-cycles-")
        self._folder = Path(self._place.name)
        _write_scene(self._folder / "scene.npz", one)
        numbers = one.loaded.numbers
        asked = {
            "width": numbers.width,
            "height": numbers.height,
            "samples": one.job.samples,
            "depth": one.job.depth,
            "roulette_from": roulette_from,
            "threads": threads,
            "sky": numbers.sky.tolist(),
            "camera": numbers.camera.tolist(),
        }
        (self._folder / "job.json").write_text(json.dumps(asked), encoding="utf-8")
        command = [python, str(Path(__file__).parent / "cycles_render.py"), str(self._folder)]
        self._said = (self._folder / "errors.txt").open("w+", encoding="utf-8")
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self._said, text=True)

    def __enter__(self) -> Cycles:
        return self

    def __exit__(self, _kind: type[BaseException] | None, _error: BaseException | None, _trace: TracebackType | None) -> None:
        assert self._process.stdin is not None
        self._process.stdin.close()
        try:
            self._process.wait(_WAIT_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
        self._said.close()
        self._place.cleanup()

    def ready(self, seed: int) -> None:
        """It keeps what it has built."""

    def image(self, seed: int) -> npt.NDArray[np.float64]:
        """float64[H, W, 3]"""
        assert self._process.stdin is not None and self._process.stdout is not None
        self._process.stdin.write(f"{seed}\n")
        self._process.stdin.flush()
        for line in self._process.stdout:
            if line.startswith("done "):
                return np.asarray(np.load(self._folder / line.split()[1]), np.float64)
        self._said.seek(0)
        raise RuntimeError(f"Cycles has ended: {self._said.read()[-400:]}")

    def rays(self) -> float | None:
        """Cycles does not say."""
        return None


def _write_scene(file: Path, one: OneNodeJob) -> None:
    flat = flat_triangles(one.loaded.held)
    rows: Any = one.loaded.held.arrays.materials
    np.savez(
        file,
        positions=flat.positions,
        materials=flat.materials,
        colors=rows[:, MaterialColumn.BASE : MaterialColumn.BASE + 3],
        two_sided=rows[:, MaterialColumn.DOUBLE_SIDED] != 0.0,
        radiances=rows[:, MaterialColumn.EMISSION : MaterialColumn.EMISSION + 3],
    )
