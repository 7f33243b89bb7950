"""What the aided INS filter measures: residual r = predicted - measured, and H = d(predicted)/d(error), for each kind.

Every function fills r (m,) and H (m, n), which come zeroed, and returns m, the number of rows. A row stamped t belongs
to t - delay: `look_back` gives what the vehicle did since then from the kept past, so that a late stamp costs no second
order. Source of the models: Groves (2013), chapters 14 to 16; twins by differences in tests/twin/test_aided_twin.py.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from .aided_state import (
    ACC,
    AHEAD,
    ANT,
    BG,
    CLAT,
    CUR,
    DB,
    DECL,
    DISP,
    DM,
    DR,
    DV,
    DVI,
    DVL,
    GB,
    HB,
    HEAD,
    HGT,
    HO,
    KD,
    KR,
    KS,
    LAT,
    LON,
    MB,
    MNT,
    NHC,
    PAR,
    PHI,
    QUAT,
    RB,
    RE,
    RELATIVE,
    RING,
    RN,
    SPD,
    TD,
    TG,
    TS,
    TV,
    VEL,
    WIN,
    T,
    W,
    mounting,
    put,
    put3,
)
from .earth import E2, OMEGA, A
from .rotation import dcm_from_quat, euler_from_quat, quat_from_rotvec, quat_product, wrap_pi

POSITION, HEIGHT_FIX, VELOCITY, COURSE, SPEED, BOTTOM_TRACK, DEPTH, HEIGHT, ATTITUDE, MAGNETOMETER = range(10)
RANGE, SIGHTING, LIDAR, TERRAIN, NONHOLONOMIC, STANDING_V, STANDING_W, LEVEL_VELOCITY, DOWN_VELOCITY = range(10, 19)
KINDS = 19
ROWS_MOST = 3
LOOK = 14  # displacement since (3), change of velocity since (3), C_nb then (9 -> quaternion 4), rate then (3), found


@njit(cache=True, error_model="numpy")
def look_back(x, ring, tau, out):
    """out (LOOK): what happened in the last tau seconds: displacement, change of velocity, attitude and rate then.

    A tau below zero (the row belongs to the future of its stamp) is met with the mean acceleration and the last rate.
    """
    for i in range(3):
        out[i] = x[VEL + i] * tau - 0.5 * x[ACC + i] * tau * tau
        out[3 + i] = x[ACC + i] * tau
        out[10 + i] = x[W + i]
    for i in range(4):
        out[6 + i] = x[QUAT + i]
    out[13] = 0.0
    last = int(x[HEAD]) - 1
    if tau < 0.0:
        c00, c01, c02, c10, c11, c12, c20, c21, c22 = dcm_from_quat(out[6], out[7], out[8], out[9])
        n, e, d = x[WIN], x[WIN + 1], x[WIN + 2]
        h0, h1, h2, h3 = quat_from_rotvec(
            -tau * (x[W] - c00 * n - c10 * e - c20 * d),
            -tau * (x[W + 1] - c01 * n - c11 * e - c21 * d),
            -tau * (x[W + 2] - c02 * n - c12 * e - c22 * d),
        )
        out[6], out[7], out[8], out[9] = quat_product(out[6], out[7], out[8], out[9], h0, h1, h2, h3)
    if tau <= 0.0 or last < 1:
        return
    when = x[T] - tau
    first = max(0, last - RING + 1)
    if when < ring[first % RING, 0]:
        return
    hi = last
    while hi > first and ring[(hi - 1) % RING, 0] >= when:
        hi -= 1
    b = hi % RING
    if ring[b, 0] < when:
        # between the last row and the present
        t0, t1 = ring[b, 0], x[T]
        w = (when - t0) / (t1 - t0)
        for i in range(3):
            out[i] = (1.0 - w) * (x[DISP + i] - ring[b, 1 + i])
            out[3 + i] = (1.0 - w) * (x[DVI + i] - ring[b, 4 + i])
        s = 0.0
        for i in range(4):
            out[6 + i] = (1.0 - w) * ring[b, 7 + i] + w * x[QUAT + i]
            s += out[6 + i] * out[6 + i]
        s = 1.0 / math.sqrt(s)
        for i in range(4):
            out[6 + i] *= s
        return
    a = (hi - 1) % RING if hi > first else b
    span = ring[b, 0] - ring[a, 0]
    w = (when - ring[a, 0]) / span if span > 0.0 else 1.0
    for i in range(3):
        out[i] = x[DISP + i] - ((1.0 - w) * ring[a, 1 + i] + w * ring[b, 1 + i])
        out[3 + i] = x[DVI + i] - ((1.0 - w) * ring[a, 4 + i] + w * ring[b, 4 + i])
        out[10 + i] = ring[b, 11 + i]
    s = 0.0
    for i in range(4):
        out[6 + i] = (1.0 - w) * ring[a, 7 + i] + w * ring[b, 7 + i]
        s += out[6 + i] * out[6 + i]
    s = 1.0 / math.sqrt(s)
    for i in range(4):
        out[6 + i] *= s
    out[13] = 1.0


@njit(cache=True, error_model="numpy")
def offset_ned(x, lat, lon, h):
    """A place (rad, m) minus the IMU's, in NED at the IMU, m; exact on the ellipsoid."""
    s0, c0 = math.sin(x[LAT]), math.cos(x[LAT])
    s1, c1 = math.sin(lat), math.cos(lat)
    dl = wrap_pi(lon - x[LON])
    sd, cd = math.sin(dl), math.cos(dl)
    r0 = A / math.sqrt(1.0 - E2 * s0 * s0)
    r1 = A / math.sqrt(1.0 - E2 * s1 * s1)
    p0, z0 = (r0 + x[HGT]) * c0, (r0 * (1.0 - E2) + x[HGT]) * s0
    p1, z1 = (r1 + h) * c1, (r1 * (1.0 - E2) + h) * s1
    dx, dy, dz = p1 * cd - p0, p1 * sd, z1 - z0
    return -s0 * dx + c0 * dz, dy, -c0 * dx - s0 * dz


