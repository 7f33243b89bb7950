"""When a sensor was distrusted: the stretches in which its measurements were left out, or counted little."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from schuler.aiding.solution import Innovations

AGAIN = 3  # measurements used in a row end a stretch
FEWEST = 3  # distrusted measurements make a stretch; fewer are outliers
LITTLE = 0.25  # weight (stated variance over the one that was used) below which a measurement counts as distrusted


def distrusted(innovations: Mapping[str, Innovations] | Iterable[Innovations]) -> list[dict[str, Any]]:
    """[{"sensor", "start_s", "end_s", "rows", "of"}] in order of time: `rows` of `of` measurements of a kind were left
    out, or used with an inflated variance, from start_s to end_s.

    An `Innovations` may carry `weight` (m,), 1 where the stated sigma was used, less where it was inflated.
    """
    kinds = innovations.values() if isinstance(innovations, Mapping) else innovations
    found = [entry for kind in kinds for entry in _stretches(kind)]
    return sorted(found, key=lambda e: (e["start_s"], e["sensor"]))


def doubted(kind: Innovations) -> NDArray[np.bool_]:
    """(m,) measurements that were left out or counted little."""
    doubt = ~np.asarray(kind.used, dtype=bool)
    weight = getattr(kind, "weight", None)
    if weight is not None and len(weight) == len(doubt):
        with np.errstate(invalid="ignore"):
            doubt |= np.asarray(weight, dtype=float) < LITTLE
    return doubt


def _stretches(kind: Innovations) -> list[dict[str, Any]]:
    doubt = doubted(kind)
    rows = np.flatnonzero(doubt)
    if len(rows) < FEWEST:
        return []
    found = []
    for part in np.split(rows, np.flatnonzero(np.diff(rows) > AGAIN) + 1):
        if len(part) >= FEWEST:
            found.append(
                {
                    "sensor": kind.kind,
                    "start_s": float(kind.time[part[0]]),
                    "end_s": float(kind.time[part[-1]]),
                    "rows": len(part),
                    "of": int(part[-1] - part[0] + 1),
                }
            )
    return found
