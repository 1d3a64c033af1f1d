"""If this fails, a memory budget changes the image, is not held, or leaves something behind."""

from __future__ import annotations

import json
import re
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trio
from numpy.typing import NDArray

from scenefold.base.errors import LocalFault
from scenefold.render import compiling as compiling_module
from scenefold.render.compiling import compile_apart
from scenefold.render.developing import develop
from scenefold.render.film import Film
from scenefold.render.image_files import image_sha256
from scenefold.render.in_memory import one_node_job
from scenefold.render.job import RenderOptions
from scenefold.render.levels import Adaptive
from scenefold.render.numbers import depth_of_box, job_box
from scenefold.render.out_of_core import spill as spill_module
from scenefold.render.out_of_core import tracing as tracing_module
from scenefold.render.out_of_core.cells import Cells, cells_within
from scenefold.render.out_of_core.pager import runs
from scenefold.render.out_of_core.spill import Spill, will_need
from scenefold.render.out_of_core.still import MIB, Made, OutOfCore, beside_trees, render_within
from scenefold.render.out_of_core.sweep import Sweep, lots_of
from scenefold.render.pass_sums import PassSums
from scenefold.render.renderers.embree.renderer import EmbreeRenderer
from scenefold.scene.tables import SceneTables
from scenefold.world import offline_world

OPTIONS = RenderOptions(width=80, height=60, samples=16, depth=6, sky=(0.3, 0.4, 0.5), layers=("albedo", "depth", "object_id"))


def glb(path: Path) -> Path:
    """Hills of 180,000 triangles, two balls of 5,000 with two instances each, one of them of glass, and a lamp."""
    side = np.linspace(-1.0, 1.0, 301)
    x, z = np.meshgrid(side, side, indexing="ij")
    hills = np.stack([x, 0.1 * np.sin(9 * x) * np.cos(7 * z), z], -1).reshape(-1, 3)
    theta, phi = np.meshgrid(np.linspace(0.02, np.pi - 0.02, 51), np.linspace(0, 2 * np.pi, 51), indexing="ij")
    ball = 0.2 * np.stack([np.sin(theta) * np.cos(phi), np.cos(theta), np.sin(theta) * np.sin(phi)], -1).reshape(-1, 3)
    lamp = np.array([[-0.3, 1.2, -0.3], [0.3, 1.2, -0.3], [-0.3, 1.2, 0.3], [0.3, 1.2, 0.3]])
    meshes = [(hills, grid(301), 0), (ball, grid(51), 1), (ball, grid(51), 2), (lamp, np.array([[0, 1, 2], [1, 3, 2]]), 3)]
    views: list[dict[str, Any]] = []
    accessors: list[dict[str, Any]] = []
    body = b""
    for positions, corners, _ in meshes:
        for values, kind, component in ((positions.astype("<f4"), "VEC3", 5126), (corners.astype("<u4").ravel(), "SCALAR", 5125)):
            views.append({"buffer": 0, "byteOffset": len(body), "byteLength": values.nbytes})
            bounds = {"min": values.min(0).tolist(), "max": values.max(0).tolist()} if kind == "VEC3" else {}
            accessors.append({"bufferView": len(views) - 1, "componentType": component, "count": len(values), "type": kind, **bounds})
            body += values.tobytes()
    glass = {"extensions": {"KHR_materials_transmission": {"transmissionFactor": 0.8}}, "doubleSided": True}
    document = {
        "asset": {"version": "2.0"},
        "buffers": [{"byteLength": len(body)}],
        "bufferViews": views,
        "accessors": accessors,
        "materials": [
            {"doubleSided": True},
            {"pbrMetallicRoughness": {"baseColorFactor": [0.8, 0.3, 0.2, 1], "roughnessFactor": 0.3}, "doubleSided": True},
            glass,
            {"emissiveFactor": [1, 1, 1], "doubleSided": True},
        ],
        "meshes": [
            {"primitives": [{"attributes": {"POSITION": 2 * at}, "indices": 2 * at + 1, "material": material}]}
            for at, (_, _, material) in enumerate(meshes)
        ],
        "nodes": [
            {"mesh": 0},
            {"mesh": 1, "translation": [-0.5, 0.3, 0]},
            {"mesh": 1, "translation": [0.5, 0.3, 0.2], "scale": [1, 0.7, 1.2]},
            {"mesh": 2, "translation": [0, 0.4, 0.4]},
            {"mesh": 2, "translation": [0, 0.3, -0.4]},
            {"mesh": 3},
        ],
        "scenes": [{"nodes": [0, 1, 2, 3, 4, 5]}],
        "scene": 0,
    }
    head = json.dumps(document).encode()
    head += b" " * (-len(head) % 4)
    chunks = struct.pack("<II", len(head), 0x4E4F534A) + head + struct.pack("<II", len(body), 0x004E4942) + body
    path.write_bytes(struct.pack("<III", 0x46546C67, 2, 12 + len(chunks)) + chunks)
    return path


