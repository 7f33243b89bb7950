"""A laser scanner on a vehicle: reach, noise, divergence, lever arm, and the size of its spot on the ground.

A beam's azimuth counts clockwise from forward seen from above, its elevation upwards from the body's x-y plane.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from schuler.ground.errors import InputError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Lidar:
    """sigma m of one range; farthest m; divergence rad (full angle); l_b (3,) from the IMU to it, body FRD, m."""

    sigma: float = 0.05
    farthest: float = 1000.0
    divergence: float = 0.0
    l_b: Array = field(default_factory=lambda: np.zeros(3))
    name: str = "lidar"

    def __post_init__(self) -> None:
        if not (self.sigma > 0.0 and self.farthest > 0.0 and 0.0 <= self.divergence < 0.5):
            raise InputError(
                f"{self.name}: sigma {self.sigma} m and reach {self.farthest} m must be above 0, the divergence "
                f"{self.divergence} rad from 0 to 0.5"
            )
        object.__setattr__(self, "l_b", np.ascontiguousarray(self.l_b, dtype=np.float64))


# The scanners that the thesis on strapdown INS (2022), section 3.2, names; its figures.
SCANNERS = {
    "yellowscan-ultralight": Lidar(0.1, 150.0, 0.0, name="YellowScan ultra-light"),
    "riegl-lms-q240i-60": Lidar(0.02, 260.0, 2.7e-3, name="RIEGL LMS-Q240i-60"),
    "ibeo-lux-8l": Lidar(0.1, 1000.0, 0.0, name="iBeo LUX 8L"),
}


def footprint(height: ArrayLike, divergence: ArrayLike, angle: ArrayLike = 0.0, slope: ArrayLike = 0.0) -> Array:
    """Length of the spot on the ground in the plane of beam and slope, m: (4.25)-(4.27) put right, exact.

    height: m, of the lidar above the point where the near edge of the beam meets the ground. divergence: full angle,
    rad. angle: of the beam off nadir. slope: of the ground, falling away along the beam. A = h sin g / (cos(be - g/2)
    cos(be + g/2 + i)); InputError where the far edge misses the ground.
    """
    h, g, be, i = (np.asarray(x, dtype=np.float64) for x in (height, divergence, angle, slope))
    far = np.cos(be + 0.5 * g + i)
    if np.any(far <= 0.0):
        raise InputError("the far edge of the beam does not meet the ground: angle + slope reach 90 deg")
    return np.asarray(h * np.sin(g) / (np.cos(be - 0.5 * g) * far))
