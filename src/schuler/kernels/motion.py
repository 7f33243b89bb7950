"""Truth as a function of time: motion formulas, their inertial rates, and Gauss-Legendre integrals over IMU intervals.

Three kinds of path. SURFACE: ground speed, climb rate, course, roll, pitch, heading are polynomial pieces plus waves;
velocity and attitude are closed formulas and position is their quadrature. TRACK: latitude, longitude, height and Euler
angles are polynomial pieces. CIRCLE: the ellipsoid's normal moves along a great circle (on a sphere: the great circle),
regular at the poles. NED, body FRD, e Earth-fixed; SI and radians. Attitude is q_euler times a mount or a pure cone.

The integrals of body rate and specific force over (t, t + h] use m Gauss-Legendre nodes, at which latitude, longitude
and height come from the matching Gauss collocation: the error per interval is of order h^(2m+1).
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

SURFACE, TRACK, CIRCLE = 0, 1, 2
# Channels of SURFACE (speed, climb rate, course) or TRACK (lat, lon, height), then roll, pitch, heading.
CHANNELS = 6
DEGREE = 8  # coefficients of a piece

# Parameters: kind, follow (bank and pitch from the path), gravity of the bank, extra (0 none, 1 mount, 2 cone), mount
# (4) or cone angle and rate, then CIRCLE: n0 (3), t0 (3), rate, height.
KIND, FOLLOW, BANK_G, EXTRA, MOUNT, N0, T0, RATE, HEIGHT = 0, 1, 2, 3, 4, 8, 11, 14, 15
PARAMETERS = 16

# A truth row: lat, lon, height, v_n (3), q_nb (4), and in a full one w_ib_b (3), f_b (3).
SHORT, ROW = 10, 16


@njit(cache=True, error_model="numpy")
def channels(t, hint, par, breaks, coefs, waves, out):
    """out (6, 3): value, first and second derivative of each channel at t. Returns the piece used, the next hint."""
    i = hint
    while i + 1 < breaks.size and breaks[i + 1] <= t:
        i += 1
    while i > 0 and breaks[i] > t:
        i -= 1
    u = t - breaks[i]
    for c in range(CHANNELS):
        n = int(coefs[i, c, DEGREE])  # highest power in use
        a = coefs[i, c, n]
        b = 0.0
        d = 0.0
        for k in range(n - 1, -1, -1):
            d = d * u + b
            b = b * u + a
            a = a * u + coefs[i, c, k]
        out[c, 0] = a
        out[c, 1] = b
        out[c, 2] = 2.0 * d
    for k in range(waves.shape[0]):
        c = int(waves[k, 0])
        w = waves[k, 2]
        x = w * t + waves[k, 3]
        s = waves[k, 1] * math.sin(x)
        out[c, 0] += s
        out[c, 1] += waves[k, 1] * w * math.cos(x)
        out[c, 2] -= w * w * s
    return i


@njit(cache=True, error_model="numpy")
def attitude(t, par, ch, q, w):
    """q (4) of n<-b and w (3), the rate of b against n in b, from the channels and the mount or cone."""
    roll, pitch, head = ch[3, 0], ch[4, 0], ch[5, 0]
    roll1, pitch1, head1 = ch[3, 1], ch[4, 1], ch[5, 1]
    if par[KIND] == SURFACE:
        head += ch[2, 0]
        head1 += ch[2, 1]
        if par[FOLLOW] != 0.0:
            v, c = ch[0, 0], ch[1, 0]
            x = v * ch[2, 1] / par[BANK_G]
            x1 = (ch[0, 1] * ch[2, 1] + v * ch[2, 2]) / par[BANK_G]
            if x != 0.0 or x1 != 0.0:
                roll += math.atan(x)
                roll1 += x1 / (1.0 + x * x)
            if c != 0.0 or ch[1, 1] != 0.0:
                pitch += math.atan2(c, v)
                pitch1 += (ch[1, 1] * v - c * ch[0, 1]) / (v * v + c * c)
    cr = cp = 1.0
    sr = sp = 0.0
    if roll != 0.0:
        cr, sr = math.cos(0.5 * roll), math.sin(0.5 * roll)
    if pitch != 0.0:
        cp, sp = math.cos(0.5 * pitch), math.sin(0.5 * pitch)
    chh, shh = math.cos(0.5 * head), math.sin(0.5 * head)
    q0 = cr * cp * chh + sr * sp * shh
    q1 = sr * cp * chh - cr * sp * shh
    q2 = cr * sp * chh + sr * cp * shh
    q3 = cr * cp * shh - sr * sp * chh
    s2r, c2r = 2.0 * sr * cr, cr * cr - sr * sr
    s2p, c2p = 2.0 * sp * cp, cp * cp - sp * sp
    w1 = roll1 - head1 * s2p
    w2 = pitch1 * c2r + head1 * c2p * s2r
    w3 = head1 * c2p * c2r - pitch1 * s2r
    if par[EXTRA] != 0.0:
        if par[EXTRA] == 1.0:
            e0, e1, e2, e3 = par[MOUNT], par[MOUNT + 1], par[MOUNT + 2], par[MOUNT + 3]
            x1 = x2 = x3 = 0.0
        else:
            angle, rate = par[MOUNT], par[MOUNT + 1]
            c, s = math.cos(0.5 * angle), math.sin(0.5 * angle)
            ca, sa = math.cos(rate * t), math.sin(rate * t)
            e0, e1, e2, e3 = c, 0.0, s * ca, s * sa
            x1, x2, x3 = -2.0 * s * s * rate, -2.0 * s * c * rate * sa, 2.0 * s * c * rate * ca
        y0 = q0 * e0 - q1 * e1 - q2 * e2 - q3 * e3
        y1 = q0 * e1 + q1 * e0 + q2 * e3 - q3 * e2
        y2 = q0 * e2 - q1 * e3 + q2 * e0 + q3 * e1
        y3 = q0 * e3 + q1 * e2 - q2 * e1 + q3 * e0
        q0, q1, q2, q3 = y0, y1, y2, y3
        # w <- E^T w + rate of the extra rotation
        z1 = e2 * w3 - e3 * w2
        z2 = e3 * w1 - e1 * w3
        z3 = e1 * w2 - e2 * w1
        y1 = w1 - 2.0 * e0 * z1 + 2.0 * (e2 * z3 - e3 * z2)
        y2 = w2 - 2.0 * e0 * z2 + 2.0 * (e3 * z1 - e1 * z3)
        y3 = w3 - 2.0 * e0 * z3 + 2.0 * (e1 * z2 - e2 * z1)
        w1, w2, w3 = y1 + x1, y2 + x2, y3 + x3
    q[0], q[1], q[2], q[3] = q0, q1, q2, q3
    w[0], w[1], w[2] = w1, w2, w3


@njit(cache=True, error_model="numpy")
def inertial(earth, sl, cl, h, v, a, q, w, out):
    """out (6): w_ib_b and f_b at latitude (sin, cos), height, v_n and its rate a (3), q_nb (4), w_nb_b (3).

    f_b = C_bn (dv/dt + (2 w_ie + w_en) x v - g_n), w_ib_b = w_nb_b + C_bn (w_ie + w_en).
    """
    e2 = earth[1]
    s2 = sl * sl
    x = 1.0 / math.sqrt(1.0 - e2 * s2)
    re = earth[0] * x
    rn = re * (1.0 - e2) * x * x + h
    re += h
    if earth[7] != 0.0:
        g = earth[0] / re
        g = earth[3] * g * g
    else:
        y = h / earth[0]
        g = earth[3] * (1.0 + earth[4] * s2) * x
        g *= 1.0 - 2.0 * (1.0 + earth[5] + earth[6] - 2.0 * earth[5] * s2) * y + 3.0 * y * y
    en_n = v[1] / re
    en_e = -v[0] / rn
    en_d = -en_n * sl / cl
    ie_n = earth[2] * cl
    ie_d = -earth[2] * sl
    w1 = 2.0 * ie_n + en_n
    w3 = 2.0 * ie_d + en_d
    f1 = a[0] + en_e * v[2] - w3 * v[1]
    f2 = a[1] + w3 * v[0] - w1 * v[2]
    f3 = a[2] + w1 * v[1] - en_e * v[0] - g
    w1 = ie_n + en_n
    w3 = ie_d + en_d
    q0, q1, q2, q3 = q[0], q[1], q[2], q[3]
    c11 = q0 * q0 + q1 * q1 - q2 * q2 - q3 * q3
    c22 = q0 * q0 - q1 * q1 + q2 * q2 - q3 * q3
    c33 = q0 * q0 - q1 * q1 - q2 * q2 + q3 * q3
    c12, c21 = 2.0 * (q1 * q2 - q0 * q3), 2.0 * (q1 * q2 + q0 * q3)
    c13, c31 = 2.0 * (q1 * q3 + q0 * q2), 2.0 * (q1 * q3 - q0 * q2)
    c23, c32 = 2.0 * (q2 * q3 - q0 * q1), 2.0 * (q2 * q3 + q0 * q1)
    out[0] = w[0] + c11 * w1 + c21 * en_e + c31 * w3
    out[1] = w[1] + c12 * w1 + c22 * en_e + c32 * w3
    out[2] = w[2] + c13 * w1 + c23 * en_e + c33 * w3
    out[3] = c11 * f1 + c21 * f2 + c31 * f3
    out[4] = c12 * f1 + c22 * f2 + c32 * f3
    out[5] = c13 * f1 + c23 * f2 + c33 * f3


@njit(cache=True, error_model="numpy")
def velocity(par, earth, ch, sl, cl, h, v, a):
    """v_n and its rate from the channels; SURFACE does not need the position, TRACK does."""
    if par[KIND] == SURFACE:
        sp, sp1, c, c1 = ch[0, 0], ch[0, 1], ch[2, 0], ch[2, 1]
        co, si = math.cos(c), math.sin(c)
        v[0], v[1], v[2] = sp * co, sp * si, -ch[1, 0]
        a[0], a[1], a[2] = sp1 * co - sp * c1 * si, sp1 * si + sp * c1 * co, -ch[1, 1]
    else:
        e2 = earth[1]
        ww = 1.0 - e2 * sl * sl
        re = earth[0] / math.sqrt(ww)
        rn = re * (1.0 - e2) / ww
        lat1, lon1, h1 = ch[0, 1], ch[1, 1], ch[2, 1]
        dre = re * e2 * sl * cl / ww * lat1 + h1
        drn = 3.0 * rn * e2 * sl * cl / ww * lat1 + h1
        v[0] = (rn + h) * lat1
        v[1] = (re + h) * cl * lon1
        v[2] = -h1
        a[0] = (rn + h) * ch[0, 2] + drn * lat1
        a[1] = (re + h) * (cl * ch[1, 2] - sl * lat1 * lon1) + dre * cl * lon1
        a[2] = -ch[2, 2]


@njit(cache=True, error_model="numpy")
def circle(t, par, earth, out, row):
    """CIRCLE: out (6) w_ib_b and f_b at t; row (16) the truth there where row is not empty."""
    rate, h = par[RATE], par[HEIGHT]
    c, s = math.cos(rate * t), math.sin(rate * t)
    nx, ny, nz = c * par[8] + s * par[11], c * par[9] + s * par[12], c * par[10] + s * par[13]
    tx, ty, tz = c * par[11] - s * par[8], c * par[12] - s * par[9], c * par[13] - s * par[10]
    kx = par[9] * par[13] - par[10] * par[12]
    ky = par[10] * par[11] - par[8] * par[13]
    kz = par[8] * par[12] - par[9] * par[11]
    e2 = earth[1]
    z1 = rate * tz
    ww = 1.0 - e2 * nz * nz
    w = math.sqrt(ww)
    r0 = earth[0] / w
    r1 = r0 / ww * e2 * nz * z1
    r2 = r0 / ww * e2 * (z1 * z1 - rate * rate * nz * nz + 3.0 * e2 * nz * nz * z1 * z1 / ww)
    # r = (N D + h) n with D = diag(1, 1, 1 - e^2), and its derivatives
    d = 1.0 - e2
    vx = r1 * nx + (r0 + h) * rate * tx
    vy = r1 * ny + (r0 + h) * rate * ty
    vz = d * r1 * nz + (d * r0 + h) * rate * tz
    rr = rate * rate
    ax = r2 * nx + 2.0 * r1 * rate * tx - (r0 + h) * rr * nx
    ay = r2 * ny + 2.0 * r1 * rate * ty - (r0 + h) * rr * ny
    az = d * (r2 * nz + 2.0 * r1 * rate * tz) - (d * r0 + h) * rr * nz
    if earth[7] != 0.0:
        g = earth[0] / (earth[0] + h)
        g = earth[3] * g * g
    else:
        y = h / earth[0]
        g = earth[3] * (1.0 + earth[4] * nz * nz) / w
        g *= 1.0 - 2.0 * (1.0 + earth[5] + earth[6] - 2.0 * earth[5] * nz * nz) * y + 3.0 * y * y
    om = earth[2]
    fx = ax - 2.0 * om * vy + g * nx
    fy = ay + 2.0 * om * vx + g * ny
    fz = az + g * nz
    # body axes: x along t, y along -k, z along -n
    out[0] = om * tz
    out[1] = -om * kz - rate
    out[2] = -om * nz
    out[3] = tx * fx + ty * fy + tz * fz
    out[4] = -(kx * fx + ky * fy + kz * fz)
    out[5] = -(nx * fx + ny * fy + nz * fz)
    if row.size == 0:
        return
    cl = math.sqrt(nx * nx + ny * ny)
    row[0] = math.atan2(nz, cl)
    row[1] = math.atan2(ny, nx)
    row[2] = h
    if cl > 1e-300:
        cb, sb = nx / cl, ny / cl
    else:
        cb, sb = 1.0, 0.0
    # north (-sin lat cos lon, -sin lat sin lon, cos lat), east (-sin lon, cos lon, 0)
    row[3] = -nz * (cb * vx + sb * vy) + cl * vz
    row[4] = cb * vy - sb * vx
    row[5] = -(nx * vx + ny * vy + nz * vz)
    # level: heading of t
    head = math.atan2(cb * ty - sb * tx, -nz * (cb * tx + sb * ty) + cl * tz)
    row[6], row[7], row[8], row[9] = math.cos(0.5 * head), 0.0, 0.0, math.sin(0.5 * head)
    if row.size == ROW:
        for i in range(6):
            row[10 + i] = out[i]


@njit(cache=True, error_model="numpy")
def _truth(t, hint, pos, par, earth, breaks, coefs, waves, ch, v, a, q, w, out, row):
    """row (10 or 16) of SURFACE or TRACK at t; pos (lat, lon, h and their carries) is used by SURFACE."""
    i = channels(t, hint, par, breaks, coefs, waves, ch)
    if par[KIND] == SURFACE:
        lat, lon, h = pos[0], pos[1], pos[2]
    else:
        lat, lon, h = ch[0, 0], ch[1, 0], ch[2, 0]
    sl, cl = math.sin(lat), math.cos(lat)
    velocity(par, earth, ch, sl, cl, h, v, a)
    attitude(t, par, ch, q, w)
    row[0] = lat
    # longitude back into (-pi, pi]
    row[1] = lon - 2.0 * math.pi * math.ceil((lon - math.pi) / (2.0 * math.pi))
    row[2] = h
    for k in range(3):
        row[3 + k] = v[k]
    for k in range(4):
        row[6 + k] = q[k]
    if row.size == ROW:
        inertial(earth, sl, cl, h, v, a, q, w, out)
        for k in range(6):
            row[10 + k] = out[k]
    return i


@njit(cache=True, error_model="numpy")
def _interval(t0, dt, hint, pos, par, earth, breaks, coefs, waves, gc, gb, ga, ch, vs, ac, qs, ws, rates, out, total):
    """total (6) <- integrals of w_ib_b and f_b over (t0, t0 + dt]; pos is carried to the end. Returns the hint."""
    m = gc.size
    for k in range(6):
        total[k] = 0.0
    if par[KIND] == CIRCLE:
        for i in range(m):
            circle(t0 + gc[i] * dt, par, earth, out, total[:0])
            for k in range(6):
                total[k] += gb[i] * dt * out[k]
        return hint
    if par[KIND] == TRACK:
        for i in range(m):
            t = t0 + gc[i] * dt
            hint = channels(t, hint, par, breaks, coefs, waves, ch)
            sl, cl = math.sin(ch[0, 0]), math.cos(ch[0, 0])
            velocity(par, earth, ch, sl, cl, ch[2, 0], vs[i], ac[i])
            attitude(t, par, ch, qs[i], ws[i])
            inertial(earth, sl, cl, ch[2, 0], vs[i], ac[i], qs[i], ws[i], out)
            for k in range(6):
                total[k] += gb[i] * dt * out[k]
        return hint
    lat0, h0 = pos[0], pos[2]
    s0, c0 = math.sin(lat0), math.cos(lat0)
    still = True
    for i in range(m):
        t = t0 + gc[i] * dt
        hint = channels(t, hint, par, breaks, coefs, waves, ch)
        velocity(par, earth, ch, s0, c0, h0, vs[i], ac[i])
        attitude(t, par, ch, qs[i], ws[i])
        still = still and ch[0, 0] == 0.0 and ch[1, 0] == 0.0
        # rates[i]: lat, lon, h, and at the node: lat less lat0, h, sin, cos
        rates[i, 3] = 0.0
        rates[i, 4] = h0
        rates[i, 5], rates[i, 6] = s0, c0
    if not still:
        e2 = earth[1]
        ww = 1.0 - e2 * s0 * s0
        re = earth[0] / math.sqrt(ww)
        rn = re * (1.0 - e2) / ww + h0
        for i in range(m):
            rates[i, 0] = vs[i, 0] / rn
        for _ in range(2):
            for i in range(m):
                x = 0.0
                y = 0.0
                for j in range(m):
                    x += ga[i, j] * rates[j, 0]
                    y -= ga[i, j] * vs[j, 2]
                x *= dt
                # sine and cosine of a small step
                s = x * (1.0 - x * x / 6.0)
                c = -0.5 * x * x * (1.0 - x * x / 12.0)
                rates[i, 3] = x
                rates[i, 4] = h0 + dt * y
                rates[i, 5] = s0 + (c0 * s + s0 * c)
                rates[i, 6] = c0 + (c0 * c - s0 * s)
            for i in range(m):
                sl, cl, h = rates[i, 5], rates[i, 6], rates[i, 4]
                ww = 1.0 - e2 * sl * sl
                re = earth[0] / math.sqrt(ww)
                rn = re * (1.0 - e2) / ww + h
                rates[i, 0] = vs[i, 0] / rn
                rates[i, 1] = vs[i, 1] / ((re + h) * cl)
                rates[i, 2] = -vs[i, 2]
        for k in range(3):
            x = -pos[3 + k]
            for i in range(m):
                x += gb[i] * dt * rates[i, k]
            y = pos[k] + x
            pos[3 + k] = (y - pos[k]) - x
            pos[k] = y
    for i in range(m):
        inertial(earth, rates[i, 5], rates[i, 6], rates[i, 4], vs[i], ac[i], qs[i], ws[i], out)
        for k in range(6):
            total[k] += gb[i] * dt * out[k]
    return hint


@njit(cache=True, error_model="numpy")
def generate(k0, n, rate, pos, par, earth, breaks, coefs, waves, gc, gb, ga, every, dtheta, dv, rows):
    """Increments (n, 3) over n intervals of 1/rate from epoch k0; rows (n // every, 10 or 16) of truth; pos (6) is
    carried, so that any split into calls gives the same bits."""
    m = gc.size
    ch = np.zeros((CHANNELS, 3))
    vs, ac, ws = np.zeros((m, 3)), np.zeros((m, 3)), np.zeros((m, 3))
    qs, rates = np.zeros((m, 4)), np.zeros((m, 7))
    out, total = np.zeros(6), np.zeros(6)
    hint = 0
    row = 0
    for j in range(n):
        t0 = (k0 + j) / rate
        t1 = (k0 + j + 1) / rate
        hint = _interval(
            t0, t1 - t0, hint, pos, par, earth, breaks, coefs, waves, gc, gb, ga, ch, vs, ac, qs, ws, rates, out, total
        )
        for k in range(3):
            dtheta[j, k] = total[k]
            dv[j, k] = total[3 + k]
        if (k0 + j + 1) % every == 0 and row < rows.shape[0]:
            if par[KIND] == CIRCLE:
                circle(t1, par, earth, out, rows[row])
            else:
                hint = _truth(
                    t1, hint, pos, par, earth, breaks, coefs, waves, ch, vs[0], ac[0], qs[0], ws[0], out, rows[row]
                )
            row += 1


@njit(cache=True, error_model="numpy")
def sample(times, grid, pos, par, earth, breaks, coefs, waves, gc, gb, ga, rows):
    """rows (n, 16) of truth at the sorted times (n,) >= 0; SURFACE is carried in steps of `grid` s and one shorter."""
    m = gc.size
    ch = np.zeros((CHANNELS, 3))
    vs, ac, ws = np.zeros((m, 3)), np.zeros((m, 3)), np.zeros((m, 3))
    qs, rates = np.zeros((m, 4)), np.zeros((m, 7))
    out, total = np.zeros(6), np.zeros(6)
    p = np.zeros(6)
    hint = 0
    k = 0
    for j in range(times.size):
        t = times[j]
        if par[KIND] == CIRCLE:
            circle(t, par, earth, out, rows[j])
            continue
        if par[KIND] == SURFACE:
            while (k + 1) * grid <= t:
                hint = _interval(
                    k * grid, (k + 1) * grid - k * grid, hint, pos, par, earth, breaks, coefs, waves, gc, gb, ga,
                    ch, vs, ac, qs, ws, rates, out, total,
                )  # fmt: skip
                k += 1
            p[:] = pos
            if t > k * grid:
                _interval(
                    k * grid, t - k * grid, hint, p, par, earth, breaks, coefs, waves, gc, gb, ga,
                    ch, vs, ac, qs, ws, rates, out, total,
                )  # fmt: skip
        hint = _truth(t, hint, p, par, earth, breaks, coefs, waves, ch, vs[0], ac[0], qs[0], ws[0], out, rows[j])
