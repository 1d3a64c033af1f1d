"""Where rays go next inside one node: back on the local stack, or out to the owner of their next cell."""

from __future__ import annotations

from numba import njit

from scenefold.base.rays import RAY_WORDS
from scenefold.render.shade_kernels import STATUS_FORWARD


@njit(error_model="numpy", _nrt=False)
def _copy(target, at, source, i):  # type: ignore[no-untyped-def]
    """One record, word by word: numba's assignment of rows is several times slower, and may allocate."""
    for word in range(RAY_WORDS):
        target[at, word] = source[i, word]


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def take_forwarded(rays, status, out, made):  # type: ignore[no-untyped-def]
    """Append the batch's forwarded rays to `out` behind its `made` new ones; returns the new count."""
    for i in range(rays.shape[0]):
        if status[i] == STATUS_FORWARD:
            _copy(out, made, rays, i)
            made += 1
    return made


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def split_by_owner(rays, owners, me, stack, top, leaving, leaving_owner, left):  # type: ignore[no-untyped-def]
    """Push my rays on the stack, append the others to `leaving`; returns the new (top, left)."""
    for i in range(rays.shape[0]):
        if owners[i] == me:
            _copy(stack, top, rays, i)
            top += 1
        else:
            _copy(leaving, left, rays, i)
            leaving_owner[left] = owners[i]
            left += 1
    return top, left


@njit(nogil=True, cache=True, error_model="numpy")
def group_by_owner(leaving, leaving_owner, left, first, grouped):  # type: ignore[no-untyped-def]
    """Stable counting sort by owner. first int64[owners + 1] receives where each owner's rays begin in `grouped`."""
    first[:] = 0
    for i in range(left):
        first[leaving_owner[i] + 1] += 1
    for owner in range(first.shape[0] - 1):
        first[owner + 1] += first[owner]
    place = first.copy()
    for i in range(left):
        owner = leaving_owner[i]
        _copy(grouped, place[owner], leaving, i)
        place[owner] += 1
