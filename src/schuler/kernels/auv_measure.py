"""The AUV filter's measurements: residual r = predicted - measured, Jacobian H on the error state, variance R.

Every function returns innovations (measured - predicted), their sigmas, the NIS and whether the gate let them in.
Scalars are taken one after the other with the Joseph form, which any gain (also a Schmidt gain) leaves valid.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from .auv_state import (
    ANT,
    ARW,
    CE,
    CLAT,
    CN,
    CONSIDER_S,
    DE,
    DELAY,
    DN,
    DRATE,
    DRIFT,
    DVL,
    E_BA,
    E_BG,
    E_CE,
    E_CN,
    E_D,
    E_DE,
    E_DN,
    E_E,
    E_EE,
    E_EN,
    E_K,
    E_KD,
    E_KP,
    E_M,
    E_N,
    E_U,
    E_W,
    EE,
    EN,
    GAP_S,
    GATE,
    HAS_DEPTH,
    HAS_LOG,
    HGT,
    HREF,
    KD,
    KP,
    LAT,
    LB,
    LEVEL_FLOOR,
    LOG,
    LON,
    LS,
    LSTV,
    LSV,
    LSVV,
    LT,
    LV0,
    MAG_STD,
    MH,
    MODE,
    MS,
    MT,
    MVAR,
    OMEGA,
    QUAT,
    RATE,
    RE,
    REJ_P,
    RN,
    SIG_DRIFT,
    SIG_E,
    SNIS,
    TELLS,
    TFIX,
    TINFO,
    VHREF,
    VREF,
    WILD,
    WOBBLE,
    ZD,
    ZDT,
    K,
    N,
    T,
    U,
    W,
    carry_covariance,
    correct,
    refresh_telling,
    reset_levelling,
    set_reference,
    steadiness,
)
from .rotation import dcm_from_quat, wrap_pi

# chi-square 99.9 % for 1, 2, 3 degrees of freedom
LIMIT1, LIMIT2, LIMIT3 = 10.83, 13.82, 16.27


@njit(cache=True, error_model="numpy")
def scalar_update(P, d, h, r, R, consider, cross):
    """One scalar measurement r = H delta + noise: adds to the error estimate d and updates P (Joseph form).

    consider: 1.0 where a state keeps its estimate (Schmidt), else 0.0. cross: covariance of the error state with the
    noise. S = H P H' + 2 H cross + R.
    """
    ph = cross.copy()
    for j in range(N):
        if h[j] != 0.0:
            hj = h[j]
            r -= hj * d[j]
            for i in range(N):
                ph[i] += P[i, j] * hj
    s = R
    for j in range(N):
        s += h[j] * (ph[j] + cross[j])
    if s <= 0.0:
        return
    k = np.empty(N)
    for i in range(N):
        k[i] = ph[i] / s * (1.0 - consider[i])
        d[i] += k[i] * r
    for i in range(N):
        for j in range(i + 1):
            v = P[i, j] - k[i] * ph[j] - ph[i] * k[j] + s * k[i] * k[j]
            P[i, j] = v
            P[j, i] = v


@njit(cache=True, error_model="numpy")
def innovation_covariance(P, H, R, m):
    """S = H P H' + diag(R), (m, m)."""
    S = np.zeros((m, m))
    for a in range(m):
        for b in range(m):
            v = 0.0
            for i in range(N):
                if H[a, i] != 0.0:
                    for j in range(N):
                        if H[b, j] != 0.0:
                            v += H[a, i] * P[i, j] * H[b, j]
            S[a, b] = v
        S[a, a] += R[a]
    return S


@njit(cache=True, error_model="numpy")
def nis_of(S, r, m):
    """r' S^-1 r for m of 1, 2 or 3."""
    if m == 1:
        return r[0] * r[0] / S[0, 0]
    if m == 2:
        det = S[0, 0] * S[1, 1] - S[0, 1] * S[1, 0]
        return (S[1, 1] * r[0] * r[0] - 2.0 * S[0, 1] * r[0] * r[1] + S[0, 0] * r[1] * r[1]) / det
    a, b, c = S[0, 0], S[0, 1], S[0, 2]
    e, f, i = S[1, 1], S[1, 2], S[2, 2]
    A, B, C = e * i - f * f, c * f - b * i, b * f - c * e
    det = a * A + b * B + c * C
    E, F, I = a * i - c * c, b * c - a * f, a * e - b * b
    q = A * r[0] * r[0] + E * r[1] * r[1] + I * r[2] * r[2]
    q += 2.0 * (B * r[0] * r[1] + C * r[0] * r[2] + F * r[1] * r[2])
    return q / det