def grid(side: int) -> NDArray[np.int64]:
    """Triangles of a grid of side x side points, int64[n, 3]."""
    first = (np.arange(side - 1)[:, None] * side + np.arange(side - 1)).ravel()
    pairs = [np.stack([first, first + 1, first + side], 1), np.stack([first + 1, first + side + 1, first + side], 1)]
    return np.concatenate(pairs)


def in_memory(file: Path, options: RenderOptions) -> tuple[dict[str, NDArray[Any]], SceneTables]:
    """The same image by the ordinary way: one node that holds everything."""

    async def load() -> Any:
        return await one_node_job(file, options, EmbreeRenderer().numeric_class(), offline_world().workers)

    one = trio.run(load)
    job, loaded = one.job, one.loaded
    scene = EmbreeRenderer().open(loaded.held, loaded.numbers, job.partition, 0)
    (tracer,) = scene.tracers(1)
    film = Film(job.window.width, job.window.height, job.columns)
    for number in range(job.plan.count):
        first, count = job.plan.first_path(number), job.plan.size(number)
        sums = PassSums.zeros(count, job.columns)
        for rays in tracer.generate(first, count).values():
            tracer.advance(rays, first, sums)
        film.add(sums, first, loaded.numbers.stride)
    scene.close()
    box = job_box(loaded.tables)
    return develop(film, job.layers, box, depth_of_box(job.camera, box)), loaded.tables


def within(file: Path, memory: int, threads: int = 1, options: RenderOptions = OPTIONS, folder: Path | None = None) -> Made:
    asked = OutOfCore(file=file, memory=memory, threads=threads, folder=folder)
    return trio.run(render_within, asked, options, lambda _phase, _done, _total: None)


class Known:
    """The scene, its image, and what its trees take."""

    def __init__(self, file: Path) -> None:
        self.file = file
        self.layers, self.tables = in_memory(file, OPTIONS)
        self.whole: Cells = cells_within(self.tables, 1 << 40)

    def budget(self, share: float, threads: int) -> int:
        """That leaves for trees so much of what those of the whole scene take while they are built."""
        return beside_trees(self.tables, OPTIONS, threads) + int(self.whole.largest * share)


@pytest.fixture(scope="module")
def known(tmp_path_factory: pytest.TempPathFactory) -> Known:
    return Known(glb(tmp_path_factory.mktemp("hills") / "hills.glb"))


@pytest.mark.parametrize(("share", "threads"), [(4.0, 1), (1.2, 2), (0.7, 4), (0.7, 1)])
def test_the_image_is_the_same_within_any_budget(known: Known, share: float, threads: int) -> None:
    made = within(known.file, known.budget(share, threads), threads)
    assert image_sha256(made.layers["beauty"]) == image_sha256(known.layers["beauty"])
    assert made.layers.keys() == known.layers.keys()
    assert all(np.array_equal(made.layers[name], known.layers[name]) for name in known.layers)
    memory = made.report["memory"]
    assert memory["trees_most"] <= memory["trees_limit"]
    assert (memory["cells"] > 1) == (share < 1.0)
    if share < 1.0:
        assert memory["trees_evicted"] and memory["trees_built"] > memory["cells"], "all lay in memory, or this test shows nothing"
        assert made.report["rays_passed"]


def test_cells_are_boxes_that_fit_and_hold_each_group_that_meets_them(known: Known) -> None:
    cells = cells_within(known.tables, int(known.whole.largest * 0.7))
    assert cells.partition.nodes == len(cells.shares) == len(cells.centres) > 1
    assert cells.largest <= known.whole.largest * 0.7
    assert {group for share in cells.shares for group in share.groups} == set(range(len(known.tables.groups)))
    assert sorted(cells.from_near_to_far(np.zeros(3))) == list(range(len(cells.shares)))
    assert cells_within(known.tables, 0).largest < known.whole.largest, "as small as can be, if nothing is small enough"


def test_a_sweep_goes_once_from_near_to_far_and_then_where_most_rays_wait() -> None:
    sweep = Sweep([2, 0, 1, 3])
    assert sweep.next([50, 60, 40, 0]) == 2 and sweep.after([50, 60, 40, 0], 2) == 0
    assert sweep.next([50, 60, 90, 0]) == 0
    assert sweep.next([3, 60, 90, 0]) == 1 and sweep.after([3, 60, 90, 0], 1) == 2, "3 is the last one, and has none"
    assert sweep.next([3, 4, 90, 0]) == 2 and sweep.after([3, 4, 90, 0], 2) == 1
    assert sweep.next([3, 0, 0, 0]) == 0 and sweep.after([3, 0, 0, 0], 0) is None
    sweep.begin()
    assert sweep.next([50, 60, 40, 0]) == 2


