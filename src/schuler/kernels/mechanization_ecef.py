"""Strapdown mechanization in Earth-fixed axes: attitude quaternion e<-b, velocity over ground and position in e.

    dC_eb/dt = C_eb [w_ib x] - [w_ie x] C_eb,   dv/dt = C_eb f - 2 w_ie x v + g_e(r),   dr/dt = v

The thesis's (5.11) with its first row put right. Motion inside an interval (coning, sculling, scrolling) is the twist
of `kernels.mechanization`; nothing is singular anywhere, and there is no transport rate. Gravity is normal gravity,
straight down, as everywhere here, so that this and the level form are one navigator in two sets of axes. Sums that run
for hours are compensated. SI and radians. Source: Savage (2000), Strapdown Analytics, chapter 7, for the increments;
Groves (2013), section 5.3, for the equations in e.
"""

from __future__ import annotations

import math

from numba import njit

from .geodesy import e_from_ned, ecef_from_geodetic, ned_from_e, normal_from_ecef
from .mechanization import HELD, NONE, ONE, PAIR, THREE
from .rotation import dcm_from_quat, quat_product

# State: [quaternion e<-b, its carry, velocity (3), its carry (3), position (3), its carry (3), gravity of the last
# step (3), last three (dtheta, dv), last three dt, samples seen]
STATE = 48
Q, V, R, G, MEMORY = 0, 8, 14, 20, 23
STEPS = MEMORY + 18
SEEN = STEPS + 3
RAW = 10  # quaternion e<-b, velocity, position
R19_60, R240, R720 = 19.0 / 60.0, 1.0 / 240.0, 1.0 / 720.0


@njit(cache=True, error_model="numpy")
def gravity_e(earth, x, y, z):
    """Plumb-bob gravity in e, m/s^2, at a position in e: down along the ellipsoid's normal."""
    s, c, so, co, h = normal_from_ecef(x, y, z, earth[0], earth[1])
    if earth[7] != 0.0:
        g = earth[0] / (earth[0] + h)
        g = earth[3] * g * g
    else:
        u = h / earth[0]
        s2 = s * s
        g = earth[3] * (1.0 + earth[4] * s2) / math.sqrt(1.0 - earth[1] * s2)
        g *= 1.0 - 2.0 * (1.0 + earth[5] + earth[6] - 2.0 * earth[5] * s2) * u + 3.0 * u * u
    return -g * c * co, -g * c * so, -g * s


@njit(cache=True, error_model="numpy")
def begin(state, earth, lat, lon, h, vn, ve, vd, q0, q1, q2, q3):
    """Fills the state from geodetic position, NED velocity and q_nb."""
    state[:] = 0.0
    a = -0.25 * math.pi - 0.5 * lat
    ca, sa = math.cos(a), math.sin(a)
    cl, sl = math.cos(0.5 * lon), math.sin(0.5 * lon)
    state[0], state[1], state[2], state[3] = quat_product(cl * ca, -sl * sa, cl * sa, sl * ca, q0, q1, q2, q3)
    sp, cp, so, co = math.sin(lat), math.cos(lat), math.sin(lon), math.cos(lon)
    state[V], state[V + 1], state[V + 2] = e_from_ned(sp, cp, so, co, vn, ve, vd)
    x, y, z = ecef_from_geodetic(lat, lon, h, earth[0], earth[1])
    state[R], state[R + 1], state[R + 2] = x, y, z
    state[G], state[G + 1], state[G + 2] = gravity_e(earth, x, y, z)


@njit(cache=True, error_model="numpy")
def bracket(a1, a2, a3, b1, b2, b3, c1, c2, c3, d1, d2, d3):
    """[(a, b), (c, d)] = (a x c, a x d + b x c): how two twists fail to commute."""
    return (
        a2 * c3 - a3 * c2,
        a3 * c1 - a1 * c3,
        a1 * c2 - a2 * c1,
        a2 * d3 - a3 * d2 + b2 * c3 - b3 * c2,
        a3 * d1 - a1 * d3 + b3 * c1 - b1 * c3,
        a1 * d2 - a2 * d1 + b1 * c2 - b2 * c1,
    )