@njit(cache=True, error_model="numpy")
def apply(x, P, c, H, r, R, m, consider):
    """m scalar updates, one correction of the nominal state."""
    d = np.zeros(N)
    none = np.zeros(N)
    for a in range(m):
        scalar_update(P, d, H[a], r[a], R[a], consider, none)
    _settle(x, P, c, d)


@njit(cache=True, error_model="numpy")
def _settle(x, P, c, d):
    """Takes the estimated error out of the nominal state."""
    vn, ve = x[VREF], x[VREF + 1]
    correct(x, c, d)
    carry_covariance(P, c, vn - x[VREF], ve - x[VREF + 1])


@njit(cache=True, error_model="numpy")
def record(out, S, r, m, nis, used):
    """One row of innovations: value (3), sigma (3), nis, degrees of freedom, used (0 no; 2, 3: see position)."""
    for a in range(3):
        out[a] = -r[a] if a < m else np.nan
        out[3 + a] = math.sqrt(S[a, a]) if a < m else np.nan
    out[6] = nis
    out[7] = m
    out[8] = used


@njit(cache=True, error_model="numpy")
def velocity_rows(x, c, H):
    """Velocity over ground in n (3) as return value, d(velocity error)/d(error state) into H (3, N)."""
    c00, c01, c02, c10, c11, c12, c20, c21, c22 = dcm_from_quat(x[QUAT], x[QUAT + 1], x[QUAT + 2], x[QUAT + 3])
    g = math.exp(x[KP])
    u = x[U] * g
    vn, ve, vd = c00 * u, c10 * u, c20 * x[U]
    if x[DRIFT] > 0.5:
        H[0, E_DN] = 1.0
        H[1, E_DE] = 1.0
        return x[DN], x[DE], 0.0
    if c[MODE] < 0.5:
        h = steadiness(x)
        H[0, 1], H[0, 2] = -h * vd * g, h * ve
        H[1, 0], H[1, 2] = h * vd * g, -h * vn
        H[2, 0], H[2, 1] = -ve / g, vn / g
    else:
        h = steadiness(x)
        H[0, E_M], H[1, E_M] = h * ve, -h * vn
    H[0, E_U], H[1, E_U], H[2, E_U] = c00 * g, c10 * g, c20
    H[0, E_KP], H[1, E_KP] = vn, ve
    H[0, E_CN] = 1.0
    H[1, E_CE] = 1.0
    H[0, E_W] = 1.0
    H[1, E_W + 2] = 1.0
    return vn + x[CN] + x[W], ve + x[CE] + x[W + 2], vd


@njit(cache=True, error_model="numpy")
def _turned(x, ax, ay, az):
    """C_nb (ax, ay, az)."""
    c00, c01, c02, c10, c11, c12, c20, c21, c22 = dcm_from_quat(x[QUAT], x[QUAT + 1], x[QUAT + 2], x[QUAT + 3])
    return (
        c00 * ax + c01 * ay + c02 * az,
        c10 * ax + c11 * ay + c12 * az,
        c20 * ax + c21 * ay + c22 * az,
    )


@njit(cache=True, error_model="numpy")
def _excess(nis, limit, c):
    """By how many S an outlier's variance grows, so that its pull stops at the 99.9 % bound and never locks out."""
    if nis > limit and c[GATE] > 0.5:
        return nis / limit - 1.0
    return 0.0


