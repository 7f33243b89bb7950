"""The six-state Euler-angle Kalman filter of the AHRS/GPS/DR paper, with its dead reckoning, over a whole recording.

State x = (roll, pitch, heading, B_x, B_y, B_z), rad and rad/s; input u = gyro rates, rad/s; NED and forward-right-down;
accelerometer = specific force, (0, 0, -g) at level rest. Numbers in brackets are the paper's equations (Alizadeh and
others 2017, "Design and implementation of AHRS/GPS/DR navigation algorithm applied to long-range AUVs"). Two readings:

- corrected: Phi = I + A dt, levelling by atan2, wrapped heading innovation, h = -depth in the radii;
- literal: Phi = (I + A) dt (25), arctan and asin levelling (27), innovation not wrapped, P = (I - K H) P (34), h = 0.

R is diagonal, so the rows of the measurement are taken one after the other: the same result as the matrix form.
"""

from __future__ import annotations

from math import asin, atan, atan2, cos, isfinite, pi, sin, sqrt
from typing import NamedTuple

import numpy as np
from numba import njit

# What is done with the heading row of the measurement while there is no fix.
ZERO_FROZEN = 0  # the paper's: innovation zero, row kept, B_z not corrected
ZERO_FREE = 1  # innovation zero, row kept, B_z still corrected by the levelling rows
DROP = 2  # row left out, nothing frozen
CONSIDER = 3  # row left out, heading and B_z considered (Schmidt): gain zero, covariance kept right
HELD = 4  # the last course of the receiver measured again and again

SEMI_MAJOR = 6378137.0  # WGS-84, m
ECC2 = 6.69437999014e-3
EARTH_RATE = 7.292115e-5  # rad/s
LEVEL_SAMPLE = 0.01  # s
LONGEST_SAMPLE = 0.1  # s


class Tuning(NamedTuple):
    """Numbers of one run, SI: variances of a levelling sample and a course fix, walk densities, and the switches."""

    level_var: float  # rad^2, one sample of 10 ms; a longer one says more in proportion, up to LONGEST_SAMPLE
    course_var: float  # rad^2, one fix a second or later after the one before; less apart, it says less in proportion
    q_angle: float  # rad/sqrt(s)
    q_bias: float  # rad/s/sqrt(s)
    policy: int
    literal: bool
    estimate_bias: bool
    earth_rate: bool  # subtract Earth rate from the gyros (the paper neglects it)
    gravity: float  # m/s^2, of the printed asin(a_x/g) only
    fix_hold: float  # s after a fix during which its velocity is used; then the speed log takes over
    course_interval: float  # s between heading rows in an outage
    speed_std: float  # m/s, white, one speed-log sample
    speed_scale: float  # 1 sigma of the log's scale
    depth_std: float  # m


# Columns of a fix, and of a row of the answer.
FIX_TIME, FIX_LAT, FIX_LON, FIX_HEIGHT, FIX_VN, FIX_VE, FIX_VD = range(7)
FIX_V_OK, FIX_COURSE_OK, FIX_STD_N, FIX_STD_E, FIX_STD_D, FIX_STD_V = range(7, 13)
FIX_COLUMNS = 13
OUT_LAT, OUT_LON, OUT_HEIGHT, OUT_VN, OUT_VE, OUT_VD, OUT_ROLL, OUT_PITCH, OUT_HEADING = range(9)
OUT_BX, OUT_BY, OUT_BZ, OUT_STD_BX, OUT_STD_BY, OUT_STD_BZ = range(9, 15)
OUT_P_RR, OUT_P_RP, OUT_P_RH, OUT_P_PP, OUT_P_PH, OUT_P_HH = range(15, 21)
OUT_P_NN, OUT_P_NE, OUT_P_EE, OUT_P_DD = range(21, 25)
OUT_V_NN, OUT_V_NE, OUT_V_EE, OUT_V_DD = range(25, 29)
OUT_COLUMNS = 29
# Columns of what each fix said: course innovation, its variance, used; position miss north, east and its covariance.
AT_COURSE, AT_COURSE_VAR, AT_COURSE_USED, AT_NORTH, AT_EAST, AT_NN, AT_NE, AT_EE, AT_SEEN = range(9)
AT_COLUMNS = 9


