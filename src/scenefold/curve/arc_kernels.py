# mypy: disallow-untyped-defs=False, disallow-untyped-calls=False, disallow-incomplete-defs=False, warn-return-any=False
"""The compiled part of arcs.py: finding the gaps of a box on the line, and where each truly begins and ends.

A location is three words (high, middle, low), as in kernels.py, with ones or zeros in all bits behind a
node's prefix. A node of the curve's tree is its lowest corner, its prefix on the line and its state. Whether
its children miss the box, or are cut by it, stands in four masks of one bit an axis, as symbols have them:
so a child costs two ANDs. What is on three words is in tuples: numba compiles that much faster than slices.
"""

from __future__ import annotations

import numpy as np
from numba import njit

ZERO = np.uint64(0)
ONE = np.uint64(1)
WORD = np.uint64(64)
TWO_WORDS = np.uint64(128)
THREE_WORDS = np.uint64(192)
ALL = np.uint64(0xFFFFFFFFFFFFFFFF)


@njit(nogil=True, cache=True)
def find_gaps(low, high, table, levels, limit):
    """The hull of a box (uint64[2, 3]), its gaps (uint64[m, 2, 3], ascending) and by how much an end of one may be
    off (0.0: these are all gaps, and exact)."""
    dimensions = low.size
    bits = np.uint64(dimensions)
    children = 1 << dimensions
    first = (ZERO, ZERO, ZERO)
    last = (ALL, ALL, ALL)
    corners = np.zeros((1, dimensions), np.uint64)
    _, _, cut_lower, cut_upper = _halves(corners, np.int64(0), ONE << np.uint64(levels - 1), low, high)
    count = 0
    if cut_lower | cut_upper:
        count = 1
        first = _nearest(first, True, low, high, table, levels)
        last = _nearest(last, False, low, high, table, levels)
    hull = np.empty((2, 3), np.uint64)
    hull[0, 0], hull[0, 1], hull[0, 2] = first
    hull[1, 0], hull[1, 1], hull[1, 2] = last
    gaps = np.empty((0, 6), np.uint64)
    prefixes = np.zeros((1, 3), np.uint64)
    states = np.zeros(1, np.uint64)
    wanted = limit - 1
    frontier_max = 4 * limit + 256
    unit = 0.0
    level = 0
    while count > 0 and wanted > 0:
        enough = len(gaps) >= wanted
        half = ONE << np.uint64(levels - 1 - level)
        end = np.uint64(dimensions * (level + 1))
        next_corners = np.empty((2 * count + children, dimensions), np.uint64)
        next_prefixes = np.empty((2 * count + children, 3), np.uint64)
        next_states = np.empty(2 * count + children, np.uint64)
        next_count = int(np.int64(0))  # a literal would have what is called with it compiled twice
        found = np.empty((count + children, 6), np.uint64)
        found_count = int(np.int64(0))
        for node in range(count):
            no_lower, no_upper, cut_lower, cut_upper = _halves(corners, node, half, low, high)
            prefix = (prefixes[node, 0], prefixes[node, 1], prefixes[node, 2])
            row = states[node] << bits
            outside_from = -1
            for digit in range(children + 1):
                entry = ZERO
                if digit < children:
                    entry = np.uint64(table[row | np.uint64(digit)])
                    if (entry & no_upper) | (~entry & no_lower):
                        if outside_from < 0:
                            outside_from = digit
                        continue
                if outside_from >= 0:
                    begin = _put(prefix, np.uint64(outside_from), end)
                    until = _filled(_put(prefix, np.uint64(digit - 1), end), end)
                    outside_from = -1
                    if _less(first, begin) and _less(until, last):
                        if found_count == len(found):
                            found = _grown(found)
                        found[found_count, 0], found[found_count, 1], found[found_count, 2] = begin
                        found[found_count, 3], found[found_count, 4], found[found_count, 5] = until
                        found_count += 1
                if digit < children and (entry & cut_upper) | (~entry & cut_lower):
                    if next_count == len(next_states):
                        if next_count < 2 * frontier_max:
                            next_corners = _grown(next_corners)
                            next_prefixes = _grown(next_prefixes)
                            next_states = _grown_row(next_states)
                        else:
                            frontier_max = limit + 32
                            next_count = _keep_most_outside(
                                next_corners, next_prefixes, next_states, next_count, half, low, high, frontier_max
                            )
                            unit = max(unit, _size_behind(end))
                    place = _put(prefix, np.uint64(digit), end)
                    next_prefixes[next_count, 0], next_prefixes[next_count, 1], next_prefixes[next_count, 2] = place
                    next_states[next_count] = entry >> bits
                    for axis in range(dimensions):
                        upper = (entry >> np.uint64(dimensions - 1 - axis)) & ONE
                        next_corners[next_count, axis] = corners[node, axis] | (half * upper)
                    next_count += 1
        gaps = _merged(gaps, found, found_count)
        if enough and next_count > 0:
            unit = max(unit, _size_behind(end))
            break
        if next_count > frontier_max:
            frontier_max = limit + 32
            next_count = _keep_most_outside(next_corners, next_prefixes, next_states, next_count, half, low, high, frontier_max)
            unit = max(unit, _size_behind(end))
        corners = next_corners
        prefixes = next_prefixes
        states = next_states
        count = next_count
        level += 1
    return hull, gaps.reshape(len(gaps), 2, 3), unit