@njit(cache=True, error_model="numpy")
def measure_position(x, P, X, c, lat, lon, height, sn, se, sd, out):
    """A fix of the antenna: lat, lon rad, height m (NaN: none), sigmas in m. Returns the variance added to N and E.

    A fix that contradicts the filter: after a gap the position's own variance grows until the fix is believable and
    only then it is taken (one wrong model must not wrench the learnt states); in a stream it is left out, up to three
    times in a row, after which it is believed.
    """
    ln, le, ld = _turned(x, c[ANT], c[ANT + 1], c[ANT + 2])
    H = np.zeros((3, N))
    vn, ve, vd = velocity_rows(x, c, H)
    H[:, :] = 0.0
    H[0, E_N], H[0, E_EN] = 1.0, 1.0
    H[1, E_E], H[1, E_EE] = 1.0, 1.0
    if c[MODE] < 0.5:
        H[0, 1], H[0, 2] = -ld, le
        H[1, 0], H[1, 2] = ld, -ln
    r = np.zeros(3)
    r[0] = (x[LAT] - lat) * x[RN] + ln - vn * c[DELAY] + x[EN]
    r[1] = wrap_pi(x[LON] - lon) * x[RE] * x[CLAT] + le - ve * c[DELAY] + x[EE]
    R = np.zeros(3)
    R[0], R[1] = sn * sn, se * se
    S = innovation_covariance(P, H, R, 2)
    nis = nis_of(S, r, 2)
    grown = 0.0
    used = 1.0
    if nis > LIMIT2 and c[GATE] > 0.5:
        if x[DRIFT] > 0.5:
            # On a surface leg the motion is anybody's guess (wind, a tow, a deck): let it be wilder.
            x[WILD] = min(x[WILD] * min(nis / LIMIT2, 10.0), 1e5)
            for i in (E_DN, E_DE):
                P[i, i] += c[SIG_DRIFT] * c[SIG_DRIFT] * x[WILD]
        if x[T] - x[TFIX] > c[GAP_S] or x[REJ_P] >= 3.0 or x[DRIFT] > 0.5:
            mean = 0.5 * (S[0, 0] + S[1, 1])
            top = mean + math.sqrt(0.25 * (S[0, 0] - S[1, 1]) ** 2 + S[0, 1] * S[0, 1])
            grown = (nis / LIMIT2 - 1.0) * top
            P[E_N, E_N] += grown
            P[E_E, E_E] += grown
            used = 2.0
        else:
            used = 0.0
    elif x[WILD] > 1.0:
        x[WILD] = max(1.0, 0.9 * x[WILD])
    if x[DRIFT] > 0.5 and x[T] - x[TFIX] <= c[GAP_S]:
        used = 3.0  # tells how the surface leg drifts, not how well the dive was navigated
    record(out, S, r, 2, nis, used)
    if used > 0.0:
        apply(x, P, c, H, r, R, 2, np.zeros(N))
        x[REJ_P] = 0.0
        set_reference(x)
        x[TFIX] = x[T]
    else:
        x[REJ_P] += 1.0
    if height == height and used > 0.0:
        # Where a depth sensor is in use the fix only teaches the height of its zero, kept apart as a scalar filter.
        up = height - x[HGT] + ld
        if c[HAS_DEPTH] > 0.5:
            s = x[VHREF] + sd * sd + c[SIG_E] * c[SIG_E]
            g = x[VHREF] / s
            x[HREF] += g * up
            x[HGT] += g * up
            # The fix's correlated error does not average out.
            x[VHREF] = max((1.0 - g) * x[VHREF], 0.5 * c[SIG_E] * c[SIG_E])
        else:
            H[2, :] = 0.0
            H[0, :] = 0.0
            H[0, E_D] = 1.0
            r[0] = up - vd * c[DELAY]
            R[0] = sd * sd
            s = P[E_D, E_D] + R[0]
            if r[0] * r[0] < 25.0 * s:
                apply(x, P, c, H, r, R, 1, np.zeros(N))
    return grown


@njit(cache=True, error_model="numpy")
def measure_velocity(x, P, X, c, zn, ze, zd, sn, se, sd, out):
    """GNSS velocity of the antenna over ground, m/s; only the horizontal part is used."""
    if c[MODE] < 0.5:
        w0, w1, w2 = x[RATE], x[RATE + 1], x[RATE + 2]
        a0, a1, a2 = c[ANT], c[ANT + 1], c[ANT + 2]
        jn, je, jd = _turned(x, w1 * a2 - w2 * a1, w2 * a0 - w0 * a2, w0 * a1 - w1 * a0)
    else:
        jn, je = 0.0, 0.0
    H = np.zeros((3, N))
    vn, ve, vd = velocity_rows(x, c, H)
    # The row stamped t was true DELAY earlier: turn the velocity back by the heading rate.
    turn = -x[RATE + 2] * c[DELAY]
    r = np.zeros(3)
    r[0] = vn - turn * ve + jn - zn
    r[1] = ve + turn * vn + je - ze
    R = np.zeros(3)
    R[0], R[1] = sn * sn, se * se
    S = innovation_covariance(P, H, R, 2)
    nis = nis_of(S, r, 2)
    record(out, S, r, 2, nis, 1.0)
    more = _excess(nis, LIMIT2, c)
    R[0] += more * S[0, 0]
    R[1] += more * S[1, 1]
    apply(x, P, c, H, r, R, 2, np.zeros(N))
    set_reference(x)
    if x[DRIFT] < 0.5:
        x[TINFO] = x[T]


