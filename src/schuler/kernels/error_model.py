"""Linear error model of a strapdown INS, phi form: F (9 x 9) and its propagation, with biases as further states.

x = (phi (3), dv (3), dlat, dlon, dh), NED, estimate - truth, C_hat = (I - [phi x]) C. Earth array as in
`kernels.mechanization`. On a sphere and on the ellipsoid every element is the exact derivative, radii and gravity
included.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit


@njit(cache=True, error_model="numpy")
def earth_terms(earth, lat, h, out):
    """out (8): sin, cos of lat, 1/(R_N+h), 1/(R_E+h), dR_N/dlat, dR_E/dlat, dg/dlat, dg/dh; returns g."""
    s, c = math.sin(lat), math.cos(lat)
    e2 = earth[1]
    ww = 1.0 - e2 * s * s
    re = earth[0] / math.sqrt(ww)
    rn = re * (1.0 - e2) / ww
    out[0], out[1] = s, c
    out[2] = 1.0 / (rn + h)
    out[3] = 1.0 / (re + h)
    out[4] = 3.0 * rn * e2 * s * c / ww
    out[5] = re * e2 * s * c / ww
    if earth[7] != 0.0:
        x = earth[0] / (earth[0] + h)
        g = earth[3] * x * x
        out[6] = 0.0
        out[7] = -2.0 * g * out[3]
        return g
    y = h / earth[0]
    k, f, m = earth[4], earth[5], earth[6]
    root = math.sqrt(ww)
    g0 = earth[3] * (1.0 + k * s * s) / root
    dg0 = earth[3] * 2.0 * s * c * (k / root + 0.5 * e2 * (1.0 + k * s * s) / (ww * root))
    a1 = -2.0 * (1.0 + f + m - 2.0 * f * s * s)
    x = 1.0 + a1 * y + 3.0 * y * y
    out[6] = dg0 * x + g0 * 8.0 * f * s * c * y
    out[7] = g0 * (a1 + 6.0 * y) / earth[0]
    return g0 * x


@njit(cache=True, error_model="numpy")
def fill_f(earth, lat, h, v, f_n, term, F):
    """F (>= 9, >= 9), its first nine rows and columns, at (lat, h), v (3) and specific force f_n (3), NED."""
    earth_terms(earth, lat, h, term)
    s, c, kn, ke = term[0], term[1], term[2], term[3]
    t = s / c
    om = earth[2]
    vn, ve, vd = v[0], v[1], v[2]
    en_n, en_e, en_d = ve * ke, -vn * kn, -ve * ke * t
    in_n, in_d = om * c + en_n, -om * s + en_d
    # derivatives of the transport rate: by v_E (north, down), by v_N (east); by lat and h; of the Earth rate by lat
    a_n, a_d, a_e = ke, -ke * t, -kn
    ln = -ve * ke * ke * term[5]
    le = vn * kn * kn * term[4]
    ld = -ve * (ke / (c * c) - t * ke * ke * term[5])
    hn, he, hd = -ve * ke * ke, vn * kn * kn, ve * ke * ke * t
    on, od = -om * s, -om * c
    for i in range(9):
        for j in range(9):
            F[i, j] = 0.0
    # phi' = -w_in x phi + dw_in
    F[0, 1], F[0, 2] = in_d, -en_e
    F[1, 0], F[1, 2] = -in_d, in_n
    F[2, 0], F[2, 1] = en_e, -in_n
    F[0, 4], F[1, 3], F[2, 4] = a_n, a_e, a_d
    F[0, 6], F[1, 6], F[2, 6] = on + ln, le, od + ld
    F[0, 8], F[1, 8], F[2, 8] = hn, he, hd
    # dv' = f x phi - W x dv - dW x v + dg, W = 2 w_ie + w_en
    F[3, 1], F[3, 2] = -f_n[2], f_n[1]
    F[4, 0], F[4, 2] = f_n[2], -f_n[0]
    F[5, 0], F[5, 1] = -f_n[1], f_n[0]
    w1, w2, w3 = 2.0 * om * c + en_n, en_e, -2.0 * om * s + en_d
    # -dw x v for dw = (p, q, r): (-(q vd - r ve), -(r vn - p vd), -(p ve - q vn))
    F[3, 3] = -a_e * vd
    F[4, 3] = w1 * 0.0 - w3
    F[5, 3] = w2 + a_e * vn
    F[3, 4] = w3 + a_d * ve
    F[4, 4] = -(a_d * vn - a_n * vd)
    F[5, 4] = -w1 - a_n * ve
    F[3, 5] = -w2
    F[4, 5] = w1
    p, q, r = 2.0 * on + ln, le, 2.0 * od + ld
    F[3, 6] = -(q * vd - r * ve)
    F[4, 6] = -(r * vn - p * vd)
    F[5, 6] = -(p * ve - q * vn) + term[6]
    F[3, 8] = -(he * vd - hd * ve)
    F[4, 8] = -(hd * vn - hn * vd)
    F[5, 8] = -(hn * ve - he * vn) + term[7]
    # position
    F[6, 3] = kn
    F[6, 6] = -vn * kn * kn * term[4]
    F[6, 8] = -vn * kn * kn
    F[7, 4] = ke / c
    F[7, 6] = ve * ke / c * (t - ke * term[5])
    F[7, 8] = -ve * ke * ke / c
    F[8, 5] = -1.0


@njit(cache=True, error_model="numpy")
def middle(earth, dt, lat0, h0, v0, q0, lat1, h1, v1, q1, term, v, f_n, C):
    """Means over a step between two truth rows: v (3), the specific force f_n (3) that made it, C_nb (3, 3)."""
    lat, h = 0.5 * (lat0 + lat1), 0.5 * (h0 + h1)
    g = earth_terms(earth, lat, h, term)
    s, c = term[0], term[1]
    for i in range(3):
        v[i] = 0.5 * (v0[i] + v1[i])
    w1 = 2.0 * earth[2] * c + v[1] * term[3]
    w2 = -v[0] * term[2]
    w3 = -2.0 * earth[2] * s - v[1] * term[3] * s / c
    f_n[0] = (v1[0] - v0[0]) / dt + w2 * v[2] - w3 * v[1]
    f_n[1] = (v1[1] - v0[1]) / dt + w3 * v[0] - w1 * v[2]
    f_n[2] = (v1[2] - v0[2]) / dt + w1 * v[1] - w2 * v[0] - g
    for i in range(3):
        for j in range(3):
            C[i, j] = 0.0
    for k in range(2):
        a, b, c, d = (q0[0], q0[1], q0[2], q0[3]) if k == 0 else (q1[0], q1[1], q1[2], q1[3])
        C[0, 0] += 0.5 * (a * a + b * b - c * c - d * d)
        C[0, 1] += b * c - a * d
        C[0, 2] += b * d + a * c
        C[1, 0] += b * c + a * d
        C[1, 1] += 0.5 * (a * a - b * b + c * c - d * d)
        C[1, 2] += c * d - a * b
        C[2, 0] += b * d - a * c
        C[2, 1] += c * d + a * b
        C[2, 2] += 0.5 * (a * a - b * b - c * c + d * d)
    return lat


@njit(cache=True, error_model="numpy")
def drop_vertical(F, n):
    """Takes dv_D and dh out: their rows and columns become zero."""
    for k in (5, 8):
        for j in range(n):
            F[k, j] = 0.0
            F[j, k] = 0.0


@njit(cache=True, error_model="numpy")
def propagate(earth, time, lat, h, v_n, q_nb, x0, u, held, out):
    """out (n, 9): the error state from x0 (9) along truth rows, driven by u (n - 1, 6) or (1, 6): accelerometer, gyro
    errors in b, SI, mean over each step. The step uses F at its middle; its exponential by a series on the vector."""
    n = time.size
    F = np.zeros((9, 9))
    C = np.zeros((3, 3))
    term, v, f_n = np.zeros(8), np.zeros(3), np.zeros(3)
    b, t, y = np.zeros(9), np.zeros(9), np.zeros(9)
    x = x0.copy()
    out[0] = x
    for k in range(n - 1):
        dt = time[k + 1] - time[k]
        m = middle(earth, dt, lat[k], h[k], v_n[k], q_nb[k], lat[k + 1], h[k + 1], v_n[k + 1], q_nb[k + 1],
                   term, v, f_n, C)  # fmt: skip
        fill_f(earth, m, 0.5 * (h[k] + h[k + 1]), v, f_n, term, F)
        i = k if u.shape[0] > 1 else 0
        for a in range(3):
            b[a] = -(C[a, 0] * u[i, 3] + C[a, 1] * u[i, 4] + C[a, 2] * u[i, 5])
            b[3 + a] = C[a, 0] * u[i, 0] + C[a, 1] * u[i, 1] + C[a, 2] * u[i, 2]
        if held:
            drop_vertical(F, 9)
            b[5] = 0.0
        for a in range(9):
            t[a] = b[a]
            for c in range(9):
                t[a] += F[a, c] * x[c]
            t[a] *= dt
        for j in range(2, 7):
            for a in range(9):
                x[a] += t[a]
                y[a] = 0.0
                for c in range(9):
                    y[a] += F[a, c] * t[c]
            for a in range(9):
                t[a] = y[a] * dt / j
        out[k + 1] = x


@njit(cache=True, error_model="numpy")
def covariance(earth, time, lat, h, v_n, q_nb, P0, psd, tau, walk, held, out):
    """out (n, 15, 15): covariance of (phi, dv, dlat, dlon, dh, b_a (3), b_g (3)) along truth rows.

    psd (6): white accelerometer then gyro error, (m/s^2)^2/Hz and (rad/s)^2/Hz; tau (6) s of the biases' Gauss-Markov
    decay (inf: constant); walk (6): driving density of each bias, per s.
    """
    n = time.size
    F, A, T, P = np.zeros((15, 15)), np.zeros((15, 15)), np.zeros((15, 15)), P0.copy()
    C = np.zeros((3, 3))
    term, v, f_n = np.zeros(8), np.zeros(3), np.zeros(3)
    out[0] = P
    for k in range(n - 1):
        dt = time[k + 1] - time[k]
        m = middle(earth, dt, lat[k], h[k], v_n[k], q_nb[k], lat[k + 1], h[k + 1], v_n[k + 1], q_nb[k + 1],
                   term, v, f_n, C)  # fmt: skip
        fill_f(earth, m, 0.5 * (h[k] + h[k + 1]), v, f_n, term, F)
        for a in range(3):
            for c in range(3):
                F[3 + a, 9 + c] = C[a, c]
                F[a, 12 + c] = -C[a, c]
        for a in range(6):
            F[9 + a, 9 + a] = -1.0 / tau[a]
        if held:
            drop_vertical(F, 15)
        # A = I + F dt + (F dt)^2 / 2
        for a in range(15):
            for c in range(15):
                x = 0.0
                if a < 9:
                    for j in range(15):
                        x += F[a, j] * F[j, c]
                A[a, c] = F[a, c] * dt + 0.5 * dt * dt * x
            if a >= 9:
                A[a, a] += 0.5 * dt * dt * F[a, a] * F[a, a]
            A[a, a] += 1.0
        # half of the noise before the step, half after it
        for half in range(2):
            for a in range(3):
                for c in range(3):
                    g = 0.0
                    s = 0.0
                    for j in range(3):
                        g += C[a, j] * C[c, j] * psd[3 + j]
                        s += C[a, j] * C[c, j] * psd[j]
                    P[a, c] += 0.5 * dt * g
                    if not held or (a < 2 and c < 2):
                        P[3 + a, 3 + c] += 0.5 * dt * s
            for a in range(6):
                P[9 + a, 9 + a] += 0.5 * dt * walk[a]
            if half == 0:
                for a in range(15):
                    for c in range(15):
                        x = 0.0
                        if a < 9:
                            for j in range(15):
                                x += A[a, j] * P[j, c]
                        else:
                            x = A[a, a] * P[a, c]
                        T[a, c] = x
                for a in range(15):
                    for c in range(a, 15):
                        x = 0.0
                        if c < 9:
                            for j in range(15):
                                x += T[a, j] * A[c, j]
                        else:
                            x = T[a, c] * A[c, c]
                        P[a, c] = x
                        P[c, a] = x
        out[k + 1] = P
