"""The AUV filter's state as flat arrays: layout, propagation of the nominal state and of the covariance.

Nominal state and bookkeeping share one vector x so that a filter is saved and resumed as bytes. Error state (N = 27),
error = estimate - truth, C_hat = (I - [phi x]) C:

    phi (3, n) | gyro bias (3) | accelerometer bias (3) | position N, E, D (m) | axial speed u through water |
    log scale k | current N, E | compass offset m | GNSS correlated error N, E | path scale | DVL scale |
    surface drift N, E | waves N, N', E, E' (orbital velocity, a lightly damped oscillator, seen by GNSS and DVL)

Motion: p' = C_nb (u, 0, 0) (1 + path scale) + current below, p' = drift on a surface leg; down: p_D' = -u sin(pitch).
The path scale is what a path steeper than the pitch (angle of attack) takes off the way over ground. It and k are
kept as logarithms of (1 + scale): a log and a path that share an unknown scale then share it along a straight line.
With a raw IMU (mode 0) the attitude is integrated; with a compass/AHRS (mode 1) it is given and only m is estimated.
Source: error model of Groves (2013) section 14.2 reduced to speed-log dead reckoning; Earth rate explicit.
"""

from __future__ import annotations

import math

from numba import njit

from .rotation import dcm_from_quat, quat_from_euler, quat_from_rotvec, quat_product, rotate_state_quat, wrap_pi

# --- nominal state (x) -------------------------------------------------------------------------------------------
QUAT, BG, BA, LAT, LON, HGT = 0, 4, 7, 10, 11, 12
U, K, CN, CE, M, EN, EE, KP, KD, DN, DE = 13, 14, 15, 16, 17, 18, 19, 20, 21, 22, 23
W = 24  # waves: orbital velocity north and its rate, east and its rate
NOMINAL = 28
# --- bookkeeping (x) ---------------------------------------------------------------------------------------------
T, TC, TNODE = 28, 29, 30  # time of the nominal state, of the covariance, of the last node
AI, VI = 31, 40  # integral of C dt (9) and of C (u, 0, 0) dt (3) since TC
WIN, RN, RE, GRAV, CLAT = 43, 46, 47, 48, 49  # w_in (3), radii + height, gravity, cos(lat), of the last covariance step
RATE = 50  # last body rate (3), for lever arms
LT, LS, LB, LV0, LSV, LSVV, LSTV = 53, 54, 57, 63, 65, 67, 69  # levelling block
MT, MS = 71, 72  # magnetometer block: seconds, integral of the heading residual
SNIS, TINFO, DRIFT, TROW = 73, 74, 75, 76  # speed NIS average, last speed information, on a surface leg?, last row
ZD, ZDT, DRATE = 77, 78, 79  # last depth measured, when, its rate
REJ_P, TFIX, HREF, VHREF = 80, 82, 83, 84  # fixes rejected in a row, last fix, height of depth zero
ROLL, PITCH, HEAD, ROWS = 85, 86, 87, 88  # last compass row (mode 1), rows seen
WOBBLE, MVAR = 89, 90  # velocity variance seen in the last levelling block, variance of a magnetometer block
MH = 91  # integral of d(field azimuth)/d(tilt north, east) over the magnetometer block (2)
VREF, DREF, DMAX = 93, 95, 97  # water velocity at the last fix (2), way since beside it (2), its largest square
TELLS, WILD = 98, 99  # does depth rate tell the speed now? how much wilder than its prior a surface leg moves
STEADY, STEADY_S = 100, 101  # the speed's running mean over STEADY_TAU, and how long it has run
NX = 102

# --- error state (P) ---------------------------------------------------------------------------------------------
E_PHI, E_BG, E_BA, E_N, E_E, E_D, E_U, E_K, E_CN, E_CE, E_M = 0, 3, 6, 9, 10, 11, 12, 13, 14, 15, 16
E_EN, E_EE, E_KP, E_KD, E_DN, E_DE = 17, 18, 19, 20, 21, 22
E_W = 23  # waves (4), as in x
N = 27