@njit(nogil=True, cache=True)
def sides_of_gaps(gaps, exact, low, high, table, levels):
    """Of each gap: the last location before it and the first behind it that are in the box (uint64[m, 2, 3])."""
    sides = np.empty_like(gaps)
    for index in range(len(gaps)):
        before = _decreased((gaps[index, 0, 0], gaps[index, 0, 1], gaps[index, 0, 2]))
        behind = _increased((gaps[index, 1, 0], gaps[index, 1, 1], gaps[index, 1, 2]))
        if not exact:
            before = _nearest(before, False, low, high, table, levels)
            behind = _nearest(behind, True, low, high, table, levels)
        sides[index, 0, 0], sides[index, 0, 1], sides[index, 0, 2] = before
        sides[index, 1, 0], sides[index, 1, 1], sides[index, 1, 2] = behind
    return sides


@njit(nogil=True, cache=True)
def lengths(runs):
    """Last minus first of runs (uint64[m, 2, 3]), in units of the last of 192 bits."""
    result = np.empty(len(runs), np.float64)
    for index in range(len(runs)):
        run = runs[index]
        low = run[1, 2] - run[0, 2]
        borrow = np.uint64(run[1, 2] < run[0, 2])
        middle = run[1, 1] - run[0, 1] - borrow
        borrow = np.uint64(run[1, 1] < run[0, 1] or (run[1, 1] == run[0, 1] and borrow == ONE))
        high = run[1, 0] - run[0, 0] - borrow
        result[index] = (np.float64(high) * 18446744073709551616.0 + np.float64(middle)) * 18446744073709551616.0 + np.float64(low)
    return result


@njit(nogil=True, cache=True)
def _halves(corners, node, half, low, high):
    """Of a node with sides of two halves: the axes whose lower half misses the box, whose upper half does, whose
    lower half is not wholly within it, whose upper half is not."""
    no_lower = ZERO
    no_upper = ZERO
    cut_lower = ZERO
    cut_upper = ZERO
    for axis in range(low.size):
        begin = corners[node, axis]
        middle = begin + half
        no_lower = (no_lower << ONE) | np.uint64(low[axis] > middle - ONE or high[axis] < begin)
        no_upper = (no_upper << ONE) | np.uint64(high[axis] < middle or low[axis] > middle + (half - ONE))
        cut_lower = (cut_lower << ONE) | np.uint64(low[axis] > begin or high[axis] < middle - ONE)
        cut_upper = (cut_upper << ONE) | np.uint64(low[axis] > middle or high[axis] < middle + (half - ONE))
    return no_lower, no_upper, cut_lower, cut_upper


