"""Frames and rotations: Euler angles, direction cosine matrices, quaternions, rotation vectors; axis conventions.

n = NED, b = forward-right-down. C_nb and q_nb rotate b components into n: v_n = C_nb v_b. Quaternions are scalar
first, (..., 4), Hamilton's product; q and -q are the same rotation. Euler angles: heading (clockwise from north), pitch
(nose up), roll (right side down), about z, y, x in that order, so C_nb = Rz(heading) Ry(pitch) Rx(roll). A rotation
vector is the axis times the angle, rad. Every function works on arrays with any leading axes.

Sources: Shuster (1993), "A survey of attitude representations"; Markley (2008), "Unit quaternion from rotation
matrix" for the choice of row; REP 103 of ROS for ENU and forward-left-up.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from schuler.ground.earth import wrap_pi
from schuler.ground.errors import InputError

Array = NDArray[np.float64]

__all__ = [
    "axes_matrix",
    "dcm_from_euler",
    "dcm_from_quat",
    "dcm_from_rotvec",
    "dcm_ned_frd_from_enu_flu",
    "enu_from_ned",
    "enu_flu_from_ned_frd",
    "euler_from_dcm",
    "euler_from_quat",
    "flu_from_frd",
    "frd_from_flu",
    "frd_from_rfu",
    "heading_0_360",
    "heading_from_yaw_enu",
    "ned_from_enu",
    "ned_from_nwu",
    "nwu_from_ned",
    "orthonormalise",
    "quat_canonical",
    "quat_conjugate",
    "quat_from_dcm",
    "quat_from_euler",
    "quat_from_rotvec",
    "quat_from_scalar_last",
    "quat_multiply",
    "quat_ned_frd_from_enu_flu",
    "quat_normalise",
    "quat_rotate",
    "quat_to_scalar_last",
    "rfu_from_frd",
    "rotvec_from_dcm",
    "rotvec_from_quat",
    "skew",
    "wrap_pi",
    "yaw_enu_from_heading",
]


def _array(x: ArrayLike, last: int, what: str) -> Array:
    a = np.asarray(x, dtype=np.float64)
    if a.ndim == 0 or a.shape[-1] != last:
        raise InputError(f"{what} has shape {a.shape}; its last axis must have {last} components.")
    return a


def _dcm(C: ArrayLike) -> Array:
    a = np.asarray(C, dtype=np.float64)
    if a.shape[-2:] != (3, 3):
        raise InputError(f"a rotation matrix has shape {a.shape}; its last two axes must be (3, 3).")
    return a


def heading_0_360(angle: ArrayLike) -> Array:
    """Angles of any shape, rad, brought into [0, 2 pi): 0 to 360 degrees."""
    a = np.asarray(angle, dtype=np.float64)
    two_pi = 2.0 * np.pi
    turned = np.mod(a, two_pi)
    # A tiny negative angle comes out of mod as the full turn itself.
    return np.where((a >= 0.0) & (a < two_pi), a, np.where(turned >= two_pi, 0.0, turned))[()]


def skew(v: ArrayLike) -> Array:
    """[v x], (..., 3, 3): skew(a) @ b = a x b."""
    a = _array(v, 3, "a vector")
    S = np.zeros(a.shape[:-1] + (3, 3))
    S[..., 0, 1], S[..., 0, 2], S[..., 1, 2] = -a[..., 2], a[..., 1], -a[..., 0]
    S[..., 1, 0], S[..., 2, 0], S[..., 2, 1] = a[..., 2], -a[..., 1], a[..., 0]
    return S


def dcm_from_euler(roll: ArrayLike, pitch: ArrayLike, heading: ArrayLike) -> Array:
    """C_nb (..., 3, 3) of roll, pitch, heading in rad (arrays that broadcast together)."""
    r, p, h = np.broadcast_arrays(*(np.asarray(x, dtype=np.float64) for x in (roll, pitch, heading)))
    sr, cr, sp, cp, sh, ch = np.sin(r), np.cos(r), np.sin(p), np.cos(p), np.sin(h), np.cos(h)
    rows = [
        [cp * ch, sr * sp * ch - cr * sh, cr * sp * ch + sr * sh],
        [cp * sh, sr * sp * sh + cr * ch, cr * sp * sh - sr * ch],
        [-sp, sr * cp, cr * cp],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def euler_from_dcm(C_nb: ArrayLike) -> tuple[Array, Array, Array]:
    """Roll in (-pi, pi], pitch in [-pi/2, pi/2], heading in [0, 2 pi), rad, of C_nb (..., 3, 3).

    At a pitch of +-90 deg roll and heading are not unique; the pair returned still gives back C_nb, because the heading
    is read after the roll has been taken out.
    """
    C = _dcm(C_nb)
    roll = np.arctan2(C[..., 2, 1], C[..., 2, 2])
    pitch = np.arctan2(-C[..., 2, 0], np.hypot(C[..., 2, 1], C[..., 2, 2]))
    s, c = np.sin(roll), np.cos(roll)
    heading = np.arctan2(C[..., 0, 2] * s - C[..., 0, 1] * c, C[..., 1, 1] * c - C[..., 1, 2] * s)
    return roll, pitch, heading_0_360(heading)


def quat_multiply(p: ArrayLike, q: ArrayLike) -> Array:
    """p q (..., 4): rotation q first, then p; q_ac = quat_multiply(q_ab, q_bc)."""
    a, b = _array(p, 4, "a quaternion"), _array(q, 4, "a quaternion")
    a0, a1, a2, a3 = (a[..., i] for i in range(4))
    b0, b1, b2, b3 = (b[..., i] for i in range(4))
    return np.stack(
        [
            a0 * b0 - a1 * b1 - a2 * b2 - a3 * b3,
            a0 * b1 + a1 * b0 + a2 * b3 - a3 * b2,
            a0 * b2 - a1 * b3 + a2 * b0 + a3 * b1,
            a0 * b3 + a1 * b2 - a2 * b1 + a3 * b0,
        ],
        axis=-1,
    )


def quat_conjugate(q: ArrayLike) -> Array:
    """The inverse rotation of unit quaternions (..., 4): q_bn of q_nb."""
    return _array(q, 4, "a quaternion") * np.array([1.0, -1.0, -1.0, -1.0])


def quat_normalise(q: ArrayLike) -> Array:
    """Quaternions (..., 4) scaled to length one. Raises InputError for a zero or not finite one."""
    a = _array(q, 4, "a quaternion")
    n = np.linalg.norm(a, axis=-1, keepdims=True)
    if not np.all(np.isfinite(n) & (n > 0.0)):
        raise InputError("a quaternion is zero or not a number, so it is no rotation; the identity is (1, 0, 0, 0).")
    return a / n


def quat_canonical(q: ArrayLike) -> Array:
    """q or -q, whichever has q0 >= 0 (for output and comparison only)."""
    a = _array(q, 4, "a quaternion")
    return np.where(a[..., :1] < 0.0, -a, a)


def quat_rotate(q_nb: ArrayLike, v_b: ArrayLike) -> Array:
    """v_n (..., 3) of v_b (..., 3) for unit quaternions q_nb (..., 4); leading axes broadcast."""
    q, v = _array(q_nb, 4, "a quaternion"), _array(v_b, 3, "a vector")
    u = q[..., 1:]
    t = 2.0 * np.cross(u, v)
    return v + q[..., :1] * t + np.cross(u, t)


def dcm_from_quat(q_nb: ArrayLike) -> Array:
    """C_nb (..., 3, 3) of unit quaternions q_nb (..., 4)."""
    q = _array(q_nb, 4, "a quaternion")
    w, x, y, z = (q[..., i] for i in range(4))
    rows = [
        [w * w + x * x - y * y - z * z, 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), w * w - x * x + y * y - z * z, 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), w * w - x * x - y * y + z * z],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def quat_from_dcm(C_nb: ArrayLike) -> Array:
    """q_nb (..., 4), q0 >= 0, of C_nb (..., 3, 3); exact to rounding at every angle.

    Each row below is 4 q_i q; the one with the largest diagonal term is used, so nothing small is divided by.
    """
    C = _dcm(C_nb)
    xx, yy, zz = C[..., 0, 0], C[..., 1, 1], C[..., 2, 2]
    wx, wy, wz = C[..., 2, 1] - C[..., 1, 2], C[..., 0, 2] - C[..., 2, 0], C[..., 1, 0] - C[..., 0, 1]
    xy, xz, yz = C[..., 0, 1] + C[..., 1, 0], C[..., 0, 2] + C[..., 2, 0], C[..., 1, 2] + C[..., 2, 1]
    rows = [
        [1.0 + xx + yy + zz, wx, wy, wz],
        [wx, 1.0 + xx - yy - zz, xy, xz],
        [wy, xy, 1.0 - xx + yy - zz, yz],
        [wz, xz, yz, 1.0 - xx - yy + zz],
    ]
    Q = np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
    best = np.argmax(np.diagonal(Q, axis1=-2, axis2=-1), axis=-1)
    q = np.take_along_axis(Q, best[..., None, None], axis=-2)[..., 0, :]
    return quat_canonical(quat_normalise(q))


def quat_from_euler(roll: ArrayLike, pitch: ArrayLike, heading: ArrayLike) -> Array:
    """q_nb (..., 4) of roll, pitch, heading in rad."""
    r, p, h = np.broadcast_arrays(*(0.5 * np.asarray(x, dtype=np.float64) for x in (roll, pitch, heading)))
    sr, cr, sp, cp, sh, ch = np.sin(r), np.cos(r), np.sin(p), np.cos(p), np.sin(h), np.cos(h)
    return np.stack(
        [
            ch * cp * cr + sh * sp * sr,
            ch * cp * sr - sh * sp * cr,
            ch * sp * cr + sh * cp * sr,
            sh * cp * cr - ch * sp * sr,
        ],
        axis=-1,
    )


def euler_from_quat(q_nb: ArrayLike) -> tuple[Array, Array, Array]:
    """Roll, pitch, heading of unit quaternions q_nb (..., 4), ranges as in `euler_from_dcm`."""
    return euler_from_dcm(dcm_from_quat(q_nb))


def quat_from_rotvec(rotvec: ArrayLike) -> Array:
    """Unit quaternion (..., 4) of a rotation vector (..., 3), rad; every angle, zero included."""
    v = _array(rotvec, 3, "a rotation vector")
    angle = np.linalg.norm(v, axis=-1, keepdims=True)
    # numpy's sinc is sin(pi x)/(pi x) with its limit at zero: sin(angle/2)/angle without a division by zero.
    return np.concatenate([np.cos(0.5 * angle), 0.5 * np.sinc(angle / (2.0 * np.pi)) * v], axis=-1)


def rotvec_from_quat(q_nb: ArrayLike) -> Array:
    """Rotation vector (..., 3), rad, of length [0, pi], of unit quaternions (..., 4); accurate near 0 and near pi."""
    q = quat_canonical(q_nb)
    w, v = q[..., :1], q[..., 1:]
    n = np.linalg.norm(v, axis=-1, keepdims=True)
    small = n < 1e-9  # there angle = 2 n/w to the last bit, and the norm may have underflowed
    w_safe = np.where(small, np.where(w > 0.0, w, 1.0), 1.0)
    return np.where(small, 2.0 / w_safe, 2.0 * np.arctan2(n, w) / np.where(small, 1.0, n)) * v


def dcm_from_rotvec(rotvec: ArrayLike) -> Array:
    """Rotation matrix (..., 3, 3) of a rotation vector (..., 3), rad: the exponential of [rotvec x]."""
    return dcm_from_quat(quat_from_rotvec(rotvec))


def rotvec_from_dcm(C: ArrayLike) -> Array:
    """Rotation vector (..., 3), rad, of length [0, pi], of a rotation matrix (..., 3, 3)."""
    return rotvec_from_quat(quat_from_dcm(C))


def orthonormalise(C: ArrayLike) -> Array:
    """The rotation nearest (in the sum of squares) to a nearly orthonormal matrix (..., 3, 3): its polar factor."""
    U, _, Vt = np.linalg.svd(_dcm(C))
    sign = np.sign(np.linalg.det(U @ Vt))
    U = U * np.stack([np.ones_like(sign), np.ones_like(sign), sign], axis=-1)[..., None, :]
    return U @ Vt


# --- axis conventions -------------------------------------------------------------------------------------------------

_DIRECTIONS = {
    "N": (1, 0, 0), "S": (-1, 0, 0), "E": (0, 1, 0), "W": (0, -1, 0),
    "F": (1, 0, 0), "B": (-1, 0, 0), "R": (0, 1, 0), "L": (0, -1, 0),
    "D": (0, 0, 1), "U": (0, 0, -1),
}  # fmt: skip


def axes_matrix(to: str, start: str) -> Array:
    """(3, 3) matrix that takes components along the axes `start` to those along `to`.

    Letters: N S E W U D for a navigation frame, F B R L U D for a body: axes_matrix("NED", "ENU").
    Raises InputError for an unknown, mixed or left-handed set.
    """
    frames = []
    for axes in (to, start):
        letters = axes.upper()
        if len(letters) != 3 or any(c not in _DIRECTIONS for c in letters):
            raise InputError(
                f"axes '{axes}' are not known; write three letters such as NED, ENU, NWU, FRD, FLU or RFU."
            )
        A = np.array([_DIRECTIONS[c] for c in letters], dtype=np.float64)
        if np.linalg.det(A) < 0.5:
            raise InputError(f"axes '{axes}' are not a right-handed set; write for example NED, ENU, NWU, FRD or FLU.")
        frames.append((A, any(c in "NSEW" for c in letters)))
    (A, earth_a), (B, earth_b) = frames
    if earth_a != earth_b:
        raise InputError(f"'{to}' and '{start}' are axes of different things: one of the Earth, one of the vehicle.")
    return A @ B.T


def _swap(v: ArrayLike) -> Array:
    a = _array(v, 3, "a vector")
    return np.stack([a[..., 1], a[..., 0], -a[..., 2]], axis=-1)


def _flip(v: ArrayLike) -> Array:
    return _array(v, 3, "a vector") * np.array([1.0, -1.0, -1.0])


def ned_from_enu(v: ArrayLike) -> Array:
    """Components (..., 3) along east, north, up to north, east, down."""
    return _swap(v)


def enu_from_ned(v: ArrayLike) -> Array:
    """Components (..., 3) along north, east, down to east, north, up."""
    return _swap(v)


def ned_from_nwu(v: ArrayLike) -> Array:
    """Components (..., 3) along north, west, up to north, east, down."""
    return _flip(v)


def nwu_from_ned(v: ArrayLike) -> Array:
    """Components (..., 3) along north, east, down to north, west, up."""
    return _flip(v)


def frd_from_flu(v: ArrayLike) -> Array:
    """Components (..., 3) along forward, left, up to forward, right, down."""
    return _flip(v)


def flu_from_frd(v: ArrayLike) -> Array:
    """Components (..., 3) along forward, right, down to forward, left, up."""
    return _flip(v)


def frd_from_rfu(v: ArrayLike) -> Array:
    """Components (..., 3) along right, forward, up to forward, right, down."""
    return _swap(v)


def rfu_from_frd(v: ArrayLike) -> Array:
    """Components (..., 3) along forward, right, down to right, forward, up."""
    return _swap(v)


_NED_ENU = axes_matrix("NED", "ENU")
_FRD_FLU = axes_matrix("FRD", "FLU")


def dcm_ned_frd_from_enu_flu(C: ArrayLike) -> Array:
    """C_nb (..., 3, 3), NED from FRD, of an attitude given as ENU from FLU (ROS)."""
    return _NED_ENU @ _dcm(C) @ _FRD_FLU.T


def enu_flu_from_ned_frd(C_nb: ArrayLike) -> Array:
    """The attitude (..., 3, 3) as ENU from FLU (ROS) of C_nb, NED from FRD."""
    return _NED_ENU.T @ _dcm(C_nb) @ _FRD_FLU


def quat_ned_frd_from_enu_flu(q: ArrayLike) -> Array:
    """q_nb (..., 4), q0 >= 0, of a scalar-first quaternion that rotates FLU into ENU (ROS)."""
    return quat_from_dcm(dcm_ned_frd_from_enu_flu(dcm_from_quat(quat_normalise(q))))


def quat_from_scalar_last(q: ArrayLike) -> Array:
    """(x, y, z, w) as scipy and ROS write it to (w, x, y, z)."""
    return np.roll(_array(q, 4, "a quaternion"), 1, axis=-1)


def quat_to_scalar_last(q: ArrayLike) -> Array:
    """(w, x, y, z) to (x, y, z, w) as scipy and ROS write it."""
    return np.roll(_array(q, 4, "a quaternion"), -1, axis=-1)


def heading_from_yaw_enu(yaw: ArrayLike) -> Array:
    """Heading clockwise from north, [0, 2 pi), of a yaw counted counter-clockwise from east, rad."""
    return heading_0_360(0.5 * np.pi - np.asarray(yaw, dtype=np.float64))


def yaw_enu_from_heading(heading: ArrayLike) -> Array:
    """Yaw counter-clockwise from east, (-pi, pi], of a heading clockwise from north, rad."""
    return wrap_pi(0.5 * np.pi - np.asarray(heading, dtype=np.float64))
