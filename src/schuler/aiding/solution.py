"""What a navigation run returns: the track with its covariance, the states it learnt, its innovations.

Everything is SI and radians. Frames: n = NED at the vehicle, b = forward-right-down.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass
class Solution:
    """A track; row i has seen every measurement stamped <= time[i] (a filter) or all of them (a smoother).

    time (n,) s; lat, lon (n,) rad; height (n,) m, up; v_n (n, 3) m/s NED, over ground; rpy (n, 3) rad, heading
    clockwise from north; cov_pos (n, 3, 3) m^2 in NED metres; cov_vel (n, 3, 3) (m/s)^2; cov_rpy (n, 3, 3) rad^2 of
    roll, pitch, heading. A quantity that the kind cannot fill is NaN throughout.
    """

    time: Array
    lat: Array
    lon: Array
    height: Array
    v_n: Array
    rpy: Array
    cov_pos: Array
    cov_vel: Array
    cov_rpy: Array

    def __len__(self) -> int:
        return len(self.time)


@dataclass
class StateHistory:
    """One scalar state over time: estimate and 1-sigma, SI (rad, rad/s, m/s, or a pure ratio)."""

    name: str  # e.g. "gyro_bias_z", "current_north", "speed_scale", "heading_offset"
    unit: str  # SI unit: "rad/s", "m/s", "rad", "1"
    time: Array
    value: Array
    std: Array
    smoothed: Array | None = None  # at the same times
    smoothed_std: Array | None = None


@dataclass
class Innovations:
    """Innovations of one kind of measurement ("gnss_position", "gnss_velocity", "speed", "depth", "magnetometer", ...).

    time (m,) s; value (m, d) measured minus predicted; std (m, d) root of the diagonal of S; nis (m,) y' S^-1 y (d
    degrees of freedom); used (m,) bool, False where the gate left the measurement out; weight (m,) 1 in full, below
    1 weakened, 0 refused, None where the kind does not say; component names and SI unit.
    """

    kind: str
    components: tuple[str, ...]
    unit: str
    time: Array
    value: Array
    std: Array
    nis: Array
    used: NDArray[np.bool_]
    weight: Array | None = None


@dataclass
class Navigation:
    """All that a navigation run gives back. notes: sentences for the user (what was assumed, left out, found)."""

    filter: Solution
    smoother: Solution | None = None
    states: dict[str, StateHistory] = field(default_factory=dict)
    innovations: dict[str, Innovations] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    extras: dict[str, Any] = field(default_factory=dict)  # what a kind adds: "metres", "beacons"