# --- configuration (c) -------------------------------------------------------------------------------------------
MODE, ARW, Q_BG, Q_BA, Q_POS, Q_DOWN, Q_U, Q_K, Q_M, Q_KP = range(10)
TAU_C, SIG_C, TAU_E, SIG_E, SIG_DRIFT, SHEAR = range(10, 16)
SIG_HEAD, SIG_TILT, WAVE, LEVEL_S, LEVEL_FLOOR, MAG_STD, DECLINATION = range(16, 23)
ANT, DVL, LOG, DELAY, HAS_LOG, GAP_S, IMU_GAP_S, COV_DT, CONSIDER_S, TAU_DRIFT = 23, 26, 29, 32, 33, 34, 35, 36, 37, 38
HEAD_TAU, SURFACE_M, GATE, HAS_DEPTH, WAVE_W = 39, 40, 41, 42, 43
NC = 44

OMEGA = 7.292115e-5
A_WGS, E2 = 6378137.0, 6.69437999014131e-3
STEADY_TAU = 20.0  # s
SUBMERGED = 0.004  # share of the waves' variance left under water
DAMPING = 0.1  # of the wave oscillator: how pure the sea's tone is
SIN_MIN_PITCH = 0.20791169081775934  # sin 12 deg: below this, depth rate says nothing of the speed


@njit(cache=True, error_model="numpy")
def refresh_earth(x):
    """Radii, gravity and w_in at the present place; they change slowly, so once a covariance step is exact enough."""
    s = math.sin(x[LAT])
    co = math.cos(x[LAT])
    w2 = 1.0 - E2 * s * s
    w = math.sqrt(w2)
    x[RN] = A_WGS * (1.0 - E2) / (w2 * w) + x[HGT]
    x[RE] = A_WGS / w + x[HGT]
    x[CLAT] = max(co, 1e-9)
    g0 = 9.7803253359 * (1.0 + 1.931852652458e-3 * s * s) / w
    x[GRAV] = g0 * (1.0 - 3.14e-7 * x[HGT])
    c00, c01, c02, c10, c11, c12, c20, c21, c22 = dcm_from_quat(x[QUAT], x[QUAT + 1], x[QUAT + 2], x[QUAT + 3])
    vn = c00 * x[U] * math.exp(x[KP]) + x[CN]
    ve = c10 * x[U] * math.exp(x[KP]) + x[CE]
    x[WIN] = OMEGA * co + ve / x[RE]
    x[WIN + 1] = -vn / x[RN]
    x[WIN + 2] = -OMEGA * s - ve * s / (x[CLAT] * x[RE])


@njit(cache=True, error_model="numpy")
def reset_levelling(x):
    """Starts a new levelling block at the present velocity."""
    for i in range(LT, MT):
        x[i] = 0.0
    c00, c01, c02, c10, c11, c12, c20, c21, c22 = dcm_from_quat(x[QUAT], x[QUAT + 1], x[QUAT + 2], x[QUAT + 3])
    x[LV0] = c00 * x[U] * math.exp(x[KP])
    x[LV0 + 1] = c10 * x[U] * math.exp(x[KP])


@njit(cache=True, error_model="numpy")
def _move(x, c00, c10, c20, dt):
    """Position over dt with the forward axis (c00, c10, c20) in n; accumulates what the covariance step needs."""
    u = x[U]
    vn, ve, vd = c00 * u, c10 * u, c20 * u
    x[VI] += vn * dt
    x[VI + 1] += ve * dt
    x[VI + 2] += vd * dt
    if x[DRIFT] > 0.5:
        vn, ve, vd = x[DN], x[DE], 0.0
    else:
        vn = vn * math.exp(x[KP]) + x[CN]
        ve = ve * math.exp(x[KP]) + x[CE]
    x[LAT] += vn * dt / x[RN]
    x[LON] = wrap_pi(x[LON] + ve * dt / (x[RE] * x[CLAT]))
    x[HGT] -= vd * dt * x[TELLS]
    x[STEADY_S] = min(x[STEADY_S] + dt, STEADY_TAU)
    x[STEADY] += (u - x[STEADY]) * min(1.0, dt / max(x[STEADY_S], 1e-3))


@njit(cache=True, error_model="numpy")
def steadiness(x):
    """The running mean of the speed over the speed itself: what the heading's Jacobian is taken with.

    Heading and current are told apart only by how the velocity changes. The estimate of a steady speed trembles with
    the log's noise, and a Jacobian that trembles with it would tell them apart by nothing.
    """
    if abs(x[U]) < 0.1:
        return 1.0
    return min(max(x[STEADY] / x[U], 0.5), 2.0)


