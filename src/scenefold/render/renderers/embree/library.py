"""Embree 4 as bundled with the embreex wheel, by ctypes: device, geometry, scenes. The only door to Embree.

embreex's own interface has no filters, instances or choice of instruction set (docs/decisions). The device is
made for AVX2: results differ between instruction sets, so every node uses the same, and the
job's numeric class says which (rendering.md, Bits).
"""

from __future__ import annotations

import ctypes
import functools
import os
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

from scenefold.base.errors import LocalFault
from scenefold.render.contract import NoRoomForTrees
from scenefold.render.renderers.embree.tree_memory import MONITOR, TreeMemory

ISA: Final = "avx2"
BUILD_THREADS: Final = 2
"""That build trees. With one, a worker of oneTBB was seen to call sched_yield without end in each node of a pool; why is not known (docs/benchmarks.md)."""

_GEOMETRY_TRIANGLE = 0
_GEOMETRY_INSTANCE = 121
_BUFFER_INDEX, _BUFFER_VERTEX = 0, 1
_FORMAT_UINT3, _FORMAT_FLOAT3 = 0x5003, 0x9003
_FORMAT_FLOAT3X4_ROW_MAJOR = 0x9134
_SCENE_ROBUST = 4
_ERROR_OUT_OF_MEMORY = 4
_PROPERTY_VERSION = 0

_POINTER, _UINT, _SIZE = ctypes.c_void_p, ctypes.c_uint, ctypes.c_size_t
_SIGNATURES: Final = {
    "rtcNewDevice": (_POINTER, [ctypes.c_char_p]),
    "rtcReleaseDevice": (None, [_POINTER]),
    "rtcGetDeviceError": (ctypes.c_int, [_POINTER]),
    "rtcGetDeviceProperty": (ctypes.c_ssize_t, [_POINTER, ctypes.c_int]),
    "rtcSetDeviceMemoryMonitorFunction": (None, [_POINTER, MONITOR, _POINTER]),
    "rtcNewScene": (_POINTER, [_POINTER]),
    "rtcReleaseScene": (None, [_POINTER]),
    "rtcSetSceneFlags": (None, [_POINTER, ctypes.c_int]),
    "rtcCommitScene": (None, [_POINTER]),
    "rtcIntersect1": (None, [_POINTER, _POINTER, _POINTER]),
    "rtcNewGeometry": (_POINTER, [_POINTER, ctypes.c_int]),
    "rtcReleaseGeometry": (None, [_POINTER]),
    "rtcSetSharedGeometryBuffer": (
        None,
        [_POINTER, ctypes.c_int, _UINT, ctypes.c_int, _POINTER, _SIZE, _SIZE, _SIZE],
    ),
    "rtcSetGeometryUserData": (None, [_POINTER, _POINTER]),
    "rtcSetGeometryInstancedScene": (None, [_POINTER, _POINTER]),
    "rtcSetGeometryTransform": (None, [_POINTER, _UINT, ctypes.c_int, _POINTER]),
    "rtcCommitGeometry": (None, [_POINTER]),
    "rtcAttachGeometryByID": (None, [_POINTER, _POINTER, _UINT]),
}


@functools.cache
def _library() -> ctypes.CDLL:
    import embreex

    package = Path(embreex.__file__).resolve().parent
    candidates = sorted(package.parent.glob("embreex.libs/libembree4*")) + sorted(package.glob("**/*embree4*"))
    if not candidates:
        raise LocalFault(
            "the embreex package brings no Embree 4 library",
            where=str(package),
            remedy="install the embreex wheel of constraints.txt for this platform",
        )
    library = ctypes.CDLL(os.fspath(candidates[0]))
    for name, (result, arguments) in _SIGNATURES.items():
        function = getattr(library, name)
        function.restype, function.argtypes = result, arguments
    return library


def function_address(name: str) -> int:
    """The address of one of the library's functions, for kernels that call it."""
    address = ctypes.cast(getattr(_library(), name), _POINTER).value
    assert address is not None
    return address


def _has_avx2() -> bool:
    try:
        return " avx2 " in Path("/proc/cpuinfo").read_text() + " "
    except OSError:
        return True