@njit(cache=True, error_model="numpy")
def measure_speed(x, P, X, c, z, s, out):
    """Axial log: z = u (1 + path scale) (1 + k) + (w x arm)_x. Its NIS steers how freely u may change."""
    H = np.zeros((1, N))
    g = math.exp(x[KP] + x[K])
    H[0, E_U] = g
    H[0, E_K] = x[U] * g
    H[0, E_KP] = x[U] * g
    arm = x[RATE + 1] * c[LOG + 2] - x[RATE + 2] * c[LOG + 1]
    r = np.zeros(3)
    r[0] = x[U] * g + arm - z
    R = np.array([s * s])
    S = innovation_covariance(P, H, R, 1)
    nis = nis_of(S, r, 1)
    record(out, S, r, 1, nis, 1.0)
    R[0] += _excess(nis, LIMIT1, c) * S[0, 0]
    x[SNIS] += 0.2 * (min(nis, 100.0) - x[SNIS])
    apply(x, P, c, H, r, R, 1, np.zeros(N))
    x[TINFO] = x[T]


@njit(cache=True, error_model="numpy")
def measure_dvl(x, P, X, c, zx, zy, s, out):
    """Bottom-track velocity in b (forward, right), scaled by (1 + DVL scale)."""
    c00, c01, c02, c10, c11, c12, c20, c21, c22 = dcm_from_quat(x[QUAT], x[QUAT + 1], x[QUAT + 2], x[QUAT + 3])
    g = 1.0 + x[KD]
    wn, we = x[CN] + x[W], x[CE] + x[W + 2]
    bx = x[U] * math.exp(x[KP]) + c00 * wn + c10 * we + x[RATE + 1] * c[DVL + 2] - x[RATE + 2] * c[DVL + 1]
    by = c01 * wn + c11 * we + x[RATE + 2] * c[DVL] - x[RATE] * c[DVL + 2]
    H = np.zeros((2, N))
    H[0, E_U] = g * math.exp(x[KP])
    H[0, E_KP] = x[U] * H[0, E_U]
    for a in range(2):
        fn, fe, fd = (c00, c10, c20) if a == 0 else (c01, c11, c21)
        H[a, E_CN], H[a, E_CE] = g * fn, g * fe
        H[a, E_W], H[a, E_W + 2] = g * fn, g * fe
        if c[MODE] < 0.5:
            # C' (c + phi x c): the axis of b dotted with phi x c.
            H[a, 0] = g * fd * we
            H[a, 1] = -g * fd * wn
            H[a, 2] = g * (fe * wn - fn * we)
        else:
            H[a, E_M] = g * (fe * wn - fn * we)
    H[0, E_KD], H[1, E_KD] = bx, by
    r = np.zeros(3)
    r[0], r[1] = g * bx - zx, g * by - zy
    R = np.full(2, s * s)
    S = innovation_covariance(P, H, R, 2)
    nis = nis_of(S, r, 2)
    record(out, S, r, 2, nis, 1.0)
    more = _excess(nis, LIMIT2, c)
    R[0] += more * S[0, 0]
    R[1] += more * S[1, 1]
    apply(x, P, c, H, r, R, 2, np.zeros(N))
    x[TINFO] = x[T]


@njit(cache=True, error_model="numpy")
def measure_depth(x, P, X, c, z, s, out):
    """Depth below the sensor's zero, m down."""
    r = np.zeros(3)
    r[0] = (x[HREF] - x[HGT]) - z
    H = np.zeros((1, N))
    H[0, E_D] = 1.0
    R = np.array([s * s])
    S = innovation_covariance(P, H, R, 1)
    nis = nis_of(S, r, 1)
    record(out, S, r, 1, nis, 1.0)
    R[0] += _excess(nis, LIMIT1, c) * S[0, 0]
    apply(x, P, c, H, r, R, 1, np.zeros(N))
    if x[ZDT] > -1e300 and x[T] > x[ZDT]:
        x[DRATE] = (z - x[ZD]) / (x[T] - x[ZDT])
    x[ZD] = z
    x[ZDT] = x[T]
    refresh_telling(x, c)
    if x[TELLS] > 0.5 and (c[MODE] > 0.5 or c[HAS_LOG] < 0.5):
        x[TINFO] = x[T]