@njit(cache=True, error_model="numpy")
def refresh_telling(x, c):
    """Depth tells the speed only where the path is steep and pitch and depth rate agree (else: apogee, flare, surface).

    A vehicle with IMU, log and depth knows its speed anyway: there the vertical motion always follows the pitch.
    Without a depth sensor it never does: how the IMU is pitched in a car is not known.
    """
    c00, c10, c20 = forward_axis(x)
    steep = abs(c20) > SIN_MIN_PITCH and x[DRATE] * c20 > 0.0 and x[ZD] > c[SURFACE_M]
    always = c[MODE] < 0.5 and c[HAS_LOG] > 0.5
    x[TELLS] = 1.0 if c[HAS_DEPTH] > 0.5 and (steep or always) else 0.0


@njit(cache=True, error_model="numpy")
def set_drift(x, P, X, c, on):
    """Enters or leaves a surface leg: the drift starts unknown each time, and is never taken for the current below."""
    if (x[DRIFT] > 0.5) == on:
        return
    x[DRIFT] = 1.0 if on else 0.0
    var = c[SIG_DRIFT] * c[SIG_DRIFT] if on else 0.0
    if on and not (c[HAS_DEPTH] > 0.5 and x[ZD] <= c[SURFACE_M]):
        # Not at the surface: a vehicle that was under way may still be, in whatever direction.
        var += x[U] * x[U]
    for i in (E_DN, E_DE):
        for j in range(N):
            P[i, j] = 0.0
            P[j, i] = 0.0
            X[i, j] = 0.0
        P[i, i] = var
    x[DN] = 0.0
    x[DE] = 0.0
    x[WILD] = 1.0


@njit(cache=True, error_model="numpy")
def advance_imu(x, P, X, c, t1, gx, gy, gz, fx, fy, fz, has_mag, mx, my, mz):
    """Nominal state from x[T] to t1 with constant rates (rad/s) and specific force (m/s^2) in b, as measured."""
    dt = t1 - x[T]
    if dt <= 0.0:
        return
    gap = dt > c[IMU_GAP_S] and x[ROWS] > 0.5
    drift = dt > c[GAP_S] or t1 - x[TINFO] > c[GAP_S]
    if gap or drift != (x[DRIFT] > 0.5):
        # Covariance first: what is known of the motion changes here.
        flush(x, P, X, c)
        set_drift(x, P, X, c, drift)
    wx, wy, wz = gx - x[BG], gy - x[BG + 1], gz - x[BG + 2]
    if gap:
        for i in range(3):
            P[i, i] += (0.1 * dt) ** 2
        P[E_U, E_U] += min(1.0 * dt, 2.0) ** 2
        wx = wy = wz = 0.0
    x[RATE], x[RATE + 1], x[RATE + 2] = wx, wy, wz
    q0, q1, q2, q3 = x[QUAT], x[QUAT + 1], x[QUAT + 2], x[QUAT + 3]
    # Body rate against n, half an interval, twice: the middle attitude resolves force and velocity.
    if not gap:
        c00, c01, c02, c10, c11, c12, c20, c21, c22 = dcm_from_quat(q0, q1, q2, q3)
        wn, we, wd = x[WIN], x[WIN + 1], x[WIN + 2]
        wx -= c00 * wn + c10 * we + c20 * wd
        wy -= c01 * wn + c11 * we + c21 * wd
        wz -= c02 * wn + c12 * we + c22 * wd
    h = 0.5 * dt
    d0, d1, d2, d3 = quat_from_rotvec(wx * h, wy * h, wz * h)
    m0, m1, m2, m3 = quat_product(q0, q1, q2, q3, d0, d1, d2, d3)
    q0, q1, q2, q3 = quat_product(m0, m1, m2, m3, d0, d1, d2, d3)
    k = 1.5 - 0.5 * (q0 * q0 + q1 * q1 + q2 * q2 + q3 * q3)
    x[QUAT], x[QUAT + 1], x[QUAT + 2], x[QUAT + 3] = k * q0, k * q1, k * q2, k * q3
    c00, c01, c02, c10, c11, c12, c20, c21, c22 = dcm_from_quat(m0, m1, m2, m3)
    x[AI] += c00 * dt
    x[AI + 1] += c01 * dt
    x[AI + 2] += c02 * dt
    x[AI + 3] += c10 * dt
    x[AI + 4] += c11 * dt
    x[AI + 5] += c12 * dt
    x[AI + 6] += c20 * dt
    x[AI + 7] += c21 * dt
    x[AI + 8] += c22 * dt
    _move(x, c00, c10, c20, dt)
    if gap:
        reset_levelling(x)
        x[MT] = x[MS] = x[MH] = x[MH + 1] = 0.0
    else:
        ax, ay, az = fx - x[BA], fy - x[BA + 1], fz - x[BA + 2]
        an = c00 * ax + c01 * ay + c02 * az
        ae = c10 * ax + c11 * ay + c12 * az
        ad = c20 * ax + c21 * ay + c22 * az
        # What the force has integrated to beside the known change of velocity: its wobble weighs the block.
        t = x[LT] + h
        u = x[U] * math.exp(x[KP])
        vn = x[LS] + an * h - (c00 * u - x[LV0])
        ve = x[LS + 1] + ae * h - (c10 * u - x[LV0 + 1])
        x[LSV] += vn * dt
        x[LSV + 1] += ve * dt
        x[LSVV] += vn * vn * dt
        x[LSVV + 1] += ve * ve * dt
        x[LSTV] += t * vn * dt
        x[LSTV + 1] += t * ve * dt
        x[LT] += dt
        x[LS] += an * dt
        x[LS + 1] += ae * dt
        x[LS + 2] += ad * dt
        x[LB] += c00 * dt
        x[LB + 1] += c01 * dt
        x[LB + 2] += c02 * dt
        x[LB + 3] += c10 * dt
        x[LB + 4] += c11 * dt
        x[LB + 5] += c12 * dt
        if has_mag:
            bn = c00 * mx + c01 * my + c02 * mz
            be = c10 * mx + c11 * my + c12 * mz
            # The field points to magnetic north: seen east of the estimated north by (declination - heading error).
            x[MT] += dt
            x[MS] += wrap_pi(c[DECLINATION] - math.atan2(be, bn) - x[M]) * dt
            bd = (c20 * mx + c21 * my + c22 * mz) / max(bn * bn + be * be, 1e-30)
            x[MH] += bd * bn * dt
            x[MH + 1] += bd * be * dt
    x[T] = t1
    x[TROW] = t1


