"""The simulated vehicle as a function of time: smooth steps plus waves, and the quadrature that gives its position.

Velocity, attitude, body rate and specific force are closed formulas of time (and of the slowly changing latitude and
height); position is their integral. The quadrature is Simpson's rule over each IMU interval, whose error is below
1e-15 of the interval's motion for anything slower than a second, so that a mean over an interval is as good as exact.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from schuler.kernels.earth import earth_rate, gravity, radii

# Profiles: each is a row of smooth steps, `before[i]` + `delta[i]` s((t - start[i]) / length[i]), never overlapping.
HEADING, SPEED, PITCH, FADE, CURRENT_N, CURRENT_E, HEAVE = range(7)
PROFILES = 7
# Waves: amplitude, angular frequency, phase. The first five fade in a dive, the next two never do.
ROLL_1, ROLL_2, PITCH_W, HEADING_W, ORBIT_N, ORBIT_E, ROLL_SLOW, HEADING_SLOW = range(8)
WAVES = 8

GRID = 18  # lat lon height, v_n (3), roll pitch heading, w_ib_b (3), f_b (3), speed through water, current n e


@njit(cache=True, error_model="numpy")
def profile(p, t, offsets, hints, start, length, before, delta):
    """Value, first and second derivative of profile p at time t; hints[p] remembers the step last used.

    Steps are 10 u^3 - 15 u^4 + 6 u^5 (value, rate and acceleration continuous). The heave that closes the depth is
    itself integrated once, so it uses the next smoother one, 35 u^4 - 84 u^5 + 70 u^6 - 20 u^7.
    """
    i = hints[p]
    while i + 1 < offsets[p + 1] and start[i + 1] <= t:
        i += 1
    while i > offsets[p] and start[i] > t:
        i -= 1
    hints[p] = i
    u = (t - start[i]) / length[i]
    if u <= 0.0:
        return before[i], 0.0, 0.0
    if u >= 1.0:
        return before[i] + delta[i], 0.0, 0.0
    w = 1.0 - u
    r = 1.0 / length[i]
    if p == HEAVE:
        s = u * u * u * u * (35.0 - u * (84.0 - u * (70.0 - 20.0 * u)))
        s1 = 140.0 * u * u * u * w * w * w * r
        s2 = 420.0 * u * u * w * w * (w - u) * r * r
    else:
        s = u * u * u * (10.0 - u * (15.0 - 6.0 * u))
        s1 = 30.0 * u * u * w * w * r
        s2 = 60.0 * u * w * (w - u) * r * r
    return before[i] + delta[i] * s, delta[i] * s1, delta[i] * s2


@njit(cache=True, error_model="numpy")
def motion(t, h, offsets, hints, start, length, before, delta, waves, current, out):
    """out[0:3] v_n, [3:6] its rate, [6:9] roll pitch heading, [9:12] their rates, [12] speed, [13:15] current at t.

    `current` holds the constant part (n, e) and the shear (n, e), 1/s: current = constant + walk + shear * depth.
    """
    fade, fade1, _ = profile(FADE, t, offsets, hints, start, length, before, delta)
    heading, heading1, _ = profile(HEADING, t, offsets, hints, start, length, before, delta)
    pitch, pitch1, _ = profile(PITCH, t, offsets, hints, start, length, before, delta)
    v, v1, _ = profile(SPEED, t, offsets, hints, start, length, before, delta)
    cn, cn1, _ = profile(CURRENT_N, t, offsets, hints, start, length, before, delta)
    ce, ce1, _ = profile(CURRENT_E, t, offsets, hints, start, length, before, delta)
    _, heave1, heave2 = profile(HEAVE, t, offsets, hints, start, length, before, delta)

    roll = 0.0
    roll1 = 0.0
    on = on1 = oe = oe1 = od = od1 = 0.0
    for i in range(WAVES):
        a = waves[i, 0]
        if a == 0.0:
            continue
        w = waves[i, 1]
        x = w * t + waves[i, 2]
        s = a * math.sin(x)
        c = a * math.cos(x)
        if i == ROLL_1 or i == ROLL_2:
            roll += fade * s
            roll1 += fade1 * s + fade * w * c
        elif i == PITCH_W:
            pitch += fade * s
            pitch1 += fade1 * s + fade * w * c
        elif i == HEADING_W:
            heading += fade * s
            heading1 += fade1 * s + fade * w * c
        elif i == ORBIT_N:
            on = fade * s
            on1 = fade1 * s + fade * w * c
            od = fade * c
            od1 = fade1 * c - fade * w * s
        elif i == ORBIT_E:
            oe = fade * s
            oe1 = fade1 * s + fade * w * c
        elif i == ROLL_SLOW:
            roll += s
            roll1 += w * c
        else:
            heading += s
            heading1 += w * c

    sp = math.sin(pitch)
    cp = math.cos(pitch)
    sh = math.sin(heading)
    ch = math.cos(heading)
    vd = -v * sp + od + heave1
    cn += current[0] - current[2] * h
    ce += current[1] - current[3] * h
    out[0] = v * cp * ch + on + cn
    out[1] = v * cp * sh + oe + ce
    out[2] = vd
    out[3] = v1 * cp * ch - v * (sp * ch * pitch1 + cp * sh * heading1) + on1 + cn1 + current[2] * vd
    out[4] = v1 * cp * sh - v * (sp * sh * pitch1 - cp * ch * heading1) + oe1 + ce1 + current[3] * vd
    out[5] = -v1 * sp - v * cp * pitch1 + od1 + heave2
    out[6] = roll
    out[7] = pitch
    out[8] = heading
    out[9] = roll1
    out[10] = pitch1
    out[11] = heading1
    out[12] = v
    out[13] = cn
    out[14] = ce


@njit(cache=True, error_model="numpy")
def inertial(lat, h, m, out):
    """Position rates out[0:3] (lat, lon, h), w_ib_b out[3:6] and f_b out[6:9] of the motion m at (lat, h).

    Groves (2013) section 5.4: f_b = C_bn (dv/dt + (2 w_ie + w_en) x v - g_n), w_ib_b = w_nb_b + C_bn (w_ie + w_en).
    """
    sl = math.sin(lat)
    cl = math.cos(lat)
    rn, re = radii(lat)
    vn, ve, vd = m[0], m[1], m[2]
    out[0] = vn / (rn + h)
    out[1] = ve / ((re + h) * cl)
    out[2] = -vd
    en_n = ve / (re + h)
    en_e = -vn / (rn + h)
    en_d = -ve * sl / ((re + h) * cl)
    ie_n, ie_d = earth_rate(lat)
    # Coriolis and transport: (2 w_ie + w_en) x v
    wn = 2.0 * ie_n + en_n
    we = en_e
    wd = 2.0 * ie_d + en_d
    fn = m[3] + we * vd - wd * ve
    fe = m[4] + wd * vn - wn * vd
    fd = m[5] + wn * ve - we * vn - gravity(lat, h)
    sr, cr = math.sin(m[6]), math.cos(m[6])
    sp, cp = math.sin(m[7]), math.cos(m[7])
    sh, ch = math.sin(m[8]), math.cos(m[8])
    c11, c12, c13 = cp * ch, cp * sh, -sp
    c21, c22, c23 = sr * sp * ch - cr * sh, sr * sp * sh + cr * ch, sr * cp
    c31, c32, c33 = cr * sp * ch + sr * sh, cr * sp * sh - sr * ch, cr * cp
    in_n, in_e, in_d = ie_n + en_n, en_e, ie_d + en_d
    out[3] = m[9] - m[11] * sp + c11 * in_n + c12 * in_e + c13 * in_d
    out[4] = m[10] * cr + m[11] * cp * sr + c21 * in_n + c22 * in_e + c23 * in_d
    out[5] = m[11] * cp * cr - m[10] * sr + c31 * in_n + c32 * in_e + c33 * in_d
    out[6] = c11 * fn + c12 * fe + c13 * fd
    out[7] = c21 * fn + c22 * fe + c23 * fd
    out[8] = c31 * fn + c32 * fe + c33 * fd


@njit(cache=True, error_model="numpy")
def _row(pos, m, q, row):
    """One row of the grid from position, motion m and rates q."""
    row[0] = pos[0]
    row[1] = pos[1]
    row[2] = pos[2]
    for i in range(3):
        row[3 + i] = m[i]
        row[6 + i] = m[6 + i]
        row[9 + i] = q[3 + i]
        row[12 + i] = q[6 + i]
    row[15] = m[12]
    row[16] = m[13]
    row[17] = m[14]


@njit(cache=True, error_model="numpy")
def _step(t0, dt, pos, m, q, mm, qm, mean, offsets, hints, start, length, before, delta, waves, current):
    """Carries pos, m, q from t0 to t0 + dt by Simpson's rule; mean (6,) gets the interval's mean w_ib_b and f_b.

    The radii at the middle and end use a predicted latitude: a dt^2/2 off, 1e-15 in the result.
    """
    lat0, lon0, h0 = pos[0], pos[1], pos[2]
    lat1, lon1, h1 = q[0], q[1], q[2]
    for i in range(6):
        mean[i] = q[3 + i]
    motion(t0 + 0.5 * dt, h0 + 0.5 * dt * h1, offsets, hints, start, length, before, delta, waves, current, mm)
    inertial(lat0 + 0.5 * dt * lat1, h0 + 0.5 * dt * h1, mm, qm)
    for i in range(6):
        mean[i] += 4.0 * qm[3 + i]
    motion(t0 + dt, h0 + dt * qm[2], offsets, hints, start, length, before, delta, waves, current, m)
    inertial(lat0 + dt * qm[0], h0 + dt * qm[2], m, q)
    for i in range(6):
        mean[i] = (mean[i] + q[3 + i]) / 6.0
    pos[0] = lat0 + dt * (lat1 + 4.0 * qm[0] + q[0]) / 6.0
    pos[1] = lon0 + dt * (lon1 + 4.0 * qm[1] + q[1]) / 6.0
    pos[2] = h0 + dt * (h1 + 4.0 * qm[2] + q[2]) / 6.0


@njit(cache=True, error_model="numpy")
def begin(pos, offsets, hints, start, length, before, delta, waves, current, m, q, row):
    """Motion and rates at t = 0 at position pos; fills the grid's first row."""
    motion(0.0, pos[2], offsets, hints, start, length, before, delta, waves, current, m)
    inertial(pos[0], pos[2], m, q)
    _row(pos, m, q, row)