@njit(cache=True, error_model="numpy")
def measure_heading(x, P, X, c, out):
    """Mean heading residual of the magnetometer since the last node: z = psi + m."""
    r = np.zeros(3)
    r[0] = -wrap_pi(x[MS] / x[MT])
    H = np.zeros((1, N))
    H[0, 0], H[0, 1], H[0, 2] = x[MH] / x[MT], x[MH + 1] / x[MT], -1.0
    H[0, E_M] = 1.0
    # How far the noise averages out within a block depends on its colour: the variance follows the innovations.
    top = c[MAG_STD] * c[MAG_STD]
    R = np.array([x[MVAR] if x[MVAR] > 0.0 else top])
    S = innovation_covariance(P, H, R, 1)
    nis = nis_of(S, r, 1)
    seen = R[0] + 0.05 * (min(r[0] * r[0], 9.0 * S[0, 0]) - S[0, 0])
    x[MVAR] = min(max(seen, 0.04 * top), 9.0 * top)
    x[MT] = x[MS] = x[MH] = x[MH + 1] = 0.0
    record(out, S, r, 1, nis, 1.0)
    R[0] += _excess(nis, LIMIT1, c) * S[0, 0]
    apply(x, P, c, H, r, R, 1, np.zeros(N))


@njit(cache=True, error_model="numpy")
def measure_level(x, P, X, c, out):
    """Mean specific force of a block in n against the change of velocity in it: surge and turns are compensated.

    The force integrates to the velocity change exactly, so only the velocity's own wobble at the block's ends is noise:
    its size is read off the block (scatter of the integral about a straight line), which makes the weight adaptive.
    """
    t = x[LT]
    f_n, f_e, f_d = x[LS] / t, x[LS + 1] / t, x[LS + 2] / t
    c00, c01, c02, c10, c11, c12, c20, c21, c22 = dcm_from_quat(x[QUAT], x[QUAT + 1], x[QUAT + 2], x[QUAT + 3])
    u = x[U] * math.exp(x[KP])
    vn, ve = c00 * u, c10 * u
    wobble = 0.0
    for i in range(2):
        mean = x[LSV + i] / t
        slope = x[LSTV + i] - 0.5 * t * x[LSV + i]
        wobble += 0.5 * max(0.0, x[LSVV + i] / t - mean * mean - slope * slope * 12.0 / t**4)
    # A short block can miss a wave: the last block's wobble is remembered.
    wobble, x[WOBBLE] = max(wobble, 0.5 * x[WOBBLE]), wobble
    coriolis = 2.0 * OMEGA * math.sin(x[LAT])
    r = np.zeros(3)
    r[0] = f_n - (vn - x[LV0]) / t - coriolis * ve
    r[1] = f_e - (ve - x[LV0 + 1]) / t + coriolis * vn
    H = np.zeros((2, N))
    H[0, 1] = -f_d
    H[1, 0] = f_d
    for i in range(3):
        b0 = x[LB + i] / t
        b1 = x[LB + 3 + i] / t
        H[0, E_BA + i] = -b0
        H[1, E_BA + i] = -b1
        # The mean force saw the tilt half a block ago.
        H[0, E_BG + i] = f_d * 0.5 * t * b1
        H[1, E_BG + i] = -f_d * 0.5 * t * b0
    # The block's mean tilt misses part of the last random walk that P already holds at its end.
    walk = f_d * f_d * c[ARW] * c[ARW] * t
    cross = np.zeros((2, N))
    cross[0, 1] = 0.5 * walk / f_d
    cross[1, 0] = -0.5 * walk / f_d
    R = np.zeros(2)
    R[0] = max(2.0 * wobble, P[E_U, E_U]) / (t * t) + c[LEVEL_FLOOR] * c[LEVEL_FLOOR] + walk / 3.0
    R[1] = R[0]
    S = innovation_covariance(P, H, R, 2)
    for a in range(2):
        S[a, a] -= walk
    nis = nis_of(S, r, 2)
    record(out, S, r, 2, nis, 1.0)
    more = _excess(nis, LIMIT2, c)
    R[0] += more * S[0, 0]
    R[1] += more * S[1, 1]
    consider = np.zeros(N)
    if x[T] - x[TFIX] > c[CONSIDER_S]:
        consider[2] = 1.0
        consider[E_BG + 2] = 1.0
    d = np.zeros(N)
    for a in range(2):
        scalar_update(P, d, H[a], r[a], R[a], consider, cross[a])
    _settle(x, P, c, d)
    reset_levelling(x)
