"""How wrong was an attitude: tilt, heading and total angle of the rotation that is left, wherever the nose points.

Roll, pitch and heading lose their meaning near pitch 90 deg; the angles here do not. Error = estimate - truth,
C_hat = (I - [phi x]) C.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from schuler.ground.frames import (
    dcm_from_quat,
    quat_conjugate,
    quat_from_euler,
    quat_from_rotvec,
    quat_multiply,
    rotvec_from_quat,
)
from schuler.ground.tables import Table
from schuler.judging.consistency import nees
from schuler.judging.errors import bridgeable, spread

Array = NDArray[np.float64]
DEG = np.pi / 180.0


@dataclass
class AttitudeErrors:
    """time (n,) s; phi (n, 3) rad in n; cov_phi (n, 3, 3) rad^2 as claimed; tilt, heading, total (n,) rad.

    tilt : angle between estimated and true vertical; heading : turn about the vertical, signed; total : angle of the
    whole rotation. offset : heading in rad that was taken out, where the heading is relative.
    """

    time: Array
    phi: Array
    cov_phi: Array
    tilt: Array
    heading: Array
    total: Array
    offset: float = 0.0

    def __len__(self) -> int:
        return len(self.time)

    @property
    def nees(self) -> Array:
        """(n,) per degree of freedom."""
        return nees(self.phi, self.cov_phi)

    @property
    def inside_3_sigma(self) -> float | None:
        """Share of the components of phi inside their own 3 sigma."""
        variance = np.diagonal(self.cov_phi, axis1=1, axis2=2)
        good = variance > 0.0
        return float(np.mean(np.abs(self.phi[good]) <= 3.0 * np.sqrt(variance[good]))) if good.any() else None

    def summary(self) -> dict[str, Any]:
        """{"tilt_deg": S, "heading_deg": S, "total_deg": S} of summary.json."""
        return {f"{k}_deg": spread(getattr(self, k) / DEG) for k in ("tilt", "heading", "total")}


def turned(time: Array, q: Array, at: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Attitudes q (n, 4) at other moments (m,), on the shortest way between neighbours, and which of them are known:
    inside, and no gap longer than `bridgeable`."""
    before = np.clip(np.searchsorted(time, at, side="right") - 1, 0, len(time) - 1)
    near = np.abs(at - time[np.minimum(before + 1, len(time) - 1)]) < 1e-6
    before = np.where(near, np.minimum(before + 1, len(time) - 1), before)
    on = np.abs(at - time[before]) < 1e-6
    after = np.minimum(before + 1, len(time) - 1)
    gap = time[after] - time[before]
    inside = on | ((at > time[before]) & (gap > 0.0) & (at < time[after]) & (gap <= bridgeable(time)))
    w = np.where(on | (gap <= 0.0), 0.0, (at - time[before]) / np.where(gap > 0.0, gap, 1.0))
    step = rotvec_from_quat(quat_multiply(quat_conjugate(q[before]), q[after]))
    return quat_multiply(q[before], quat_from_rotvec(np.clip(w, 0.0, 1.0)[:, None] * step)), inside


def attitude_errors(
    time: Array, q: Array, cov_phi: Array, reference: Table, *, relative: bool = False
) -> AttitudeErrors | None:
    """Errors of attitudes q (n, 4) with cov_phi (n, 3, 3) against a reference; None where nothing can be compared.

    At the rows of the denser of the two. relative : the heading error of the first compared row is taken out.
    """
    if not all(c in reference for c in ("roll", "pitch", "heading")) or len(time) == 0:
        return None
    rpy = reference.stack("roll", "pitch", "heading")
    known = np.isfinite(rpy).all(axis=1)
    if not known.any():
        return None
    t_ref, q_ref = reference.time[known], quat_from_euler(*rpy[known].T)
    if len(t_ref) > 1 and len(time) > 1 and np.median(np.diff(t_ref)) > 1.5 * np.median(np.diff(time)):
        at = t_ref
        q, good = turned(time, q, at)
        cov_phi = cov_phi[np.clip(np.searchsorted(time, at, side="right") - 1, 0, len(time) - 1)]
    else:
        at = time
        q_ref, good = turned(t_ref, q_ref, at)
    if not good.any():
        return None
    at, q, q_ref, cov_phi = at[good], q[good], q_ref[good], cov_phi[good]
    left = quat_multiply(q, quat_conjugate(q_ref))  # C_hat C'
    offset = 0.0
    if relative:
        offset = float(_heading(left[:1])[0])
        left = quat_multiply(quat_from_rotvec(np.array([0.0, 0.0, -offset])), left)
    rotvec = rotvec_from_quat(left)
    up = np.clip(dcm_from_quat(left)[:, 2, 2], -1.0, 1.0)
    return AttitudeErrors(at, -rotvec, cov_phi, np.arccos(up), _heading(left), np.linalg.norm(rotvec, axis=1), offset)


def _heading(left: Array) -> Array:
    """Turn about the vertical of rotations (n, 4), rad."""
    return 2.0 * np.arctan2(left[:, 3] * np.sign(left[:, 0] + 1e-300), np.abs(left[:, 0]))
