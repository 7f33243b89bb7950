"""A pinhole camera on a vehicle: focal length, principal point, mounting, lever arm; and where points appear in it.

Camera axes: x right, y up, z toward the viewer; what is seen has z < 0. u = u0 - f x/z, v = v0 - f y/z, so u counts to
the right and v upwards. n = NED, b = body FRD; f_camera = Rz(yaw) Ry(pitch) Rx(roll) f_body.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from schuler.ground.errors import InputError
from schuler.ground.frames import dcm_from_euler

Array = NDArray[np.float64]
NADIR = np.diag([1.0, -1.0, -1.0])  # roll 180 deg: x forward, y left, z up
NEAREST = 1e-3  # m, least depth of what is seen


@dataclass(frozen=True)
class Camera:
    """focal, u0, v0, sigma: px (sigma of one coordinate of a sighting). C_cb (3, 3): body to camera components.
    l_b (3,): from the IMU to the camera, body FRD, m. half_width, half_height: px from the principal point to the edge
    of the picture, None where it is not known."""

    focal: float
    u0: float = 0.0
    v0: float = 0.0
    sigma: float = 1.0
    C_cb: Array = field(default_factory=NADIR.copy)
    l_b: Array = field(default_factory=lambda: np.zeros(3))
    half_width: float | None = None
    half_height: float | None = None

    def __post_init__(self) -> None:
        C, arm = np.asarray(self.C_cb, dtype=np.float64), np.asarray(self.l_b, dtype=np.float64)
        if not (np.isfinite(self.focal) and self.focal > 0.0 and self.sigma > 0.0):
            raise InputError(
                f"the camera's focal length is {self.focal} px and its sigma {self.sigma} px: both must be above 0"
            )
        if C.shape != (3, 3) or arm.shape != (3,) or not np.all(np.isfinite(arm)):
            raise InputError("the camera needs a mounting C_cb (3, 3) and a lever arm of three numbers in m")
        if not np.allclose(C @ C.T, np.eye(3), atol=1e-9) or np.linalg.det(C) < 0.0:
            raise InputError("the camera's mounting is not a rotation: give body_to_camera_rpy_deg")
        object.__setattr__(self, "C_cb", np.ascontiguousarray(C))
        object.__setattr__(self, "l_b", np.ascontiguousarray(arm))

    @classmethod
    def of(
        cls, focal_px: float, *, u0_px: float = 0.0, v0_px: float = 0.0, sigma_px: float = 1.0,
        body_to_camera_rpy_deg: ArrayLike = (180.0, 0.0, 0.0), position_frd_m: ArrayLike = (0.0, 0.0, 0.0),
        half_width_px: float | None = None, half_height_px: float | None = None,
    ) -> Camera:  # fmt: skip
        """From the keys of the study's `[camera]`."""
        C = dcm_from_euler(*np.radians(np.asarray(body_to_camera_rpy_deg, dtype=np.float64)))
        arm = np.asarray(position_frd_m, dtype=np.float64)
        return cls(focal_px, u0_px, v0_px, sigma_px, C, arm, half_width_px, half_height_px)

    def vectors(self, points_n: ArrayLike, r_n: ArrayLike, C_nb: ArrayLike) -> Array:
        """(n, 3) m, camera axes: points (n, 3) seen from an IMU at r_n (3,) or (n, 3), attitude C_nb (3, 3) or (n, 3,
        3)."""
        p = np.asarray(points_n, dtype=np.float64) - np.asarray(r_n, dtype=np.float64)
        C = np.asarray(C_nb, dtype=np.float64)
        b = np.einsum("...ji,...j->...i", C, p) - self.l_b
        return np.asarray(b @ self.C_cb.T)

    def project(self, points_n: ArrayLike, r_n: ArrayLike, C_nb: ArrayLike) -> tuple[Array, NDArray[np.bool_]]:
        """(n, 2) px, NaN where a point is not in front of the camera, and (n,) whether it is."""
        x = self.vectors(points_n, r_n, C_nb)
        front = x[..., 2] < -NEAREST
        z = np.where(front, x[..., 2], np.nan)
        uv = np.stack([self.u0 - self.focal * x[..., 0] / z, self.v0 - self.focal * x[..., 1] / z], axis=-1)
        return uv, front

    def inside(self, uv: ArrayLike) -> NDArray[np.bool_]:
        """Whether pixels (n, 2) lie in the picture; all that are finite do where its size is not known."""
        a = np.asarray(uv, dtype=np.float64)
        good = np.asarray(np.isfinite(a).all(axis=-1))
        with np.errstate(invalid="ignore"):
            if self.half_width is not None:
                good &= np.abs(a[..., 0] - self.u0) <= self.half_width
            if self.half_height is not None:
                good &= np.abs(a[..., 1] - self.v0) <= self.half_height
        return good

    def directions(self, uv: ArrayLike) -> Array:
        """(n, 3) unit vectors in camera axes toward pixels (n, 2)."""
        a = np.asarray(uv, dtype=np.float64)
        d = np.stack(
            [(a[..., 0] - self.u0) / self.focal, (a[..., 1] - self.v0) / self.focal, -np.ones(a.shape[:-1])], axis=-1
        )
        return d / np.linalg.norm(d, axis=-1, keepdims=True)