@njit(cache=True, error_model="numpy")
def advance_compass(x, P, X, c, t1, roll, pitch, heading, row):
    """Nominal state from x[T] to t1 with a compass row (row true) at t1, or with the last row held (row false)."""
    dt = t1 - x[T]
    if dt < 0.0:
        return
    drift = t1 - x[TROW] > c[GAP_S] or t1 - x[TINFO] > c[GAP_S]
    if drift != (x[DRIFT] > 0.5):
        flush(x, P, X, c)
        set_drift(x, P, X, c, drift)
    held = x[HEAD]
    if row:
        # Middle of the interval: half way from the last row to this one.
        rm = x[ROLL] + 0.5 * wrap_pi(roll - x[ROLL])
        pm = 0.5 * (x[PITCH] + pitch)
        hm = held + 0.5 * wrap_pi(heading - held)
    else:
        rm, pm, hm = x[ROLL], x[PITCH], held
    a0, a1, a2, a3 = quat_from_euler(rm, pm, hm - x[M])
    c00, c01, c02, c10, c11, c12, c20, c21, c22 = dcm_from_quat(a0, a1, a2, a3)
    _move(x, c00, c10, c20, dt)
    x[AI] += c00 * dt
    x[AI + 3] += c10 * dt
    x[AI + 6] += c20 * dt
    if row:
        x[ROLL], x[PITCH], x[HEAD] = roll, pitch, heading
        x[TROW] = t1
    a0, a1, a2, a3 = quat_from_euler(x[ROLL], x[PITCH], x[HEAD] - x[M])
    x[QUAT], x[QUAT + 1], x[QUAT + 2], x[QUAT + 3] = a0, a1, a2, a3
    x[T] = t1


@njit(cache=True, error_model="numpy")
def oscillator(w, tau):
    """Transition (2, 2) over tau of a free oscillator of angular frequency w and damping ratio DAMPING."""
    g = DAMPING * w
    v = w * math.sqrt(1.0 - DAMPING * DAMPING)
    e = math.exp(-g * tau)
    co, si = math.cos(v * tau), math.sin(v * tau)
    return e * (co + g / v * si), e * si / v, -e * w * w / v * si, e * (co - g / v * si)