@njit(cache=True, error_model="numpy", nogil=True)
def wrap(angle):
    """Angle in (-pi, pi], rad."""
    if -pi < angle <= pi:
        return angle
    return angle - 2.0 * pi * np.ceil((angle - pi) / (2.0 * pi))


@njit(cache=True, error_model="numpy", nogil=True)
def linearise(x, u, A):
    """(10), (17): rates of roll, pitch, heading, rad/s, at x (6,) and gyro rates u (3,); and A = df/dx.

    A (3, 6) is filled with the first three rows; rows four to six are zero, as the biases are constant.
    """
    s, c = sin(x[0]), cos(x[0])
    sec = 1.0 / cos(x[1])
    t = sin(x[1]) * sec
    p_y, p_z = u[1] - x[4], u[2] - x[5]
    g_1 = p_y * s + p_z * c
    g_2 = p_y * c - p_z * s
    A[0, 0], A[0, 1], A[0, 2], A[0, 3], A[0, 4], A[0, 5] = g_2 * t, g_1 * sec * sec, 0.0, -1.0, -s * t, -c * t
    A[1, 0], A[1, 1], A[1, 2], A[1, 3], A[1, 4], A[1, 5] = -g_1, 0.0, 0.0, 0.0, -c, s
    A[2, 0], A[2, 1], A[2, 2], A[2, 3], A[2, 4], A[2, 5] = g_2 * sec, g_1 * t * sec, 0.0, 0.0, -s * sec, -c * sec
    return u[0] - x[3] + g_1 * t, g_2, g_1 * sec


@njit(cache=True, error_model="numpy", nogil=True)
def level(a_x, a_y, a_z, gravity, literal):
    """(27): roll and pitch, rad, from specific force, m/s^2. Literal: NaN pitch where |a_x| > gravity."""
    if literal:
        roll = atan(a_y / a_z)
        ratio = a_x / gravity
        return roll, asin(ratio) if abs(ratio) <= 1.0 else np.nan
    return atan2(-a_y, -a_z), atan2(a_x, sqrt(a_y * a_y + a_z * a_z))


@njit(cache=True, error_model="numpy", nogil=True)
def predict(x, P, u, dt, q_angle, q_bias, literal, A, W):
    """(31), (33): state and covariance one interval on, in place. A (3, 6) and W (6, 6) are room to work in."""
    d_roll, d_pitch, d_heading = linearise(x, u, A)
    x[0] += d_roll * dt
    x[1] += d_pitch * dt
    x[2] += d_heading * dt
    # Rows of Phi: the first three are those of A (scaled) plus a diagonal, the others a diagonal alone.
    scale = 1.0 if not literal else dt  # the printed (I + A) dt puts dt on the identity too
    for i in range(3):
        for j in range(6):
            total = scale * P[i, j]
            for k in range(6):
                total += dt * A[i, k] * P[k, j]
            W[i, j] = total
    for i in range(3, 6):
        for j in range(6):
            W[i, j] = scale * P[i, j]
    for i in range(6):
        for j in range(3):
            total = scale * W[i, j]
            for k in range(6):
                total += dt * W[i, k] * A[j, k]
            P[i, j] = total
        for j in range(3, 6):
            P[i, j] = scale * W[i, j]
    for i in range(3):
        P[i, i] += q_angle * q_angle * dt
        P[i + 3, i + 3] += q_bias * q_bias * dt
    for i in range(6):  # rounding only
        for j in range(i):
            mean = 0.5 * (P[i, j] + P[j, i])
            P[i, j] = mean
            P[j, i] = mean