@njit(cache=True, error_model="numpy")
def position(x, ie, c, look, z, rows, H, r):
    """A fix of the antenna, lat, lon rad, height m: rows 0, 1 level; 2 down. rows: 2 level only, 1 down only, 3 both.

    down is taken when rows is 1 or 3. A fix that belongs to a later moment than its stamp comes AHEAD s later. Returns
    the number of rows filled (level first).
    """
    tau = x[PAR + TG] + c[AHEAD]
    c00, c01, c02, c10, c11, c12, c20, c21, c22 = dcm_from_quat(look[6], look[7], look[8], look[9])
    l0, l1, l2 = x[PAR + ANT], x[PAR + ANT + 1], x[PAR + ANT + 2]
    ln, le, ld = c00 * l0 + c01 * l1 + c02 * l2, c10 * l0 + c11 * l1 + c12 * l2, c20 * l0 + c21 * l1 + c22 * l2
    m = 0
    t, b, g = ie[TG], ie[GB], ie[ANT]
    if rows >= 2:
        r[0] = (x[LAT] - z[0]) * x[RN] - look[0] + ln + x[PAR + GB]
        r[1] = wrap_pi(x[LON] - z[1]) * x[RE] * x[CLAT] - look[1] + le + x[PAR + GB + 1]
        H[0, PHI + 1], H[0, PHI + 2] = -ld, le
        H[1, PHI], H[1, PHI + 2] = ld, -ln
        H[0, DR], H[1, DR + 1] = 1.0, 1.0
        H[0, DV], H[1, DV + 1] = -tau, -tau
        put(H, 0, t, -(x[VEL] - look[3]))
        put(H, 1, t, -(x[VEL + 1] - look[4]))
        put3(H, 0, g, c00, c01, c02)
        put3(H, 1, g, c10, c11, c12)
        put(H, 0, b, 1.0)
        if b >= 0:
            H[1, b + 1] += 1.0
        m = 2
    if rows != 2:
        r[m] = z[2] - x[HGT] - look[2] + ld + x[PAR + GB + 2]
        H[m, PHI], H[m, PHI + 1] = -le, ln
        H[m, DR + 2] = 1.0
        H[m, DV + 2] = -tau
        put(H, m, t, -(x[VEL + 2] - look[5]))
        put3(H, m, g, c20, c21, c22)
        if b >= 0:
            H[m, b + 2] += 1.0
        m += 1
    return m


