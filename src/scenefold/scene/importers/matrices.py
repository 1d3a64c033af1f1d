"""Small matrix sums in f64, written out: the same bits on every machine, which a BLAS does not promise."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Matrix = NDArray[np.float64]


def product(left: Matrix, right: Matrix) -> Matrix:
    """The product of two f64[4, 4], or of one and many f64[n, 4, 4]."""
    total: Matrix = left[:, 0, None] * right[..., None, 0, :]
    for k in (1, 2, 3):
        total = total + left[:, k, None] * right[..., None, k, :]
    return total


def from_parts(translation: tuple[float, ...], quaternion: tuple[float, ...], scale: tuple[float, ...]) -> Matrix:
    """Translation · rotation · scale, f64[4, 4]; the quaternion (x, y, z, w) must not be 0, and is normalised."""
    matrix: Matrix = from_many_parts(np.array([translation]), np.array([quaternion]), np.array([scale]))[0]
    return matrix


def from_many_parts(translations: Matrix, quaternions: Matrix, scales: Matrix) -> Matrix:
    """f64[n, 4, 4] of f64[n, 3], f64[n, 4] and f64[n, 3]; see `from_parts`."""
    x, y, z, w = quaternions.T
    x, y, z, w = (quaternions / np.sqrt(x * x + y * y + z * z + w * w)[:, None]).T
    result = np.zeros((len(quaternions), 4, 4))
    columns = (
        (1 - 2 * (y * y + z * z), 2 * (x * y + z * w), 2 * (x * z - y * w)),
        (2 * (x * y - z * w), 1 - 2 * (x * x + z * z), 2 * (y * z + x * w)),
        (2 * (x * z + y * w), 2 * (y * z - x * w), 1 - 2 * (x * x + y * y)),
    )
    for column, rows in enumerate(columns):
        for row, turned in enumerate(rows):
            result[:, row, column] = turned * scales[:, column]
    result[:, :3, 3] = translations
    result[:, 3, 3] = 1.0
    return result


def cofactors(matrix: Matrix) -> Matrix:
    """The cofactors of the linear part [3, 3]: what carries normals, up to the determinant's sign and size."""
    (a, b, c), (d, e, f), (g, h, i) = matrix[:3, :3].tolist()
    return np.array(
        [
            [e * i - f * h, f * g - d * i, d * h - e * g],
            [h * c - i * b, i * a - g * c, g * b - h * a],
            [b * f - c * e, c * d - a * f, a * e - b * d],
        ]
    )


def determinant(matrix: Matrix) -> float:
    """Of the linear part."""
    return float((matrix[0, :3] * cofactors(matrix)[0]).sum())


def determinants(matrices: Matrix) -> Matrix:
    """f64[n] of the linear parts of f64[n, 4, 4]."""
    a, b, c = (matrices[:, 0, axis] for axis in range(3))
    d, e, f = (matrices[:, 1, axis] for axis in range(3))
    g, h, i = (matrices[:, 2, axis] for axis in range(3))
    result: Matrix = a * (e * i - f * h) + b * (f * g - d * i) + c * (d * h - e * g)
    return result


def move_points(matrix: Matrix, points: NDArray[np.floating]) -> Matrix:
    """f64[n, 3] of points [n, 3]."""
    return move_vectors(matrix[:3, :3], points) + matrix[:3, 3]


def move_vectors(linear: Matrix, vectors: NDArray[np.floating]) -> Matrix:
    """f64[n, 3] of vectors [n, 3] under a [3, 3]."""
    x, y, z = (vectors[:, axis].astype(np.float64)[:, None] for axis in range(3))
    moved: Matrix = x * linear[:, 0] + y * linear[:, 1] + z * linear[:, 2]
    return moved


def rigid(matrix: Matrix) -> Matrix | None:
    """The rotation and translation nearest to what a camera's matrix means: -Z stays, Y is made square to it.

    None if the matrix mirrors or is singular.
    """
    backwards, up = matrix[:3, 2], matrix[:3, 1]
    size = np.sqrt((matrix[:3, :3] ** 2).sum())
    if not np.isfinite(size) or determinant(matrix) <= 1e-12 * size**3:
        return None
    z = backwards / np.sqrt((backwards**2).sum())
    y = up - z * (z * up).sum()
    y = y / np.sqrt((y**2).sum())
    result = np.eye(4)
    result[:3, 0], result[:3, 1], result[:3, 2], result[:3, 3] = np.cross(y, z), y, z, matrix[:3, 3]
    return result