def test_lots_of_passes_have_rays_enough_and_leave_work_for_all_threads() -> None:
    assert list(lots_of({5: 40, 3: 40, 1: 6, 2: 5}, 1, 10)) == [[1, 2], [3], [5]]
    assert list(lots_of(dict.fromkeys(range(8), 1), 1, 100)) == [[0, 1], [2, 3], [4, 5], [6, 7]]
    assert list(lots_of({}, 2, 100)) == []


def test_several_waves_and_levels_are_no_matter(known: Known, monkeypatch: pytest.MonkeyPatch) -> None:
    adaptive = RenderOptions(width=80, height=60, samples=64, sky=(0.3, 0.4, 0.5), adaptive=Adaptive(0.05, 16))
    budget = known.budget(4.0, 2)
    whole = within(known.file, budget, 2, adaptive)
    monkeypatch.setattr(tracing_module, "WAVE_BYTES", 1)
    one_by_one = within(known.file, budget, 2, adaptive)
    assert image_sha256(whole.layers["beauty"]) == image_sha256(one_by_one.layers["beauty"])
    assert 16 < whole.report["samples_per_pixel"] < 64


def test_a_budget_that_is_too_small_is_named_with_one_that_is_enough(known: Known) -> None:
    with pytest.raises(LocalFault, match="too small") as caught:
        within(known.file, MIB)
    least = re.search(r"at least (\d+) MiB", caught.value.remedy)
    assert least
    made = within(known.file, int(least[1]) * MIB)
    assert image_sha256(made.layers["beauty"]) == image_sha256(known.layers["beauty"])


def test_nothing_is_left_in_the_folder(known: Known, tmp_path: Path) -> None:
    within(known.file, known.budget(4.0, 1), folder=tmp_path)
    assert not list(tmp_path.iterdir())


def test_a_file_that_is_none_is_said_in_the_words_of_any_import(tmp_path: Path) -> None:
    (tmp_path / "no.glb").write_bytes(b"nothing")
    with pytest.raises(LocalFault, match=r"no\.glb"):
        within(tmp_path / "no.glb", 1 << 30)


def test_a_folder_in_memory_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(spill_module, "file_system_of", lambda _folder: "tmpfs")
    with pytest.raises(LocalFault, match="tmpfs is no disk"):
        Spill(tmp_path)


def test_a_full_disk_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    spill = Spill(tmp_path)
    file = spill.file()

    def full(*_args: object) -> int:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(spill_module.os, "pwrite", full)
    with pytest.raises(LocalFault, match="there is no room"):
        file.append(b"1234")
    monkeypatch.setattr(spill_module.os, "posix_fallocate", full)
    with pytest.raises(LocalFault, match="there is no room"):
        spill.zeros(np.uint8, (10,))
    spill.close()


def test_mapped_arrays_are_plain_and_can_be_asked_for(tmp_path: Path) -> None:
    spill = Spill(tmp_path)
    array = spill.zeros(np.float32, (5000, 3))
    assert type(array) is np.ndarray and array.flags.writeable and not array.any()
    array[4999] = 1.0
    will_need(array, 2000, 5000)
    will_need(np.zeros(3), 0, 3)
    assert spill.zeros(np.uint8, (0,)).shape == (0,)
    spill.close()
    assert array[4999].sum() == 3.0, "what is mapped outlives the file"


def test_runs() -> None:
    assert runs([]) == []
    assert runs([1, 2, 3, 7, 9, 10]) == [(1, 3), (7, 7), (9, 10)]


def test_kernels_are_compiled_in_a_process_of_their_own_and_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    compiled = tmp_path / "compiled"
    (tmp_path / "compiler.py").write_text(f"open({str(compiled)!r}, 'a').write('once ')")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path), prepend=":")
    monkeypatch.setattr(compiling_module, "WARM", "compiler")
    monkeypatch.setattr(compiling_module, "are_compiled", compiled.exists)
    assert trio.run(compile_apart)
    assert not trio.run(compile_apart)
    assert compiled.read_text() == "once "


def test_who_cannot_compile_says_why(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "compiler.py").write_text("raise MemoryError('no room to compile')")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path), prepend=":")
    monkeypatch.setattr(compiling_module, "WARM", "compiler")
    monkeypatch.setattr(compiling_module, "are_compiled", lambda: False)
    with pytest.raises(LocalFault, match="ended with code 1: MemoryError: no room to compile"):
        trio.run(compile_apart)
