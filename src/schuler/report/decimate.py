"""Fewer points in a line without losing what the eye would see.

A line of n points drawn on a thousand pixels shows, per pixel column, only its lowest and highest value. Keeping these
two per bucket (min-max decimation) leaves every spike in place, which taking each k-th row does not.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

LIMIT = 5000  # points of one line, at most
POINTS = 1600  # points of one line on the page


def keep(lines: list[NDArray[np.float64]], points: int = POINTS) -> NDArray[np.intp]:
    """Rows to keep, increasing, so that every one of several lines over the same rows keeps its lows and highs.

    lines : k arrays of shape (n,), drawn over the same abscissa; NaN allowed.
    points : rows to keep, about (at least 2 k + 2, never more than LIMIT); all rows are kept where n is not larger.
    Returns (m,) indices, m <= max(points, 4 k + 2): the first row, the last, and of each bucket each line's lowest and
    highest finite value; of a bucket that holds NaN also its first NaN, so that a gap stays a gap.
    """
    points = min(points, LIMIT)
    n = len(lines[0]) if lines else 0
    if n <= points:
        return np.arange(n, dtype=np.intp)
    k = len(lines)
    gaps = [~np.isfinite(line) for line in lines]
    extremes = 2 * k + sum(bool(g.any()) for g in gaps)
    buckets = max((points - 2) // extremes, 1)
    edges = np.linspace(0, n, buckets + 1).astype(np.intp)
    width = int(np.diff(edges).max())
    # One (buckets, width) table of row numbers; the few cells past a bucket's end repeat its last row.
    rows = np.minimum(edges[:-1, None] + np.arange(width)[None, :], edges[1:, None] - 1)
    first = np.arange(buckets)
    kept = [np.array([0, n - 1], dtype=np.intp)]
    for line, gap in zip(lines, gaps, strict=True):
        cells = np.asarray(line, dtype=float)[rows]
        missing = gap[rows]
        kept.append(rows[first, np.argmin(np.where(missing, np.inf, cells), axis=1)])
        kept.append(rows[first, np.argmax(np.where(missing, -np.inf, cells), axis=1)])
        if gap.any():
            has_gap = missing.any(axis=1)
            kept.append(rows[first, np.argmax(missing, axis=1)][has_gap])
    return np.unique(np.concatenate(kept))


def thin(n: int, points: int = POINTS) -> NDArray[np.intp]:
    """Row numbers of at most `points` of n separate marks (not a line), evenly spread, first and last included."""
    if n <= points:
        return np.arange(n, dtype=np.intp)
    return np.unique(np.linspace(0, n - 1, points).astype(np.intp))