@njit(cache=True, error_model="numpy")
def velocity(x, ie, look, z, H, r):
    """GNSS velocity of the antenna over ground, NED m/s: three rows."""
    c00, c01, c02, c10, c11, c12, c20, c21, c22 = dcm_from_quat(look[6], look[7], look[8], look[9])
    l0, l1, l2 = x[PAR + ANT], x[PAR + ANT + 1], x[PAR + ANT + 2]
    w0, w1, w2 = look[10], look[11], look[12]
    a0, a1, a2 = w1 * l2 - w2 * l1, w2 * l0 - w0 * l2, w0 * l1 - w1 * l0
    u0, u1, u2 = c00 * a0 + c01 * a1 + c02 * a2, c10 * a0 + c11 * a1 + c12 * a2, c20 * a0 + c21 * a1 + c22 * a2
    r[0] = x[VEL] - look[3] + u0 - z[0]
    r[1] = x[VEL + 1] - look[4] + u1 - z[1]
    r[2] = x[VEL + 2] - look[5] + u2 - z[2]
    H[0, PHI + 1], H[0, PHI + 2] = -u2, u1
    H[1, PHI], H[1, PHI + 2] = u2, -u0
    H[2, PHI], H[2, PHI + 1] = -u1, u0
    g, t, b = ie[ANT], ie[TV], ie[BG]
    for i in range(3):
        H[i, DV + i] = 1.0
        ca, cb, cc = (c00, c01, c02) if i == 0 else (c10, c11, c12) if i == 1 else (c20, c21, c22)
        # C [w x] on the arm, C [l x] on the gyro bias (rate error is minus the bias error)
        put3(H, i, g, cb * w2 - cc * w1, cc * w0 - ca * w2, ca * w1 - cb * w0)
        put3(H, i, b, cb * l2 - cc * l1, cc * l0 - ca * l2, ca * l1 - cb * l0)
        put(H, i, t, -x[ACC + i])
    return 3


@njit(cache=True, error_model="numpy")
def course(x, ie, look, z, H, r):
    """Direction of the velocity over ground, rad from north: one row."""
    vn, ve = x[VEL] - look[3], x[VEL + 1] - look[4]
    s2 = max(vn * vn + ve * ve, 1e-6)
    r[0] = wrap_pi(math.atan2(ve, vn) - z[0])
    H[0, DV], H[0, DV + 1] = -ve / s2, vn / s2
    put(H, 0, ie[TV], -(-ve * x[ACC] + vn * x[ACC + 1]) / s2)
    return 1


@njit(cache=True, error_model="numpy")
def along(x, ie, C, w, arm, arm_ie, a, vn, ve, vd, relative, H, i):
    """One component a (3, unit, b) of the velocity (vn, ve, vd) - and of water or air - at an arm; fills row i of H.

    C (9) C_nb and w (3) the rate, both of the moment that the velocity belongs to. Returns the predicted component.
    """
    if relative:
        vn -= x[PAR + CUR]
        ve -= x[PAR + CUR + 1]
    n0 = C[0] * a[0] + C[1] * a[1] + C[2] * a[2]
    n1 = C[3] * a[0] + C[4] * a[1] + C[5] * a[2]
    n2 = C[6] * a[0] + C[7] * a[1] + C[8] * a[2]
    l0, l1, l2 = arm[0], arm[1], arm[2]
    # a . (w x l) = l . (a x w)
    s0, s1, s2 = a[1] * w[2] - a[2] * w[1], a[2] * w[0] - a[0] * w[2], a[0] * w[1] - a[1] * w[0]
    H[i, PHI] += ve * n2 - vd * n1
    H[i, PHI + 1] += vd * n0 - vn * n2
    H[i, PHI + 2] += vn * n1 - ve * n0
    H[i, DV] += n0
    H[i, DV + 1] += n1
    H[i, DV + 2] += n2
    put3(H, i, ie[BG], -(l1 * a[2] - l2 * a[1]), -(l2 * a[0] - l0 * a[2]), -(l0 * a[1] - l1 * a[0]))
    put3(H, i, arm_ie, s0, s1, s2)
    if relative and ie[CUR] >= 0:
        H[i, ie[CUR]] -= n0
        H[i, ie[CUR] + 1] -= n1
    return n0 * vn + n1 * ve + n2 * vd + l0 * s0 + l1 * s1 + l2 * s2