class Device:
    """One Embree device. Scenes made from it must be released before it is."""

    def __init__(self, memory: TreeMemory | None = None) -> None:
        """`memory`: what its trees may take."""
        if not _has_avx2():
            raise LocalFault(
                "this processor lacks AVX2, so its image would differ in bits from the other nodes'",
                where="/proc/cpuinfo",
                remedy="render on nodes with AVX2",
            )
        self._library = _library()
        self._device = self._library.rtcNewDevice(f"isa={ISA},threads={BUILD_THREADS}".encode())
        if not self._device:
            raise LocalFault("Embree could not start", where="rtcNewDevice", remedy="check the processor and memory limits")
        self._memory = memory
        if memory is not None:
            self._library.rtcSetDeviceMemoryMonitorFunction(self._device, memory.monitor, None)

    def check(self, what: str) -> None:
        """LocalFault if Embree noted an error since the last call, NoRoomForTrees if that is that it may not have more memory."""
        code = int(self._library.rtcGetDeviceError(self._device))
        if code == _ERROR_OUT_OF_MEMORY and self._memory is not None:
            raise NoRoomForTrees
        if code:
            raise LocalFault(f"Embree failed with error {code}", where=what, remedy="give the node more memory, or hold less geometry")

    @property
    def version(self) -> tuple[int, int, int]:
        """Embree's."""
        number = int(self._library.rtcGetDeviceProperty(self._device, _PROPERTY_VERSION))
        return number // 10000, number // 100 % 100, number % 100

    def new_scene(self) -> int:
        """An empty scene with conservative ("robust") traversal: no ray slips between two triangles' boxes."""
        scene = self._library.rtcNewScene(self._device)
        self._library.rtcSetSceneFlags(scene, _SCENE_ROBUST)
        return int(scene)

    def add_triangles(
        self,
        scene: int,
        geometry_id: int,
        vertices: npt.NDArray[np.float32],
        triangles: npt.NDArray[np.uint32],
        user_data: int = 0,
    ) -> None:
        """Attach float32[n, 3] vertices and uint32[m, 3] triangles. Both are shared: the caller keeps them alive.

        `vertices` must be followed by at least four more readable bytes, since Embree loads four floats at once.
        Filters are handed `user_data`.
        """
        assert vertices.dtype == np.float32 and vertices.flags.c_contiguous
        assert triangles.dtype == np.uint32 and triangles.flags.c_contiguous
        library = self._library
        geometry = library.rtcNewGeometry(self._device, _GEOMETRY_TRIANGLE)
        library.rtcSetSharedGeometryBuffer(geometry, _BUFFER_VERTEX, 0, _FORMAT_FLOAT3, vertices.ctypes.data, 0, 12, len(vertices))
        library.rtcSetSharedGeometryBuffer(geometry, _BUFFER_INDEX, 0, _FORMAT_UINT3, triangles.ctypes.data, 0, 12, len(triangles))
        library.rtcSetGeometryUserData(geometry, user_data)
        self._attach(scene, geometry, geometry_id)

    def add_instance(self, scene: int, geometry_id: int, prototype: int, matrix: npt.NDArray[np.float32]) -> None:
        """Attach a committed scene as an instance under a row-major float32[3, 4] matrix, prototype to world."""
        library = self._library
        rows = np.ascontiguousarray(matrix, dtype=np.float32)
        geometry = library.rtcNewGeometry(self._device, _GEOMETRY_INSTANCE)
        library.rtcSetGeometryInstancedScene(geometry, prototype)
        library.rtcSetGeometryTransform(geometry, 0, _FORMAT_FLOAT3X4_ROW_MAJOR, rows.ctypes.data)
        self._attach(scene, geometry, geometry_id)

    def _attach(self, scene: int, geometry: int, geometry_id: int) -> None:
        self._library.rtcCommitGeometry(geometry)
        self._library.rtcAttachGeometryByID(scene, geometry, geometry_id)
        self._library.rtcReleaseGeometry(geometry)

    def commit(self, scene: int) -> None:
        """Build the scene's tree. Runs for a second per few million triangles: call it in a worker thread."""
        self._library.rtcCommitScene(scene)

    def intersect(self, scene: int, ray_hit: int) -> None:
        """Cast one ray, without filters: `ray_hit` is the address of an RTCRayHit. Who has many calls Embree in a kernel (cast_kernels.py)."""
        self._library.rtcIntersect1(scene, ray_hit, None)

    def release_scenes(self, *scenes: int) -> None:
        """Let go of scenes alone."""
        for scene in scenes:
            self._library.rtcReleaseScene(scene)

    def release(self, *scenes: int) -> None:
        """Let go of scenes and then of the device; the device cannot be used any more."""
        self.release_scenes(*scenes)
        self._library.rtcReleaseDevice(self._device)
        self._device = None