@njit(cache=True, error_model="numpy", nogil=True)
def update_row(x, P, row, innovation, variance, freeze_bz, consider, literal, K, c):
    """(34) for one measured angle x[row], in place. K, c (6,) are room for the gain and for P h'.

    freeze_bz: the state B_z is not corrected, the covariance believes that it was (the paper's second step).
    consider: the gains of heading and B_z are zero and P follows by the form that is right for any gain,
    P - K c' - c K' + K S K' with c = P h'. Literal: P = (I - K H) P.
    """
    S = P[row, row] + variance
    for i in range(6):
        c[i] = P[i, row]
        K[i] = c[i] / S
    if consider:
        K[2] = 0.0
        K[5] = 0.0
    for i in range(6):
        if i == 5 and freeze_bz:
            continue
        x[i] += K[i] * innovation
    for i in range(6):
        for j in range(i + 1):
            if literal:
                P[i, j] -= K[i] * c[j]
            else:
                P[i, j] += -K[i] * c[j] - c[i] * K[j] + K[i] * S * K[j]
            P[j, i] = P[i, j]


@njit(cache=True, error_model="numpy", nogil=True)
def radii(lat):
    """Meridian and prime-vertical radius of the ellipsoid at lat (rad), m."""
    w2 = 1.0 - ECC2 * sin(lat) ** 2
    return SEMI_MAJOR * (1.0 - ECC2) / (w2 * sqrt(w2)), SEMI_MAJOR / sqrt(w2)