@njit(cache=True, error_model="numpy")
def _seen_from(x, look, C, w):
    """C (9) and w (3) of the moment that `look` went back to."""
    C[0], C[1], C[2], C[3], C[4], C[5], C[6], C[7], C[8] = dcm_from_quat(look[6], look[7], look[8], look[9])
    w[0], w[1], w[2] = look[10], look[11], look[12]


@njit(cache=True, error_model="numpy")
def _body_velocity(x, C, w, arm, vn, ve, vd, relative):
    """Velocity at an arm in b, three numbers."""
    if relative:
        vn -= x[PAR + CUR]
        ve -= x[PAR + CUR + 1]
    return (
        C[0] * vn + C[3] * ve + C[6] * vd + w[1] * arm[2] - w[2] * arm[1],
        C[1] * vn + C[4] * ve + C[7] * vd + w[2] * arm[0] - w[0] * arm[2],
        C[2] * vn + C[5] * ve + C[8] * vd + w[0] * arm[1] - w[1] * arm[0],
    )


@njit(cache=True, error_model="numpy")
def mount_slopes(x, b0, b1, b2, D):
    """D (3, 3): d(vehicle axis i)/d(roll, pitch, yaw) of a body vector (b0, b1, b2) turned by `mounting`."""
    r, p, y = x[PAR + MNT], x[PAR + MNT + 1], x[PAR + MNT + 2]
    sr, cr, sp, cp, sy, cy = math.sin(r), math.cos(r), math.sin(p), math.cos(p), math.sin(y), math.cos(y)
    # after roll: e; after pitch: g
    e0, e1, e2 = b0, cr * b1 - sr * b2, sr * b1 + cr * b2
    g0, g1 = cp * e0 + sp * e2, e1
    d1, d2 = -sr * b1 - cr * b2, cr * b1 - sr * b2  # d(e1, e2)/d(roll)
    D[0, 0], D[1, 0], D[2, 0] = cy * sp * d2 - sy * d1, sy * sp * d2 + cy * d1, cp * d2
    q0, q2 = -sp * e0 + cp * e2, -cp * e0 - sp * e2  # d(g0, g2)/d(pitch)
    D[0, 1], D[1, 1], D[2, 1] = cy * q0, sy * q0, q2
    D[0, 2], D[1, 2], D[2, 2] = -sy * g0 - cy * g1, cy * g0 - sy * g1, 0.0