@njit(cache=True, error_model="numpy")
def _rows(A, x, c, tau, ac, ae, imu, drift):
    """A <- Phi A, in place: the few rows of Phi that are not the identity's."""
    vn, ve, vd = x[VI], x[VI + 1], x[VI + 2]
    s = math.exp(x[KP])
    for j in range(N):
        if drift:
            A[E_N, j] += tau * A[E_DN, j]
            A[E_E, j] += tau * A[E_DE, j]
        else:
            if imu:
                p0, p1, p2 = A[0, j], A[1, j], A[2, j]
            else:
                p0, p1, p2 = 0.0, 0.0, A[E_M, j]
            du = A[E_U, j]
            A[E_N, j] += s * (ve * p2 - vd * p1 + x[AI] * du) + s * vn * A[E_KP, j] + tau * A[E_CN, j]
            A[E_E, j] += s * (vd * p0 - vn * p2 + x[AI + 3] * du) + s * ve * A[E_KP, j] + tau * A[E_CE, j]
            A[E_D, j] += x[TELLS] * (vn * p1 - ve * p0 + x[AI + 6] * du)
    if imu:
        wn, we, wd = x[WIN] * tau, x[WIN + 1] * tau, x[WIN + 2] * tau
        for j in range(N):
            p0, p1, p2 = A[0, j], A[1, j], A[2, j]
            b0, b1, b2 = A[E_BG, j], A[E_BG + 1, j], A[E_BG + 2, j]
            A[0, j] = p0 - (we * p2 - wd * p1) + x[AI] * b0 + x[AI + 1] * b1 + x[AI + 2] * b2
            A[1, j] = p1 - (wd * p0 - wn * p2) + x[AI + 3] * b0 + x[AI + 4] * b1 + x[AI + 5] * b2
            A[2, j] = p2 - (wn * p1 - we * p0) + x[AI + 6] * b0 + x[AI + 7] * b1 + x[AI + 8] * b2
    for j in range(N):
        A[E_CN, j] *= ac
        A[E_CE, j] *= ac
        A[E_EN, j] *= ae
        A[E_EE, j] *= ae
    if c[WAVE] > 0.0:
        o00, o01, o10, o11 = oscillator(c[WAVE_W], tau)
        for i in (E_W, E_W + 2):
            for j in range(N):
                w0, w1 = A[i, j], A[i + 1, j]
                A[i, j] = o00 * w0 + o01 * w1
                A[i + 1, j] = o10 * w0 + o11 * w1


@njit(cache=True, error_model="numpy")
def _bend(x, P, tau, imu):
    """Second order of the heading error in position, which the linear covariance leaves out.

    Heading and current learnt together at a fix leave an error only in the way d that differs from going on as then;
    turned by psi, it errs by psi x d (in P) and by -psi^2 d / 2; that one's mean square 3/4 sigma^4 d d' is added.
    """
    x[DREF] += x[VI] * math.exp(x[KP]) - x[VREF] * tau
    x[DREF + 1] += x[VI + 1] * math.exp(x[KP]) - x[VREF + 1] * tau
    d2 = x[DREF] * x[DREF] + x[DREF + 1] * x[DREF + 1]
    if d2 > x[DMAX]:
        var = P[2, 2] if imu else P[E_M, E_M]
        k = 0.75 * var * var * (d2 - x[DMAX]) / d2
        P[E_N, E_N] += k * x[DREF] * x[DREF]
        P[E_N, E_E] += k * x[DREF] * x[DREF + 1]
        P[E_E, E_N] += k * x[DREF] * x[DREF + 1]
        P[E_E, E_E] += k * x[DREF + 1] * x[DREF + 1]
        x[DMAX] = d2


@njit(cache=True, error_model="numpy")
def set_reference(x):
    """A fix was taken: from here on `_bend` counts. After a gap the running mean of the speed starts again."""
    if x[T] - x[TFIX] > 5.0:
        x[STEADY] = x[U]
        x[STEADY_S] = 0.25 * STEADY_TAU
    a0, a1, a2 = forward_axis(x)
    v = x[U] * steadiness(x) * math.exp(x[KP])
    x[VREF], x[VREF + 1] = v * a0, v * a1
    x[DREF] = x[DREF + 1] = x[DMAX] = 0.0


