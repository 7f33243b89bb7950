"""The thesis on the accuracy of strapdown INS (2022, in Ukrainian): its figures, ours, verdicts.

"recomputation of ..." marks figures that the thesis does not print: they come from an independent recomputation.
"""

from __future__ import annotations

from collections.abc import Callable

from schuler.published import (
    sins_alignment,
    sins_calibration,
    sins_errata,
    sins_errors,
    sins_filters,
    sins_kinematics,
    sins_navigation,
    sins_optics,
)
from schuler.published.ledger import Row

TITLE = "Master thesis on the accuracy of strapdown INS: alignment, algorithms, error model, size effect, optics (2022)"


def rows(progress: Callable[[str], None] | None = None) -> list[Row]:
    """All rows, computed here and now (about ten seconds), but for the filters: theirs are kept from many runs."""
    made: list[Row] = []
    for step, part in (
        ("thesis: alignment", sins_alignment.rows),
        ("thesis: attitude equations and their drift", sins_kinematics.rows),
        ("thesis: navigation equations", sins_navigation.rows),
        ("thesis: listing A.1", sins_navigation.listing_rows),
        ("thesis: error growth, three runs of 4 h", sins_errors.rows),
        ("thesis: size effect and turntable", sins_calibration.rows),
        ("thesis: errata of chapter 4", sins_errata.rows),
        ("thesis: optics, chapters 4.4 and 5", sins_optics.rows),
        ("thesis: flights and filter listings", sins_filters.rows),
    ):
        if progress is not None:
            progress(step)
        made += part()
    return made