@njit(cache=True, error_model="numpy", nogil=True)
def run(
    time, gyro, accel, speed, speed_interval, depth_height, fix_row, fixes, x, P, lat, lon, height, tuning,
    out_row, out, at_fix,
):  # fmt: skip
    """The filter and its dead reckoning over n IMU epochs; row 0 is the start, already described by x, P, lat, lon.

    time (n,) s; gyro rad/s, accel m/s^2 (n, 3), mean over (time[k-1], time[k]]; speed (n,) m/s as last heard and
    speed_interval (n,) s between it and the one before; depth_height (n,) m up, NaN where unknown (then (36) is
    integrated); fixes (m, FIX_COLUMNS), fix j heard at epoch fix_row[j]; x (6,), P (6, 6) changed in place; out (r,
    OUT_COLUMNS) filled at the epochs out_row; at_fix (m, AT_COLUMNS) filled. Returns 0, or the epoch at which a state
    stopped being finite.
    """
    A = np.zeros((3, 6))
    W = np.zeros((6, 6))
    K = np.zeros(6)
    c = np.zeros(6)
    u = np.zeros(3)
    literal, policy = tuning.literal, tuning.policy
    n, m = len(time), len(fixes)
    j_fix, j_out = 0, 0
    fix_time, course_time, row_time, held_course = time[0], time[0], time[0], x[2]
    g_n, g_e, g_d = 0.0, 0.0, 0.0  # velocity of the last fix
    std_v = 0.0
    fresh = False  # a fix has been heard and its velocity still holds
    # Position error: of the last fix, then grown by heading (one direction in time: the errors of a dive are of one
    # sign, so the standard deviations add), by the log's scale likewise, and by its white noise.
    b_nn, b_ee, b_dd = 0.0, 0.0, 0.0
    h_n, h_e, h_d, s_n, s_e, w_nn, w_ne, w_ee = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    v_n, v_e, v_d = 0.0, 0.0, 0.0
    for k in range(n):
        if k > 0:
            dt = time[k] - time[k - 1]
            u[0], u[1], u[2] = gyro[k, 0], gyro[k, 1], gyro[k, 2]
            if tuning.earth_rate:
                s_r, c_r, s_p, c_p, s_h, c_h = sin(x[0]), cos(x[0]), sin(x[1]), cos(x[1]), sin(x[2]), cos(x[2])
                w_n, w_d = EARTH_RATE * cos(lat), -EARTH_RATE * sin(lat)
                u[0] -= c_p * c_h * w_n - s_p * w_d
                u[1] -= (-c_r * s_h + s_r * s_p * c_h) * w_n + s_r * c_p * w_d
                u[2] -= (s_r * s_h + c_r * s_p * c_h) * w_n + c_r * c_p * w_d
            predict(x, P, u, dt, tuning.q_angle, tuning.q_bias if tuning.estimate_bias else 0.0, literal, A, W)
            heading_before = x[2]
            outage = time[k] - course_time > tuning.fix_hold
            freeze = outage and policy == ZERO_FROZEN
            consider = outage and policy == CONSIDER
            roll, pitch = level(accel[k, 0], accel[k, 1], accel[k, 2], tuning.gravity, literal)
            y = roll - x[0]
            level_var = tuning.level_var * LEVEL_SAMPLE / min(dt, LONGEST_SAMPLE)
            update_row(x, P, 0, y if literal else wrap(y), level_var, freeze, consider, literal, K, c)
            if isfinite(pitch):
                update_row(x, P, 1, pitch - x[1], level_var, freeze, consider, literal, K, c)
            if outage and policy != DROP and policy != CONSIDER and time[k] - row_time >= tuning.course_interval - 1e-6:
                row_time = time[k]
                y = held_course - x[2] if policy == HELD else heading_before - x[2]
                update_row(x, P, 2, y if literal else wrap(y), tuning.course_var, freeze, consider, literal, K, c)

            # Dead reckoning (36), (37): velocity of the receiver while it speaks, else of the log.
            if fresh and time[k] - fix_time <= tuning.fix_hold:
                v_n, v_e, v_d = g_n, g_e, g_d
                w_nn += (std_v * dt) ** 2
                w_ee += (std_v * dt) ** 2
            else:
                c_p, s_h, c_h = cos(x[1]), sin(x[2]), cos(x[2])
                v_n = speed[k] * c_p * c_h
                v_e = speed[k] * c_p * s_h
                v_d = -speed[k] * sin(x[1])
                std_h = sqrt(max(P[2, 2], 0.0))
                h_n -= v_e * std_h * dt
                h_e += v_n * std_h * dt
                h_d += (abs(speed[k]) * sqrt(max(P[1, 1], 0.0)) + abs(v_d) * tuning.speed_scale) * dt
                s_n += v_n * tuning.speed_scale * dt
                s_e += v_e * tuning.speed_scale * dt
                q = tuning.speed_std**2 * speed_interval[k] * dt
                w_nn += q * c_h * c_h
                w_ne += q * c_h * s_h
                w_ee += q * s_h * s_h
            R_N, R_E = radii(lat)
            h = 0.0 if literal else height
            cos_lat = cos(lat)
            lat += v_n * dt / (R_N + h)
            lon = wrap(lon + v_e * dt / ((R_E + h) * cos_lat))
            height = depth_height[k] if isfinite(depth_height[k]) else height - v_d * dt

        while j_fix < m and fix_row[j_fix] <= k:
            fix = fixes[j_fix]
            late = time[k] - fix[FIX_TIME]
            R_N, R_E = radii(lat)
            north = (R_N + height) * (fix[FIX_LAT] - lat) + fix[FIX_VN] * late
            east = (R_E + height) * cos(lat) * wrap(fix[FIX_LON] - lon) + fix[FIX_VE] * late
            var_n, var_e = fix[FIX_STD_N] ** 2, fix[FIX_STD_E] ** 2
            if k > 0:
                at_fix[j_fix, AT_NORTH] = north
                at_fix[j_fix, AT_EAST] = east
                at_fix[j_fix, AT_NN] = b_nn + h_n * h_n + s_n * s_n + w_nn + var_n
                at_fix[j_fix, AT_NE] = h_n * h_e + s_n * s_e + w_ne
                at_fix[j_fix, AT_EE] = b_ee + h_e * h_e + s_e * s_e + w_ee + var_e
                at_fix[j_fix, AT_SEEN] = 1.0
                if fix[FIX_COURSE_OK] > 0.0:
                    course_var = tuning.course_var * max(1.0, 1.0 / max(fix[FIX_TIME] - course_time, 1e-3))
                    course_time, row_time = fix[FIX_TIME], fix[FIX_TIME]
                    course = atan2(fix[FIX_VE], fix[FIX_VN])
                    y = course - x[2] if literal else wrap(course - x[2])
                    at_fix[j_fix, AT_COURSE] = y
                    at_fix[j_fix, AT_COURSE_VAR] = P[2, 2] + course_var
                    at_fix[j_fix, AT_COURSE_USED] = 1.0
                    update_row(x, P, 2, y, course_var, False, False, literal, K, c)
                    held_course = course
            lat += north / (R_N + height)
            lon = wrap(lon + east / ((R_E + height) * cos(lat)))
            if not isfinite(depth_height[k]):
                height = fix[FIX_HEIGHT]
            g_n, g_e, g_d, std_v = fix[FIX_VN], fix[FIX_VE], fix[FIX_VD], fix[FIX_STD_V]
            if fix[FIX_V_OK] > 0.0:
                v_n, v_e, v_d = g_n, g_e, g_d
            b_nn, b_ee, b_dd = var_n, var_e, fix[FIX_STD_D] ** 2
            h_n, h_e, h_d, s_n, s_e, w_nn, w_ne, w_ee = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
            fix_time, fresh = fix[FIX_TIME], fix[FIX_V_OK] > 0.0
            j_fix += 1

        if not (isfinite(x[0]) and isfinite(x[1]) and isfinite(x[2]) and isfinite(P[2, 2])):
            return k
        if not literal:
            x[2] = wrap(x[2])

        if j_out < len(out_row) and out_row[j_out] == k:
            row = out[j_out]
            row[OUT_LAT], row[OUT_LON], row[OUT_HEIGHT] = lat, lon, height
            row[OUT_VN], row[OUT_VE], row[OUT_VD] = v_n, v_e, v_d
            row[OUT_ROLL], row[OUT_PITCH], row[OUT_HEADING] = wrap(x[0]), wrap(x[1]), wrap(x[2])
            for i in range(3):
                row[OUT_BX + i] = x[3 + i]
                row[OUT_STD_BX + i] = sqrt(max(P[3 + i, 3 + i], 0.0))
            row[OUT_P_RR], row[OUT_P_RP], row[OUT_P_RH] = P[0, 0], P[0, 1], P[0, 2]
            row[OUT_P_PP], row[OUT_P_PH], row[OUT_P_HH] = P[1, 1], P[1, 2], P[2, 2]
            row[OUT_P_NN] = b_nn + h_n * h_n + s_n * s_n + w_nn
            row[OUT_P_NE] = h_n * h_e + s_n * s_e + w_ne
            row[OUT_P_EE] = b_ee + h_e * h_e + s_e * s_e + w_ee
            row[OUT_P_DD] = tuning.depth_std**2 if isfinite(depth_height[k]) else b_dd + h_d * h_d
            if fresh and time[k] - fix_time <= tuning.fix_hold:
                row[OUT_V_NN], row[OUT_V_NE], row[OUT_V_EE], row[OUT_V_DD] = std_v**2, 0.0, std_v**2, std_v**2
            else:
                along = tuning.speed_std**2 + (tuning.speed_scale * speed[k]) ** 2
                s_h, c_h = sin(x[2]), cos(x[2])
                row[OUT_V_NN] = v_e * v_e * P[2, 2] + c_h * c_h * along
                row[OUT_V_NE] = -v_n * v_e * P[2, 2] + s_h * c_h * along
                row[OUT_V_EE] = v_n * v_n * P[2, 2] + s_h * s_h * along
                row[OUT_V_DD] = (v_n * v_n + v_e * v_e) * P[1, 1] + sin(x[1]) ** 2 * along
            j_out += 1
    return 0