@njit(cache=True, error_model="numpy")
def flush(x, P, X, c):
    """Covariance from x[TC] to x[T]: P <- Phi P Phi' + Q and X <- Phi X (X = covariance with the last node)."""
    tau = x[T] - x[TC]
    if tau <= 0.0:
        return
    imu = c[MODE] < 0.5
    drift = x[DRIFT] > 0.5
    ac = math.exp(-tau / c[TAU_C])
    ae = math.exp(-tau / c[TAU_E])
    _rows(P, x, c, tau, ac, ae, imu, drift)
    _rows(P.T, x, c, tau, ac, ae, imu, drift)
    _rows(X, x, c, tau, ac, ae, imu, drift)
    x[CN] *= ac
    x[CE] *= ac
    x[EN] *= ae
    x[EE] *= ae
    if imu:
        for i in range(3):
            P[i, i] += c[ARW] * c[ARW] * tau
            P[E_BG + i, E_BG + i] += c[Q_BG] * c[Q_BG] * tau
            P[E_BA + i, E_BA + i] += c[Q_BA] * c[Q_BA] * tau
    q_u = c[Q_U] * c[Q_U] * max(1.0, x[SNIS])
    q_c = c[SIG_C] * c[SIG_C] * 2.0 / c[TAU_C]
    if c[SHEAR] > 0.0:
        dz = x[VI + 2] * c[SHEAR]
        q_c += dz * dz / tau
    q_p = c[Q_POS] * c[Q_POS]
    q_d = c[Q_DOWN] if x[TELLS] > 0.5 and not drift else max(c[Q_DOWN], 0.5)
    P[E_N, E_N] += q_p * tau
    P[E_E, E_E] += q_p * tau
    P[E_D, E_D] += q_d * q_d * tau
    P[E_U, E_U] += q_u * tau
    if drift:
        q_s = c[SIG_DRIFT] * c[SIG_DRIFT] * 2.0 / c[TAU_DRIFT] * x[WILD]
        for i in range(2):
            P[E_DN + i, E_DN + i] += q_s * tau
            P[E_N + i, E_N + i] += q_s * tau**3 / 3.0
            P[E_N + i, E_DN + i] += q_s * tau * tau / 2.0
            P[E_DN + i, E_N + i] += q_s * tau * tau / 2.0
    else:
        t2, t3 = tau * tau / 2.0, tau**3 / 3.0
        a0, a1 = x[AI] / tau, x[AI + 3] / tau
        P[E_N, E_N] += (q_u * a0 * a0 + q_c) * t3
        P[E_E, E_E] += (q_u * a1 * a1 + q_c) * t3
        P[E_N, E_E] += q_u * a0 * a1 * t3
        P[E_E, E_N] += q_u * a0 * a1 * t3
        for i in range(2):
            a = a0 if i == 0 else a1
            P[E_N + i, E_U] += q_u * a * t2
            P[E_U, E_N + i] += q_u * a * t2
            P[E_N + i, E_CN + i] += q_c * t2
            P[E_CN + i, E_N + i] += q_c * t2
        if not imu:
            # Compass noise, correlated over HEAD_TAU, pushes the track sideways.
            q_h = c[SIG_HEAD] * c[SIG_HEAD] * max(1.0, c[HEAD_TAU] / tau)
            vn, ve = x[VI], x[VI + 1]
            P[E_N, E_N] += q_h * ve * ve
            P[E_E, E_E] += q_h * vn * vn
            P[E_N, E_E] -= q_h * vn * ve
            P[E_E, E_N] -= q_h * vn * ve
    P[E_CN, E_CN] += q_c * tau
    P[E_CE, E_CE] += q_c * tau
    P[E_K, E_K] += c[Q_K] * c[Q_K] * tau
    P[E_M, E_M] += c[Q_M] * c[Q_M] * tau
    P[E_KP, E_KP] += c[Q_KP] * c[Q_KP] * tau
    q_e = c[SIG_E] * c[SIG_E] * (1.0 - ae * ae)
    P[E_EN, E_EN] += q_e
    P[E_EE, E_EE] += q_e
    if not drift:
        _bend(x, P, tau, imu)
    if c[WAVE] > 0.0:
        # Stationary covariance sigma^2 diag(1, w^2); under water the sea is all but still.
        o00, o01, o10, o11 = oscillator(c[WAVE_W], tau)
        s2 = c[WAVE] * c[WAVE] * (1.0 if x[T] - x[TFIX] < 5.0 else SUBMERGED)
        w2 = c[WAVE_W] * c[WAVE_W]
        for i in range(2):
            a, b = E_W + 2 * i, W + 2 * i
            P[a, a] += s2 * (1.0 - o00 * o00 - w2 * o01 * o01)
            P[a + 1, a + 1] += s2 * (w2 - o10 * o10 - w2 * o11 * o11)
            cross = -s2 * (o00 * o10 + w2 * o01 * o11)
            P[a, a + 1] += cross
            P[a + 1, a] += cross
            x[b], x[b + 1] = o00 * x[b] + o01 * x[b + 1], o10 * x[b] + o11 * x[b + 1]
    for i in range(AI, VI + 3):
        x[i] = 0.0
    x[TC] = x[T]
    refresh_earth(x)
    refresh_telling(x, c)