@njit(cache=True, error_model="numpy")
def slopes(scheme, seen, step, d1, d2, d3):
    """Weights (m0, m1, m2) of this and the two increments before in the slope B, the factor of [D, B], and whether the
    third difference may be used too; see `kernels.mechanization`."""
    r12 = 1.0 / 12.0
    if seen == 0 or scheme == NONE:
        return 0.0, 0.0, 0.0, r12, False
    if scheme == ONE or seen == 1:
        m0 = 2.0 * step / (step + d1)
        return m0, -m0 * step / d1, 0.0, (2.0 * r12 if seen == 1 else r12), False
    x01, x12 = 0.5 * (step + d1), 0.5 * (d1 + d2)
    b = x01 / (x01 + x12)
    tiny = 1e-6 * step
    full = scheme == THREE and seen > 2 and abs(step - d1) < tiny and abs(step - d2) < tiny and abs(step - d3) < tiny
    return (
        step * (1.0 + b) / x01,
        -step * step / d1 * ((1.0 + b) / x01 + b / x12),
        step * step / d2 * b / x12,
        r12,
        full,
    )


@njit(cache=True, error_model="numpy")
def run(state, earth, dtheta, dv, dt, scheme, vertical, height, v_down, every, raw):
    """Carries the state over n intervals; raw (n // every, 10) gets every `every`-th epoch. As
    `kernels.mechanization.run`; vertical: FREE or HELD, scheme: any but PAIR."""
    n = dtheta.shape[0]
    if scheme == PAIR:
        return
    omega = earth[2]
    q0, q1, q2, q3 = state[0], state[1], state[2], state[3]
    k0, k1, k2, k3 = state[4], state[5], state[6], state[7]
    v1, v2, v3, vc1, vc2, vc3 = state[8], state[9], state[10], state[11], state[12], state[13]
    r1, r2, r3, rc1, rc2, rc3 = state[14], state[15], state[16], state[17], state[18], state[19]
    g1, g2, g3 = state[20], state[21], state[22]
    t11, t12, t13, u11, u12, u13 = state[23], state[24], state[25], state[26], state[27], state[28]
    t21, t22, t23, u21, u22, u23 = state[29], state[30], state[31], state[32], state[33], state[34]
    t31, t32, t33, u31, u32, u33 = state[35], state[36], state[37], state[38], state[39], state[40]
    d1, d2, d3 = state[41], state[42], state[43]
    seen = int(state[44])
    uniform, one_h, one_v = dt.size == 1, height.size == 1, v_down.size == 1
    step = dt[0]
    last = -1.0
    spin_c = spin_s = 0.0
    r12 = 1.0 / 12.0
    row = 0
    for k in range(n):
        if not uniform:
            step = dt[k]
        t1, t2, t3 = dtheta[k, 0], dtheta[k, 1], dtheta[k, 2]
        f1, f2, f3 = dv[k, 0], dv[k, 1], dv[k, 2]
        m0, m1, m2, factor, full = slopes(scheme, seen, step, d1, d2, d3)
        w1 = m0 * t1 + m1 * t11 + m2 * t21
        w2 = m0 * t2 + m1 * t12 + m2 * t22
        w3 = m0 * t3 + m1 * t13 + m2 * t23
        s1 = m0 * f1 + m1 * u11 + m2 * u21
        s2 = m0 * f2 + m1 * u12 + m2 * u22
        s3 = m0 * f3 + m1 * u13 + m2 * u23
        if full:
            x1, x2, x3 = t1 - t31 + 3.0 * (t21 - t11), t2 - t32 + 3.0 * (t22 - t12), t3 - t33 + 3.0 * (t23 - t13)
            y1, y2, y3 = f1 - u31 + 3.0 * (u21 - u11), f2 - u32 + 3.0 * (u22 - u12), f3 - u33 + 3.0 * (u23 - u13)
            w1 += R19_60 * x1
            w2 += R19_60 * x2
            w3 += R19_60 * x3
            s1 += R19_60 * y1
            s2 += R19_60 * y2
            s3 += R19_60 * y3
            x1, x2, x3 = R720 * (x1 + t1 - 2.0 * t11 + t21), R720 * (x2 + t2 - 2.0 * t12 + t22), R720 * (
                x3 + t3 - 2.0 * t13 + t23
            )  # fmt: skip
            y1, y2, y3 = R720 * (y1 + f1 - 2.0 * u11 + u21), R720 * (y2 + f2 - 2.0 * u12 + u22), R720 * (
                y3 + f3 - 2.0 * u13 + u23
            )  # fmt: skip
        else:
            x1 = x2 = x3 = y1 = y2 = y3 = 0.0
        o1, o2, o3, p1, p2, p3 = bracket(t1, t2, t3, f1, f2, f3, w1, w2, w3, s1, s2, s3)
        if full:
            a1, a2, a3, b1, b2, b3 = bracket(
                w1, w2, w3, s1, s2, s3, x1 - R240 * o1, x2 - R240 * o2, x3 - R240 * o3, y1 - R240 * p1, y2 - R240 * p2,
                y3 - R240 * p3,
            )  # fmt: skip
            l1, l2, l3, z1, z2, z3 = bracket(
                t1, t2, t3, f1, f2, f3, x1 - R720 * o1, x2 - R720 * o2, x3 - R720 * o3, y1 - R720 * p1, y2 - R720 * p2,
                y3 - R720 * p3,
            )  # fmt: skip
            l1, l2, l3, z1, z2, z3 = bracket(t1, t2, t3, f1, f2, f3, l1, l2, l3, z1, z2, z3)
            o1, o2, o3 = t1 + r12 * o1 + (a1 + l1), t2 + r12 * o2 + (a2 + l2), t3 + r12 * o3 + (a3 + l3)
            p1, p2, p3 = f1 + r12 * p1 + (b1 + z1), f2 + r12 * p2 + (b2 + z2), f3 + r12 * p3 + (b3 + z3)
        else:
            o1, o2, o3 = t1 + factor * o1, t2 + factor * o2, t3 + factor * o3
            p1, p2, p3 = f1 + factor * p1, f2 + factor * p2, f3 + factor * p3
        if seen > 1:
            t31, t32, t33, u31, u32, u33 = t21, t22, t23, u21, u22, u23
        t21, t22, t23, u21, u22, u23 = t11, t12, t13, u11, u12, u13
        t11, t12, t13, u11, u12, u13 = t1, t2, t3, f1, f2, f3
        d3, d2, d1 = d2, d1, step
        seen += 1
        # rotation by phi and the two integrals of the velocity
        x = o1 * o1 + o2 * o2 + o3 * o3
        if x < 0.01:
            hs = 0.5 - x * (1.0 / 48.0 - x * (1.0 / 3840.0 - x * (1.0 / 645120.0 - x / 185794560.0)))
            hc = -x * (0.125 - x * (1.0 / 384.0 - x * (1.0 / 46080.0 - x / 10321920.0)))
            ja = 0.5 - x * (1.0 / 24.0 - x * (1.0 / 720.0 - x * (1.0 / 40320.0 - x / 3628800.0)))
            jb = 1.0 / 6.0 - x * (1.0 / 120.0 - x * (1.0 / 5040.0 - x / 362880.0))
            jc = 1.0 / 24.0 - x * (1.0 / 720.0 - x * (1.0 / 40320.0 - x / 3628800.0))
        else:
            ang = math.sqrt(x)
            sh = math.sin(0.5 * ang)
            hs, hc = sh / ang, math.cos(0.5 * ang) - 1.0
            ja = 2.0 * sh * sh / x
            jb = (ang - math.sin(ang)) / (x * ang)
            jc = (0.5 - ja) / x
        y1, y2, y3 = o2 * p3 - o3 * p2, o3 * p1 - o1 * p3, o1 * p2 - o2 * p1
        z1, z2, z3 = o2 * y3 - o3 * y2, o3 * y1 - o1 * y3, o1 * y2 - o2 * y1
        # velocity gained, and its mean over the interval, in b of the start
        a1, a2, a3 = p1 + ja * y1 + jb * z1, p2 + ja * y2 + jb * z2, p3 + ja * y3 + jb * z3
        b1 = 0.5 * p1 + jb * y1 + jc * z1 - r12 * (s1 + 0.5 * (o2 * s3 - o3 * s2))
        b2 = 0.5 * p2 + jb * y2 + jc * z2 - r12 * (s2 + 0.5 * (o3 * s1 - o1 * s3))
        b3 = 0.5 * p3 + jb * y3 + jc * z3 - r12 * (s3 + 0.5 * (o1 * s2 - o2 * s1))
        e11, e12, e13, e21, e22, e23, e31, e32, e33 = dcm_from_quat(q0, q1, q2, q3)
        x1 = e11 * a1 + e12 * a2 + e13 * a3
        x2 = e21 * a1 + e22 * a2 + e23 * a3
        x3 = e31 * a1 + e32 * a2 + e33 * a3
        l1 = e11 * b1 + e12 * b2 + e13 * b3
        l2 = e21 * b1 + e22 * b2 + e23 * b3
        l3 = e31 * b1 + e32 * b2 + e33 * b3
        # what turns with the Earth in the interval: w_ie = (0, 0, omega)
        turn = omega * step
        # mean velocity; a third of turn x l because the gain turns, two thirds of turn x (l + half g) because Coriolis
        # grows with the velocity
        half = 0.5 * step
        x = step / 3.0
        b1 = v1 + l1 + turn * (l2 + x * g2) + half * (g1 + 2.0 * omega * v2)
        b2 = v2 + l2 - turn * (l1 + x * g1) + half * (g2 - 2.0 * omega * v1)
        b3 = v3 + l3 + half * g3
        # gravity at the mean position
        z1 = r1 + step * (v1 / 6.0 + b1 / 3.0)
        z2 = r2 + step * (v2 / 6.0 + b2 / 3.0)
        z3 = r3 + step * (v3 / 6.0 + b3 / 3.0)
        y1, y2, y3 = g1, g2, g3
        g1, g2, g3 = gravity_e(earth, z1, z2, z3)
        # what gravity gives counts more the earlier it acts: its change over an interval, h^2/12 of its rate
        x = half - step * r12
        b1 += x * (g1 - y1)
        b2 += x * (g2 - y2)
        b3 += x * (g3 - y3)
        # velocity: gain, less its turn, Coriolis of the mean velocity, gravity
        x = turn * turn / 6.0
        y1 = x1 + turn * (x2 - l2) - x * x1 + step * (g1 + 2.0 * omega * b2) - vc1
        y2 = x2 - turn * (x1 - l1) - x * x2 + step * (g2 - 2.0 * omega * b1) - vc2
        y3 = x3 + step * g3 - vc3
        z1, z2, z3 = v1 + y1, v2 + y2, v3 + y3
        vc1, vc2, vc3 = (z1 - v1) - y1, (z2 - v2) - y2, (z3 - v3) - y3
        v1, v2, v3 = z1, z2, z3
        y1, y2, y3 = step * b1 - rc1, step * b2 - rc2, step * b3 - rc3
        z1, z2, z3 = r1 + y1, r2 + y2, r3 + y3
        rc1, rc2, rc3 = (z1 - r1) - y1, (z2 - r2) - y2, (z3 - r3) - y3
        r1, r2, r3 = z1, z2, z3
        if vertical == HELD:
            s, c, so, co, h = normal_from_ecef(r1, r2, r3, earth[0], earth[1])
            up = (height[0] if one_h else height[k]) - h
            r1 += up * c * co
            r2 += up * c * so
            r3 += up * s
            up = -(v_down[0] if one_v else v_down[k]) - (c * (co * v1 + so * v2) + s * v3)
            v1 += up * c * co
            v2 += up * c * so
            v3 += up * s
        # attitude: q <- exp(-turn about z) q exp(phi), as an increment
        if step != last:
            last = step
            spin_c = -2.0 * math.sin(0.25 * turn) ** 2
            spin_s = -math.sin(0.5 * turn)
        x1, x2, x3 = hs * o1, hs * o2, hs * o3
        y0 = hc * q0 - x1 * q1 - x2 * q2 - x3 * q3
        y1 = hc * q1 + x1 * q0 + x3 * q2 - x2 * q3
        y2 = hc * q2 + x2 * q0 + x1 * q3 - x3 * q1
        y3 = hc * q3 + x3 * q0 + x2 * q1 - x1 * q2
        z0, z1, z2, z3 = q0 + y0, q1 + y1, q2 + y2, q3 + y3
        grow = spin_c + 0.5 * (1.0 - (q0 * q0 + q1 * q1 + q2 * q2 + q3 * q3))
        y0 += grow * z0 - spin_s * z3 - k0
        y1 += grow * z1 - spin_s * z2 - k1
        y2 += grow * z2 + spin_s * z1 - k2
        y3 += grow * z3 + spin_s * z0 - k3
        z0, z1, z2, z3 = q0 + y0, q1 + y1, q2 + y2, q3 + y3
        k0, k1, k2, k3 = (z0 - q0) - y0, (z1 - q1) - y1, (z2 - q2) - y2, (z3 - q3) - y3
        q0, q1, q2, q3 = z0, z1, z2, z3
        if (k + 1) % every == 0 and row < raw.shape[0]:
            raw[row, 0], raw[row, 1], raw[row, 2], raw[row, 3] = q0, q1, q2, q3
            raw[row, 4], raw[row, 5], raw[row, 6] = v1, v2, v3
            raw[row, 7], raw[row, 8], raw[row, 9] = r1, r2, r3
            row += 1
    state[0], state[1], state[2], state[3] = q0, q1, q2, q3
    state[4], state[5], state[6], state[7] = k0, k1, k2, k3
    state[8], state[9], state[10], state[11], state[12], state[13] = v1, v2, v3, vc1, vc2, vc3
    state[14], state[15], state[16], state[17], state[18], state[19] = r1, r2, r3, rc1, rc2, rc3
    state[20], state[21], state[22] = g1, g2, g3
    state[23], state[24], state[25], state[26], state[27], state[28] = t11, t12, t13, u11, u12, u13
    state[29], state[30], state[31], state[32], state[33], state[34] = t21, t22, t23, u21, u22, u23
    state[35], state[36], state[37], state[38], state[39], state[40] = t31, t32, t33, u31, u32, u33
    state[41], state[42], state[43] = d1, d2, d3
    state[44] = seen


@njit(cache=True, error_model="numpy")
def to_ned(raw, earth, out):
    """Rows of `run` (m, 10) into lat, lon, height, v_n (3), q_nb (4)."""
    for i in range(raw.shape[0]):
        s, c, so, co, h = normal_from_ecef(raw[i, 7], raw[i, 8], raw[i, 9], earth[0], earth[1])
        lat, lon = math.atan2(s, c), math.atan2(so, co)
        out[i, 0], out[i, 1], out[i, 2] = lat, lon, h
        out[i, 3], out[i, 4], out[i, 5] = ned_from_e(s, c, so, co, raw[i, 4], raw[i, 5], raw[i, 6])
        a = -0.25 * math.pi - 0.5 * lat
        ca, sa = math.cos(a), math.sin(a)
        cl, sl = math.cos(0.5 * lon), math.sin(0.5 * lon)
        out[i, 6], out[i, 7], out[i, 8], out[i, 9] = quat_product(
            cl * ca, sl * sa, -cl * sa, -sl * ca, raw[i, 0], raw[i, 1], raw[i, 2], raw[i, 3]
        )