@njit(nogil=True, cache=True)
def _nearest(target, forward, low, high, table, levels):
    """The box's first location from `target` on, or its last one up to it; `target` itself if there is none.

    Down along the target's own digits while they lead into the box, up until a later sibling does, and from there
    down to the first (last) child that lies wholly within.
    """
    dimensions = low.size
    bits = np.uint64(dimensions)
    children = 1 << dimensions
    step = 1 if forward else -1
    states = np.zeros(levels, np.uint64)
    corner = np.zeros((1, dimensions), np.uint64)
    place = target
    following = True
    level = 0
    state = ZERO
    candidate = np.int64(_digit(target, ZERO, bits))
    while True:
        half = ONE << np.uint64(levels - 1 - level)
        no_lower, no_upper, cut_lower, cut_upper = _halves(corner, np.int64(0), half, low, high)
        entry = ZERO
        while 0 <= candidate < children:
            entry = np.uint64(table[(state << bits) | np.uint64(candidate)])
            if not (entry & no_upper) | (~entry & no_lower):
                break
            candidate += np.int64(step)
        if not 0 <= candidate < children:
            if level == 0:
                return target
            level -= 1
            for axis in range(dimensions):
                corner[0, axis] &= ~((half << ONE) | ((half << ONE) - ONE))
            state = states[level]
            candidate = np.int64(_digit(target, np.uint64(dimensions * level), bits)) + np.int64(step)
            continue
        start = np.uint64(dimensions * level)
        end = start + bits
        following = following and np.uint64(candidate) == _digit(target, start, bits)
        place = _put(_cleared(place, start), np.uint64(candidate), end)
        if not (entry & cut_upper) | (~entry & cut_lower):
            if following:
                return target
            return place if forward else _filled(place, end)
        if following:
            place = target
        for axis in range(dimensions):
            corner[0, axis] |= half * ((entry >> np.uint64(dimensions - 1 - axis)) & ONE)
        states[level] = state
        state = entry >> bits
        level += 1
        candidate = np.int64(0 if forward else children - 1)
        if following:
            candidate = np.int64(_digit(target, end, bits))


@njit(nogil=True, cache=True)
def _keep_most_outside(corners, prefixes, states, count, side, low, high, count_max):
    """Keep the `count_max` nodes of which most lies outside the box: at the front, in their order. Their number."""
    outside = np.empty(count, np.float64)
    scale = 1.0 / np.float64(side)
    for node in range(count):
        within = 1.0
        for axis in range(low.size):
            begin = max(corners[node, axis], low[axis])
            last = min(corners[node, axis] + (side - ONE), high[axis])
            within *= (np.float64(last - begin) + 1.0) * scale
        outside[node] = 1.0 - within
    # The threshold by bisection: more than enough nodes reach `least`, too few pass `most`.
    least = 0.0
    most = 1.0
    for _ in range(30):
        middle = 0.5 * (least + most)
        above = 0
        for node in range(count):
            above += outside[node] > middle
        if above > count_max:
            least = middle
        else:
            most = middle
    above = 0
    for node in range(count):
        above += outside[node] > most
    spare = count_max - above
    kept = 0
    for node in range(count):
        keep = outside[node] > most
        if not keep and outside[node] >= least and spare > 0:
            keep = True
            spare -= 1
        if keep:
            for axis in range(low.size):
                corners[kept, axis] = corners[node, axis]
            for word in range(3):
                prefixes[kept, word] = prefixes[node, word]
            states[kept] = states[node]
            kept += 1
    return kept


@njit(nogil=True, cache=True)
def _merged(left, right, right_count):
    """Two ascending lists of disjoint runs as one; runs that touch become one."""
    result = np.empty((len(left) + right_count, 6), np.uint64)
    count = 0
    at_left = 0
    at_right = 0
    behind = (ZERO, ZERO, ZERO)
    while at_left < len(left) or at_right < right_count:
        runs, at = right, at_right
        if at_left < len(left):
            left_first = (left[at_left, 0], left[at_left, 1], left[at_left, 2])
            if at_right == right_count or _less(left_first, (right[at_right, 0], right[at_right, 1], right[at_right, 2])):
                runs, at = left, at_left
                at_left += 1
            else:
                at_right += 1
        else:
            at_right += 1
        touches = count > 0 and behind[0] == runs[at, 0] and behind[1] == runs[at, 1] and behind[2] == runs[at, 2]
        if touches:
            count -= 1
        else:
            for word in range(3):
                result[count, word] = runs[at, word]
        for word in range(3, 6):
            result[count, word] = runs[at, word]
        behind = _increased((runs[at, 3], runs[at, 4], runs[at, 5]))
        count += 1
    return result[:count]