@njit(cache=True, error_model="numpy")
def forward_axis(x):
    """C_nb (1, 0, 0)."""
    c00, c01, c02, c10, c11, c12, c20, c21, c22 = dcm_from_quat(x[QUAT], x[QUAT + 1], x[QUAT + 2], x[QUAT + 3])
    return c00, c10, c20


@njit(cache=True, error_model="numpy")
def turn_error(c, d):
    """Attitude error in n of the error state d: phi, or with a compass its offset about down."""
    if c[MODE] < 0.5:
        return d[0], d[1], d[2]
    return 0.0, 0.0, d[E_M]


@njit(cache=True, error_model="numpy")
def correct(x, c, d):
    """Takes the estimated error d (N) out of the nominal state and out of the running blocks.

    The last fix saw heading and current together, as the velocity over ground v_ref + current. So the current moves by
    its linear share of that velocity: what the fix could not tell apart stays untold when the heading moves far.
    """
    imu = c[MODE] < 0.5
    f0, f1, f2 = turn_error(c, d)
    rotate_state_quat(x, QUAT, f0, f1, f2)
    for i in range(E_BG, E_N):
        x[i + 1] -= d[i]
    x[LAT] -= d[E_N] / x[RN]
    x[LON] = wrap_pi(x[LON] - d[E_E] / (x[RE] * x[CLAT]))
    x[HGT] += d[E_D]
    for i in range(E_U, N):
        x[i + 1] -= d[i]
    vn, ve = x[VREF], x[VREF + 1]
    co, si = math.cos(f2), math.sin(f2)
    x[VREF], x[VREF + 1] = co * vn - si * ve, co * ve + si * vn
    if c[SIG_C] > 0.0:
        x[CN] += vn - ve * f2 - x[VREF]
        x[CE] += ve + vn * f2 - x[VREF + 1]
    if imu:
        s0, s1, s2 = x[LS], x[LS + 1], x[LS + 2]
        x[LS] += f1 * s2 - f2 * s1
        x[LS + 1] += f2 * s0 - f0 * s2
        x[LS + 2] += f0 * s1 - f1 * s0
        for r in range(2):
            for i in range(3):
                x[LS + r] += x[LB + 3 * r + i] * d[E_BA + i]
        v0, v1 = x[LV0], x[LV0 + 1]
        x[LV0] -= f2 * v1
        x[LV0 + 1] += f2 * v0
        x[MS] += (d[E_M] - f2) * x[MT] + x[MH] * f0 + x[MH + 1] * f1


@njit(cache=True, error_model="numpy")
def carry_covariance(P, c, tn, te):
    """P after a correction that moved the velocity at the last fix by (-tn, -te).

    The error of that velocity over ground keeps its covariance; the current's is what remains beside the new heading.
    """
    if c[SIG_C] <= 0.0:
        return
    h = 2 if c[MODE] < 0.5 else E_M
    for j in range(N):
        p = P[h, j]
        P[E_CN, j] += te * p
        P[E_CE, j] -= tn * p
    for i in range(N):
        p = P[i, h]
        P[i, E_CN] += te * p
        P[i, E_CE] -= tn * p
