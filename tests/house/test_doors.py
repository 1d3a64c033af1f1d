"""If this fails, a dependency is used outside the one place that wraps it, or a pure room touches the world.

One dependency, one door (docs/architecture.md): exchanging a library then means changing one room.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from house.sources import imports_of, lies_in, module_of, python_files

DOORS = {
    "msgpack": ("scenefold.wire",),
    "cryptography": ("scenefold.crypto",),
    "nacl": ("scenefold.crypto",),
    "lmdb": ("scenefold.store",),
    "embreex": ("scenefold.render.renderers.embree",),
    "mitsuba": ("scenefold.render.renderers.mitsuba",),
    "dask": ("scenefold.render.tasks.engine",),
    "distributed": ("scenefold.render.tasks.engine",),
    "emcee": ("scenefold.study",),
    "rich": ("scenectl",),
    "cyclopts": ("scenectl",),
}
PURE = tuple(f"scenefold.{room}" for room in ("base", "curve", "crypto", "wire", "partition", "scene", "consensus"))
# What pure rooms must be handed instead: clocks, dice, sockets, threads and tasks come through the ports of world/.
WORLDLY = (
    "trio",
    "asyncio",
    "anyio",
    "socket",
    "socketserver",
    "threading",
    "multiprocessing",
    "concurrent",
    "subprocess",
    "random",
    "time",
)
STUDY_MAY_SEE = ("scenefold.base", "scenefold.partition", "scenefold.render.capture", "scenefold.study")

FILES = {module_of(path): path for path in python_files("src", "cli")}


def offenders(library: str, allowed: tuple[str, ...]) -> list[str]:
    return [
        module
        for module, path in FILES.items()
        if not lies_in(module, *allowed) and any(lies_in(name, library) for name in imports_of(path))
    ]


@pytest.mark.parametrize("library", DOORS)
def test_a_library_has_one_door(library: str) -> None:
    assert offenders(library, DOORS[library]) == []


@pytest.mark.parametrize("library", WORLDLY)
def test_rooms_below_the_world_are_pure(library: str) -> None:
    everything_else = tuple({module for module in FILES if not lies_in(module, *PURE)})
    assert offenders(library, everything_else) == []


def test_nothing_runs_on_asyncio() -> None:
    assert offenders("asyncio", ()) == []


def test_numba_only_in_kernels() -> None:
    def is_kernels(path: Path) -> bool:
        return "kernels" in path.name

    using = [path for path in FILES.values() if any(lies_in(name, "numba", "llvmlite") for name in imports_of(path))]
    assert [str(path) for path in using if not is_kernels(path)] == []


def test_renderers_are_reached_by_entry_point_only() -> None:
    for module, path in FILES.items():
        renderer = ".".join(module.split(".")[:4]) if lies_in(module, "scenefold.render.renderers") else ""
        for name in imports_of(path):
            inside = lies_in(name, "scenefold.render.renderers")
            assert not inside or (renderer and lies_in(name, renderer)), f"{module} imports {name}"


def test_the_study_sees_cells_and_captured_rays_only() -> None:
    for module, path in FILES.items():
        if lies_in(module, "scenefold.study"):
            ours = {name for name in imports_of(path) if lies_in(name, "scenefold")}
            assert all(lies_in(name, *STUDY_MAY_SEE) for name in ours), f"{module} imports {sorted(ours)}"