@njit(cache=True, error_model="numpy")
def advance(k0, n, rate, pos, m, q, offsets, hints, start, length, before, delta, waves, current, grid, mean):
    """n intervals of 1/rate s from epoch k0: grid (n, 18) at their ends, mean (n, 6) over them.

    pos, m, q are the state at epoch k0 and are carried, so that any split into calls gives the same bits.
    """
    mm = np.empty(15)
    qm = np.empty(9)
    for j in range(n):
        t0 = (k0 + j) / rate
        _step(t0, (k0 + j + 1) / rate - t0, pos, m, q, mm, qm, mean[j],
              offsets, hints, start, length, before, delta, waves, current)  # fmt: skip
        _row(pos, m, q, grid[j])


@njit(cache=True, error_model="numpy")
def sample(times, rate, pos, m, q, offsets, hints, start, length, before, delta, waves, current, grid):
    """The grid row at each of the sorted times (>= 0), integrated on the epochs of 1/rate and one shorter last step."""
    mm = np.empty(15)
    qm = np.empty(9)
    mean = np.empty(6)
    k = 0
    for j in range(times.size):
        while (k + 1) / rate <= times[j]:
            t0 = k / rate
            _step(t0, (k + 1) / rate - t0, pos, m, q, mm, qm, mean,
                  offsets, hints, start, length, before, delta, waves, current)  # fmt: skip
            k += 1
        p1 = pos.copy()
        m1 = m.copy()
        q1 = q.copy()
        t0 = k / rate
        if times[j] > t0:
            _step(t0, times[j] - t0, p1, m1, q1, mm, qm, mean,
                  offsets, hints, start, length, before, delta, waves, current)  # fmt: skip
        _row(p1, m1, q1, grid[j])
