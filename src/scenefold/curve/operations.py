"""The array side of `Curve`: arguments checked and converted, then handed to the compiled kernels."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from scenefold.base.limits import CURVE_ARCS_MAX
from scenefold.base.location import LOCATION_BYTES
from scenefold.curve import kernels
from scenefold.curve.arcs import cover
from scenefold.curve.shape import CurveFault, CurveShape
from scenefold.curve.tables import tables_of

Cells = npt.NDArray[np.uint64]


def encode(curve: CurveShape, cells: npt.ArrayLike) -> npt.NDArray[np.bytes_]:
    """See `Curve.encode`."""
    numbers = _cells_of(curve, cells)
    tables = tables_of(curve.kind, curve.dimensions)
    out = np.empty((len(numbers), LOCATION_BYTES), np.uint8)
    kernels.encode(numbers, tables.forward, (0,) * curve.dimensions, (0,) * tables.levels, out)
    return out.view(f"S{LOCATION_BYTES}").reshape(len(numbers))


def decode(curve: CurveShape, locations: npt.NDArray[np.bytes_] | Sequence[bytes]) -> Cells:
    """See `Curve.decode`."""
    rows = _location_rows(locations)
    tables = tables_of(curve.kind, curve.dimensions)
    out = np.empty((len(rows), curve.dimensions), np.uint64)
    kernels.decode(rows, tables.inverse, (0,) * curve.dimensions, (0,) * tables.levels, out)
    return out


def arcs(curve: CurveShape, low: npt.ArrayLike, high: npt.ArrayLike, limit: int) -> list[tuple[bytes, bytes]]:
    """See `Curve.arcs`."""
    if isinstance(limit, bool) or not isinstance(limit, (int, np.integer)) or limit < 1:
        raise CurveFault(f"the limit of arcs is a whole number from 1 on, not {limit!r}")
    corners = [_cells_of(curve, [_corner(curve, corner)])[0] for corner in (low, high)]
    if (corners[0] > corners[1]).any():
        axis = int(np.argmax(corners[0] > corners[1]))
        raise CurveFault(f"the box ends at {corners[1][axis]} before it begins at {corners[0][axis]}", where=f"axis {axis}")
    tables = tables_of(curve.kind, curve.dimensions)
    return cover(corners[0], corners[1], tables.inverse_one, curve.cell_bits, min(int(limit), CURVE_ARCS_MAX))


def _corner(curve: CurveShape, corner: npt.ArrayLike) -> list[Any]:
    numbers = corner.tolist() if isinstance(corner, np.ndarray) else corner
    if not isinstance(numbers, Sequence) or len(numbers) != curve.dimensions:
        raise CurveFault(f"the corner of a box has {curve.dimensions} cell numbers, not {corner!r}")
    return list(numbers)


def _cells_of(curve: CurveShape, cells: npt.ArrayLike) -> Cells:
    """Checked cells as contiguous uint64[n, D]."""
    array = cells if isinstance(cells, np.ndarray) else _array_of_numbers(cells)
    if array.size == 0 and array.ndim <= 2:
        array = array.reshape(0, curve.dimensions)
    if array.ndim != 2 or array.shape[1] != curve.dimensions:
        raise CurveFault(f"cells of {curve.dimensions} dimensions have shape (n, {curve.dimensions}), not {array.shape}")
    if array.size == 0:
        return np.empty((0, curve.dimensions), np.uint64)
    if array.dtype.kind == "O":
        _check_whole(array)
    elif array.dtype.kind not in "ui":
        raise CurveFault(f"cell numbers are whole, not {array.dtype}", remedy="use Lattice.cells for coordinates")
    if array.dtype.kind != "u" and array.min() < 0:
        raise CurveFault(f"a cell number is 0 or more, not {array.min()}")
    last = (1 << curve.cell_bits) - 1
    if int(array.max()) > last:
        raise CurveFault(f"a cell number of {curve.dimensions} dimensions is at most 2^{curve.cell_bits} - 1, not {array.max()}")
    return np.ascontiguousarray(array, np.uint64)


def _array_of_numbers(cells: npt.ArrayLike) -> npt.NDArray[Any]:
    """Lists that mix small with very large whole numbers become floats in numpy: those we look at one by one."""
    try:
        array = np.asarray(cells)
    except (ValueError, OverflowError) as error:
        raise CurveFault(f"cells are rows of whole numbers of one length: {error}") from error
    return array if array.dtype.kind in "ui" else np.array(cells, dtype=object)


def _check_whole(array: npt.NDArray[Any]) -> None:
    for number in array.flat:
        if isinstance(number, bool) or not isinstance(number, (int, np.integer)):
            raise CurveFault(f"cell numbers are whole, not {number!r}", remedy="use Lattice.cells for coordinates")


def _location_rows(locations: npt.NDArray[np.bytes_] | Sequence[bytes]) -> npt.NDArray[np.uint8]:
    """Locations as contiguous uint8[n, 20], padded."""
    if isinstance(locations, (bytes, str)):
        raise CurveFault("locations come as an array or a sequence", remedy="put a single one into a list")
    if not isinstance(locations, np.ndarray):
        for location in locations:
            if not isinstance(location, bytes) or len(location) > LOCATION_BYTES:
                raise CurveFault(f"a location is {LOCATION_BYTES} bytes, not {location!r}")
        # Of subclasses of bytes numpy (2.4) finds no width by itself: `np.array([location])` fails.
        locations = np.array(list(locations), dtype=f"S{LOCATION_BYTES}")
    if locations.ndim != 1 or (locations.size and locations.dtype.kind != "S"):
        raise CurveFault(f"locations are a row of bytes (S{LOCATION_BYTES}), not {locations.dtype} of shape {locations.shape}")
    if locations.size == 0:
        return np.empty((0, LOCATION_BYTES), np.uint8)
    if locations.dtype.itemsize > LOCATION_BYTES and int(np.char.str_len(locations).max()) > LOCATION_BYTES:
        raise CurveFault(f"a location has {LOCATION_BYTES} bytes, not {int(np.char.str_len(locations).max())}")
    rows = np.ascontiguousarray(locations, f"S{LOCATION_BYTES}")
    return rows.view(np.uint8).reshape(len(rows), LOCATION_BYTES)
