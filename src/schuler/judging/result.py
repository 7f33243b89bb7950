"""What one study gives: the navigation, what it was judged against, and the figures of its summary."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from schuler.aiding.solution import Navigation
from schuler.ground.tables import Table

Array = NDArray[np.float64]


@dataclass
class Result:
    """A finished study.

    study : the study file as read (`schuler.studies.model.Study`); `study.study.name`, `study.study.kind`.
    made_by : {"version", "seed", "study_sha256"}.
    navigation : filter and smoother tracks, learnt states, innovations.
    reference : Table "reference" (SI, radians) or None; it was never read by the filter.
    truth_states : name of a learnt state -> (time (n,), value (n,)) in SI, where the truth is known (a simulation).
    tables : what the filter was given, outages already withheld.
    withheld : the rows of the outages, by sensor.
    summary : the content of summary.json (plain numbers, strings, lists, dicts; None where not known).
    notes : sentences for the user: what was assumed, converted, left out, found.
    details : what a kind keeps for its own chapters of the page, of its own type.
    """

    study: Any  # studies.model.Study; that module stands above this one
    made_by: dict[str, Any]
    navigation: Navigation
    reference: Table | None
    truth_states: dict[str, tuple[Array, Array]]
    tables: Mapping[str, Table]
    withheld: Mapping[str, Table]
    summary: dict[str, Any]
    notes: list[str] = field(default_factory=list)
    details: Any = None