@njit(nogil=True, cache=True)
def _grown(rows):
    larger = np.empty((2 * rows.shape[0], rows.shape[1]), np.uint64)
    for row in range(rows.shape[0]):
        for column in range(rows.shape[1]):
            larger[row, column] = rows[row, column]
    return larger


@njit(nogil=True, cache=True)
def _grown_row(row):
    larger = np.empty(2 * row.size, np.uint64)
    for index in range(row.size):
        larger[index] = row[index]
    return larger


@njit(nogil=True, cache=True)
def _less(left, right):
    if left[0] != right[0]:
        return left[0] < right[0]
    if left[1] != right[1]:
        return left[1] < right[1]
    return left[2] < right[2]


@njit(nogil=True, cache=True)
def _increased(words):
    low = words[2] + ONE
    middle = words[1] + np.uint64(low == ZERO)
    return words[0] + np.uint64(low == ZERO and middle == ZERO), middle, low


@njit(nogil=True, cache=True)
def _decreased(words):
    middle = words[1] - np.uint64(words[2] == ZERO)
    return words[0] - np.uint64(words[2] == ZERO and words[1] == ZERO), middle, words[2] - ONE


@njit(nogil=True, cache=True)
def _size_behind(end):
    """Locations of a node whose prefix ends at bit `end`, in units of the last of 192 bits."""
    return 2.0 ** np.float64(THREE_WORDS - end)


@njit(nogil=True, cache=True)
def _put(words, digit, end):
    """With the digit whose last bit is just before bit `end`; its bits are zero until now."""
    if end <= WORD:
        return words[0] | (digit << (WORD - end)), words[1], words[2]
    if end < TWO_WORDS:
        return words[0] | (digit >> (end - WORD)), words[1] | (digit << (TWO_WORDS - end)), words[2]
    if end == TWO_WORDS:
        return words[0], words[1] | digit, words[2]
    return words[0], words[1] | (digit >> (end - TWO_WORDS)), words[2] | (digit << (THREE_WORDS - end))


@njit(nogil=True, cache=True)
def _digit(words, start, width):
    """The digit of `width` <= 8 bits from bit `start` on."""
    end = start + width
    if end <= WORD:
        digit = words[0] >> (WORD - end)
    elif end <= TWO_WORDS:
        digit = words[1] >> (TWO_WORDS - end)
        if start < WORD:
            digit |= words[0] << (end - WORD)
    else:
        digit = words[2] >> (THREE_WORDS - end)
        if start < TWO_WORDS:
            digit |= words[1] << (end - TWO_WORDS)
    return digit & ((ONE << width) - ONE)


@njit(nogil=True, cache=True)
def _filled(words, end):
    """With all bits from `end` on set."""
    if end <= WORD:
        return words[0] | _ones(WORD - end), ALL, ALL
    if end <= TWO_WORDS:
        return words[0], words[1] | _ones(TWO_WORDS - end), ALL
    return words[0], words[1], words[2] | _ones(THREE_WORDS - end)


@njit(nogil=True, cache=True)
def _cleared(words, end):
    """With all bits from `end` on cleared."""
    if end <= WORD:
        return words[0] & ~_ones(WORD - end), ZERO, ZERO
    if end <= TWO_WORDS:
        return words[0], words[1] & ~_ones(TWO_WORDS - end), ZERO
    return words[0], words[1], words[2] & ~_ones(THREE_WORDS - end)


@njit(nogil=True, cache=True)
def _ones(count):
    return ALL if count >= WORD else (ONE << count) - ONE