@njit(cache=True, error_model="numpy")
def speed(x, ie, c, look, z, H, r):
    """Speed along the vehicle's axis, m/s, over ground or through water or air: one row, scaled by exp(KS)."""
    C, w, a = np.empty(9), np.empty(3), np.empty(3)
    _seen_from(x, look, C, w)
    m = mounting(x)
    a[0], a[1], a[2] = m[0], m[1], m[2]
    arm = x[PAR + SPD : PAR + SPD + 3]
    vn, ve, vd = x[VEL] - look[3], x[VEL + 1] - look[4], x[VEL + 2] - look[5]
    relative = c[RELATIVE] > 0.5
    u = along(x, ie, C, w, arm, ie[SPD], a, vn, ve, vd, relative, H, 0)
    if ie[MNT] >= 0:
        D = np.empty((3, 3))
        b0, b1, b2 = _body_velocity(x, C, w, arm, vn, ve, vd, relative)
        mount_slopes(x, b0, b1, b2, D)
        put3(H, 0, ie[MNT], D[0, 0], D[0, 1], D[0, 2])
    k = math.exp(x[PAR + KS])
    n = H.shape[1]
    for j in range(n):
        H[0, j] *= k
    put(H, 0, ie[KS], u * k)
    a_n = C[0] * a[0] + C[1] * a[1] + C[2] * a[2]
    a_e = C[3] * a[0] + C[4] * a[1] + C[5] * a[2]
    a_d = C[6] * a[0] + C[7] * a[1] + C[8] * a[2]
    put(H, 0, ie[TS], -k * (a_n * x[ACC] + a_e * x[ACC + 1] + a_d * x[ACC + 2]))
    r[0] = u * k - z[0]
    return 1


@njit(cache=True, error_model="numpy")
def nonholonomic(x, ie, c, look, H, r):
    """A vehicle that neither slips sideways nor leaves the ground, at a point: two rows, right and down, m/s."""
    C, w, a = np.empty(9), np.empty(3), np.empty(3)
    _seen_from(x, look, C, w)
    m = mounting(x)
    arm = c[NHC : NHC + 3]
    vn, ve, vd = x[VEL], x[VEL + 1], x[VEL + 2]
    for i in range(2):
        k = 3 + 3 * i
        a[0], a[1], a[2] = m[k], m[k + 1], m[k + 2]
        r[i] = along(x, ie, C, w, arm, -1, a, vn, ve, vd, False, H, i)
    if ie[MNT] >= 0:
        D = np.empty((3, 3))
        b0, b1, b2 = _body_velocity(x, C, w, arm, vn, ve, vd, False)
        mount_slopes(x, b0, b1, b2, D)
        put3(H, 0, ie[MNT], D[1, 0], D[1, 1], D[1, 2])
        put3(H, 1, ie[MNT], D[2, 0], D[2, 1], D[2, 2])
    return 2


@njit(cache=True, error_model="numpy")
def bottom_track(x, ie, look, z, H, r):
    """DVL over ground in its own axes, m/s: three rows, (1 + KD) C_db (velocity at the DVL)."""
    C, w, a = np.empty(9), np.empty(3), np.empty(3)
    _seen_from(x, look, C, w)
    arm = x[PAR + DVL : PAR + DVL + 3]
    vn, ve, vd = x[VEL] - look[3], x[VEL + 1] - look[4], x[VEL + 2] - look[5]
    # the DVL's misalignment is small: I - [m x] of its rotation vector, first order on both sides
    m0, m1, m2 = x[PAR + DM], x[PAR + DM + 1], x[PAR + DM + 2]
    b0, b1, b2 = _body_velocity(x, C, w, arm, vn, ve, vd, False)
    g = 1.0 + x[PAR + KD]
    n = H.shape[1]
    for i in range(3):
        if i == 0:
            a[0], a[1], a[2] = 1.0, m2, -m1
        elif i == 1:
            a[0], a[1], a[2] = -m2, 1.0, m0
        else:
            a[0], a[1], a[2] = m1, -m0, 1.0
        u = along(x, ie, C, w, arm, ie[DVL], a, vn, ve, vd, False, H, i)
        for j in range(n):
            H[i, j] *= g
        put(H, i, ie[KD], u)
        f0 = C[0] * a[0] + C[1] * a[1] + C[2] * a[2]
        f1 = C[3] * a[0] + C[4] * a[1] + C[5] * a[2]
        f2 = C[6] * a[0] + C[7] * a[1] + C[8] * a[2]
        put(H, i, ie[TD], -g * (f0 * x[ACC] + f1 * x[ACC + 1] + f2 * x[ACC + 2]))
        r[i] = g * u - z[i]
    # d(-[m x] b)/dm = [b x]
    put3(H, 0, ie[DM], 0.0, -g * b2, g * b1)
    put3(H, 1, ie[DM], g * b2, 0.0, -g * b0)
    put3(H, 2, ie[DM], -g * b1, g * b0, 0.0)
    return 3


