"""Sums of a pass, to and from the rows of those paths that have something."""

from __future__ import annotations

from numba import njit


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def pack_rows(table, first, last, paths, rows):  # type: ignore[no-untyped-def]
    """Gather the rows of which any column from `first` up to `last` is not 0; returns how many there are.

    table int64 or int32 [n, columns]; paths uint16[n] receives their numbers, ascending, rows [n, columns] themselves.
    """
    count = 0
    for path in range(table.shape[0]):
        found = False
        for column in range(first, last):
            found = found or table[path, column] != 0
        if found:
            paths[count] = path
            for column in range(table.shape[1]):
                rows[count, column] = table[path, column]
            count += 1
    return count


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def add_rows(table, paths, rows):  # type: ignore[no-untyped-def]
    """Add each row to that of its path; paths are ascending and in range."""
    for i in range(paths.shape[0]):
        for column in range(table.shape[1]):
            table[paths[i], column] += rows[i, column]
