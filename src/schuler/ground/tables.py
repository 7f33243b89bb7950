"""The tables of the contract: columns, units, validation and its messages.

A `Table` holds numpy columns in SI and radians (the file's degrees are gone), plus `time` in seconds on one clock.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass
class Table:
    """Named columns of equal length. Numbers are float64 in SI and radians; `id` columns are str arrays.

    name : the contract's name ("imu", "gnss", "speed", "dvl", "depth", "attitude", "reference", ...).
    kind : "rates" or "increments" for an imu table, else "".
    notes : what a reader assumed, converted or left out, as sentences.
    """

    name: str
    columns: dict[str, NDArray]
    kind: str = ""
    source: str = ""
    notes: list[str] = field(default_factory=list)

    @property
    def time(self) -> Array:
        return self.columns["time"]

    def __len__(self) -> int:
        return len(self.columns["time"])

    def __contains__(self, column: str) -> bool:
        return column in self.columns

    def __getitem__(self, column: str) -> NDArray:
        return self.columns[column]

    def stack(self, *columns: str) -> Array:
        """(n, k) array of the named columns."""
        return np.column_stack([self.columns[c] for c in columns])

    def where(self, mask: NDArray[np.bool_]) -> Table:
        """The rows that a boolean mask keeps."""
        return Table(self.name, {k: v[mask] for k, v in self.columns.items()}, self.kind, self.source, list(self.notes))


Tables = Mapping[str, Table]