@njit(cache=True, error_model="numpy")
def depth(x, ie, z, H, r):
    """Depth below the sensor's zero, m down: one row."""
    r[0] = x[PAR + DB] - x[HGT] - z[0]
    H[0, DR + 2] = 1.0
    put(H, 0, ie[DB], 1.0)
    return 1


@njit(cache=True, error_model="numpy")
def height(x, ie, z, H, r):
    """Height of a barometer, m up, with an offset that drifts: one row."""
    r[0] = x[HGT] + x[PAR + HB] - z[0]
    H[0, DR + 2] = -1.0
    put(H, 0, ie[HB], 1.0)
    return 1


@njit(cache=True, error_model="numpy")
def euler_slopes(x, J):
    """J (3, 3): d(roll, pitch, heading)/d(phi)."""
    roll, pitch, heading = euler_from_quat(x[QUAT], x[QUAT + 1], x[QUAT + 2], x[QUAT + 3])
    sh, ch = math.sin(heading), math.cos(heading)
    cp = max(abs(math.cos(pitch)), 1e-4)
    tp = math.sin(pitch) / cp
    J[0, 0], J[0, 1], J[0, 2] = -ch / cp, -sh / cp, 0.0
    J[1, 0], J[1, 1], J[1, 2] = sh, -ch, 0.0
    J[2, 0], J[2, 1], J[2, 2] = -ch * tp, -sh * tp, -1.0


@njit(cache=True, error_model="numpy")
def attitude(x, ie, z, H, r):
    """Roll, pitch, heading of a vehicle's own AHRS, rad: three rows; the heading with an offset."""
    roll, pitch, heading = euler_from_quat(x[QUAT], x[QUAT + 1], x[QUAT + 2], x[QUAT + 3])
    J = np.empty((3, 3))
    euler_slopes(x, J)
    r[0] = wrap_pi(roll - z[0])
    r[1] = pitch - z[1]
    r[2] = wrap_pi(heading + x[PAR + HO] - z[2])
    for i in range(3):
        for j in range(3):
            H[i, PHI + j] = J[i, j]
    put(H, 2, ie[HO], 1.0)
    return 3


@njit(cache=True, error_model="numpy")
def magnetometer(x, ie, c, z, H, r):
    """Azimuth of the field (3, in b) against the declination, rad: one row, -(heading error) + offset."""
    c00, c01, c02, c10, c11, c12, c20, c21, c22 = dcm_from_quat(x[QUAT], x[QUAT + 1], x[QUAT + 2], x[QUAT + 3])
    b0, b1, b2 = z[0] - x[PAR + MB], z[1] - x[PAR + MB + 1], z[2] - x[PAR + MB + 2]
    bn, be, bd = c00 * b0 + c01 * b1 + c02 * b2, c10 * b0 + c11 * b1 + c12 * b2, c20 * b0 + c21 * b1 + c22 * b2
    h2 = max(bn * bn + be * be, 1e-30)
    r[0] = wrap_pi(math.atan2(be, bn) - c[DECL] + x[PAR + HO])
    H[0, PHI], H[0, PHI + 1], H[0, PHI + 2] = bd * bn / h2, bd * be / h2, -1.0
    put(H, 0, ie[HO], 1.0)
    put3(
        H, 0, ie[MB], (be * c00 - bn * c10) / h2, (be * c01 - bn * c11) / h2, (be * c02 - bn * c12) / h2
    )  # fmt: skip
    return 1


@njit(cache=True, error_model="numpy")
def distance(x, ie, z, H, r):
    """Range of the antenna to a known point z = (range m, lat, lon rad, height m): one row, exp(KR) rho + bias.

    z[4] = 1: the point's height is not known to the user and the range is meant in the plane.
    """
    c00, c01, c02, c10, c11, c12, c20, c21, c22 = dcm_from_quat(x[QUAT], x[QUAT + 1], x[QUAT + 2], x[QUAT + 3])
    l0, l1, l2 = x[PAR + ANT], x[PAR + ANT + 1], x[PAR + ANT + 2]
    ln, le, ld = c00 * l0 + c01 * l1 + c02 * l2, c10 * l0 + c11 * l1 + c12 * l2, c20 * l0 + c21 * l1 + c22 * l2
    dn, de, dd = offset_ned(x, z[1], z[2], z[3])
    dn -= ln
    de -= le
    dd = 0.0 if z[4] > 0.5 else dd - ld
    rho = max(math.sqrt(dn * dn + de * de + dd * dd), 1e-6)
    k = math.exp(x[PAR + KR])
    u0, u1, u2 = -dn / rho * k, -de / rho * k, -dd / rho * k
    r[0] = k * rho + x[PAR + RB] - z[0]
    H[0, DR], H[0, DR + 1], H[0, DR + 2] = u0, u1, u2
    # u . [arm x] phi
    H[0, PHI] = u1 * ld - u2 * le
    H[0, PHI + 1] = u2 * ln - u0 * ld
    H[0, PHI + 2] = u0 * le - u1 * ln
    put3(
        H, 0, ie[ANT], u0 * c00 + u1 * c10 + u2 * c20, u0 * c01 + u1 * c11 + u2 * c21, u0 * c02 + u1 * c12 + u2 * c22
    )  # fmt: skip
    put(H, 0, ie[KR], k * rho)
    put(H, 0, ie[RB], 1.0)
    return 1


@njit(cache=True, error_model="numpy")
def curvature(P, r0, r1, r2, rho):
    """Variance that a range's curvature adds, m^2: tr((Hxx P)^2)/2, Hxx = (I - u u')/rho, u = (r0, r1, r2) unit.

    Without it a filter whose linearisation point moves learns what a range does not tell (the height, in a plane).
    """
    M = np.empty((3, 3))
    for i in range(3):
        ui = r0 if i == 0 else r1 if i == 1 else r2
        for j in range(3):
            v = P[DR + i, DR + j]
            for m in range(3):
                v -= ui * (r0 if m == 0 else r1 if m == 1 else r2) * P[DR + m, DR + j]
            M[i, j] = v / rho
    t = 0.0
    for i in range(3):
        for j in range(3):
            t += M[i, j] * M[j, i]
    return 0.5 * t


@njit(cache=True, error_model="numpy")
def standing_velocity(x, H, r):
    """Zero velocity: three rows, m/s."""
    for i in range(3):
        r[i] = x[VEL + i]
        H[i, DV + i] = 1.0
    return 3


@njit(cache=True, error_model="numpy")
def standing_rate(x, ie, wx, wy, wz, H, r):
    """Zero rate against the Earth: three rows in b, rad/s, of a mean measured rate (wx, wy, wz)."""
    c00, c01, c02, c10, c11, c12, c20, c21, c22 = dcm_from_quat(x[QUAT], x[QUAT + 1], x[QUAT + 2], x[QUAT + 3])
    n, d = OMEGA * x[CLAT], -OMEGA * math.sin(x[LAT])
    r[0] = wx - x[PAR + BG] - (c00 * n + c20 * d)
    r[1] = wy - x[PAR + BG + 1] - (c01 * n + c21 * d)
    r[2] = wz - x[PAR + BG + 2] - (c02 * n + c22 * d)
    b = ie[BG]
    for i in range(3):
        if b >= 0:
            H[i, b + i] = -1.0
        ca, cb, cc = (c00, c10, c20) if i == 0 else (c01, c11, c21) if i == 1 else (c02, c12, c22)
        # -c . (phi x w) = -(phi . (w x c)), w = (n, 0, d)
        H[i, PHI] = d * cb
        H[i, PHI + 1] = -(d * ca - n * cc)
        H[i, PHI + 2] = -n * cb
    return 3
