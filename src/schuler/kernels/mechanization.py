"""Strapdown mechanization: attitude quaternion, velocity over ground, position by its own quaternion; one loop.

Frames: b body FRD; w level wander frame (z down, its transport rate about the vertical is zero, so nothing is singular
at a pole or at 180 deg); e Earth-fixed. SI and radians.

One step takes the exact integrals of body rate and specific force over the interval, dtheta (rad) and dv (m/s).
The pair (rate, force) = A(s) = A0 + A1 s + A2 s^2 about the middle of an interval of length h acts as a twist on
(attitude, velocity), with the bracket [(w, f), (x, g)] = (w x x, w x g + f x x). With D = (dtheta, dv), B = 12/h times
the first moment of A about the middle (A1 h^2 to begin with) and E = A2 h^3 the Magnus series gives the twist of the
whole interval,

    (phi, u) = D + [D, B]/12 + [B, E/360 - [D, B]/240] + [D, [D, E/360 - [D, B]/720]] + O(h^7)
    q <- q exp(phi),  v <- v + C (I + (1 - cos)/phi^2 [phi x] + (phi - sin)/phi^3 [phi x]^2) u + ...

whose first bracket is coning (phi) and sculling (u). B and E come from this and earlier increments. The velocity
between the ends, for position, Coriolis and transport rate, is taken to the same order (scrolling).
Savage, Strapdown Analytics (2000), chapter 7; Blanes, Casas, Oteo and Ros (2009), The Magnus expansion, section 5.
Every sum that runs for hours is compensated (Kahan): the free-running floor is the algorithm's, not the adder's.
"""

from __future__ import annotations

import math

from numba import njit

# Corrections for motion inside the interval.
NONE = 0  # neither coning nor sculling
ONE = 1  # this and the previous increment: dt^4 for pure coning, dt^3 in large turns
TWO = 2  # this and the two previous increments: dt^4 in any motion
THREE = 3  # this and the three previous ones, all brackets: above dt^4 (uneven intervals fall back to TWO)
PAIR = 4  # two increments at a time, no memory: dt^4; half as many epochs

# Vertical channel.
FREE = 0
HELD = 1  # height and down velocity are given
AIDED = 2  # third-order loop on a measured height

# State of the loop: [quaternion w<-b, its carry, velocity w, quaternion e<-w, its carry, height, its carry,
# last three (dtheta, dv), last three dt, samples seen, vertical loop's acceleration]
STATE = 44
MEMORY = 21  # from here on: the increments, what a change of position or attitude leaves alone

# Earth: [semi-major axis, e^2, rotation rate, equator gravity, Somigliana k, f, m, 1 if sphere]
EARTH = 8
# Raw row: quaternion w<-b, velocity w, quaternion e<-w, height.  NED row: lat, lon, height, v_n (3), q_nb (4).
RAW = 12
NED = 10
R19_60, R240, R720 = 19.0 / 60.0, 1.0 / 240.0, 1.0 / 720.0


@njit(cache=True, error_model="numpy")
def gravity(earth, s2, h):
    """Plumb-bob gravity, m/s^2, down: Somigliana with the height terms of the ellipsoid, or g0 (a/(a+h))^2."""
    if earth[7] != 0.0:
        x = earth[0] / (earth[0] + h)
        return earth[3] * x * x
    x = h / earth[0]
    g0 = earth[3] * (1.0 + earth[4] * s2) / math.sqrt(1.0 - earth[1] * s2)
    return g0 * (1.0 - 2.0 * (1.0 + earth[5] + earth[6] - 2.0 * earth[5] * s2) * x + 3.0 * x * x)


@njit(cache=True, error_model="numpy")
def begin(state, earth, lat, lon, h, vn, ve, vd, q0, q1, q2, q3):
    """Fills the state: wander frame equal to NED at the start. q is the unit quaternion n<-b, scalar first."""
    state[:] = 0.0
    state[0], state[1], state[2], state[3] = q0, q1, q2, q3
    state[8], state[9], state[10] = vn, ve, vd
    a = -0.25 * math.pi - 0.5 * lat
    ca, sa = math.cos(a), math.sin(a)
    cl, sl = math.cos(0.5 * lon), math.sin(0.5 * lon)
    state[11], state[12], state[13], state[14] = cl * ca, -sl * sa, cl * sa, sl * ca
    state[19] = h


@njit(cache=True, error_model="numpy")
def run(state, earth, dtheta, dv, dt, scheme, vertical, height, v_down, gains, every, raw):
    """Carries the state over n intervals; raw (n // every, 12) gets every `every`-th epoch after the start.

    dtheta (n, 3) rad, dv (n, 3) m/s over intervals dt (n,) or (1,) s. height, v_down: (n,) or (1,), at the ends of the
    intervals, used by HELD (both) and AIDED (height, gains k1, k2, k3). The samples seen are counted in the state, so
    that feeding samples one by one gives the same bits as one call. PAIR takes an even n and counts epochs in pairs.
    """
    n = dtheta.shape[0]
    pair = scheme == PAIR
    if pair:
        n //= 2
    a, e2, omega, ge, gk, gf, gm, sphere = (
        earth[0], earth[1], earth[2], earth[3], earth[4], earth[5], earth[6], earth[7] != 0.0
    )  # fmt: skip
    inv_a = 1.0 / a
    q0, q1, q2, q3 = state[0], state[1], state[2], state[3]
    k0, k1, k2, k3 = state[4], state[5], state[6], state[7]
    v1, v2, v3 = state[8], state[9], state[10]
    p0, p1, p2, p3 = state[11], state[12], state[13], state[14]
    c0, c1, c2, c3 = state[15], state[16], state[17], state[18]
    h, hc = state[19], state[20]
    t11, t12, t13 = state[21], state[22], state[23]
    u11, u12, u13 = state[24], state[25], state[26]
    t21, t22, t23 = state[27], state[28], state[29]
    u21, u22, u23 = state[30], state[31], state[32]
    t31, t32, t33 = state[33], state[34], state[35]
    u31, u32, u33 = state[36], state[37], state[38]
    d1, d2, d3 = state[39], state[40], state[41]
    seen = int(state[42])
    loop = state[43]
    r12 = 1.0 / 12.0
    uniform = dt.size == 1
    one_h = height.size == 1
    one_v = v_down.size == 1
    step = dt[0]
    m1 = 0.0
    m2 = 0.0
    m0 = 0.0
    last_step = -1.0
    last_d1 = -1.0
    last_d2 = -1.0
    row = 0
    for k in range(n):
        i = 2 * k + 1 if pair else k
        if not uniform:
            step = dt[i]
        t1, t2, t3 = dtheta[i, 0], dtheta[i, 1], dtheta[i, 2]
        f1, f2, f3 = dv[i, 0], dv[i, 1], dv[i, 2]
        if pair:
            # sums, and the slope put where the earlier increments' part is: m1 = -1 of (t11, u11)
            x = dt[0] if uniform else dt[i - 1]
            step = (dt[0] if uniform else dt[i]) + x
            y = 2.0 * step / x
            z = 2.0 * step / (step - x)
            t11 = y * dtheta[i - 1, 0] - z * t1
            t12 = y * dtheta[i - 1, 1] - z * t2
            t13 = y * dtheta[i - 1, 2] - z * t3
            u11 = y * dv[i - 1, 0] - z * f1
            u12 = y * dv[i - 1, 1] - z * f2
            u13 = y * dv[i - 1, 2] - z * f3
            t1 += dtheta[i - 1, 0]
            t2 += dtheta[i - 1, 1]
            t3 += dtheta[i - 1, 2]
            f1 += dv[i - 1, 0]
            f2 += dv[i - 1, 1]
            f3 += dv[i - 1, 2]
        # B: slope of rate and force at the middle, times step^2, from the mean values of this and earlier intervals.
        full = False
        bracket = r12
        if pair:
            m0 = m2 = 0.0
            m1 = -1.0
        elif seen == 0 or scheme == NONE:
            m0 = m1 = m2 = 0.0
            last_step = -1.0
        elif scheme == ONE or seen == 1:
            m0 = 2.0 * step / (step + d1)
            m1 = -m0 * step / d1
            m2 = 0.0
            last_step = -1.0
            if seen == 1:
                bracket = 2.0 * r12  # the second interval makes up for the first, whose slope nobody knew
        else:
            if step != last_step or d1 != last_d1 or d2 != last_d2:
                x01 = 0.5 * (step + d1)
                x12 = 0.5 * (d1 + d2)
                b = x01 / (x01 + x12)
                # slope = s01 + b (s01 - s12), s the divided differences of the mean rates
                m0 = step * (1.0 + b) / x01
                m1 = -step * step / d1 * ((1.0 + b) / x01 + b / x12)
                m2 = step * step / d2 * b / x12
                last_step, last_d1, last_d2 = step, d1, d2
            if scheme == THREE and seen > 2:
                x = 1e-6 * step
                full = abs(step - d1) < x and abs(step - d2) < x and abs(step - d3) < x
        w1 = m0 * t1 + m1 * t11 + m2 * t21
        w2 = m0 * t2 + m1 * t12 + m2 * t22
        w3 = m0 * t3 + m1 * t13 + m2 * t23
        s1 = m0 * f1 + m1 * u11 + m2 * u21
        s2 = m0 * f2 + m1 * u12 + m2 * u22
        s3 = m0 * f3 + m1 * u13 + m2 * u23
        if full:
            # third difference into B, and E from it and the second
            x1 = t1 - t31 + 3.0 * (t21 - t11)
            x2 = t2 - t32 + 3.0 * (t22 - t12)
            x3 = t3 - t33 + 3.0 * (t23 - t13)
            y1 = f1 - u31 + 3.0 * (u21 - u11)
            y2 = f2 - u32 + 3.0 * (u22 - u12)
            y3 = f3 - u33 + 3.0 * (u23 - u13)
            w1 += R19_60 * x1
            w2 += R19_60 * x2
            w3 += R19_60 * x3
            s1 += R19_60 * y1
            s2 += R19_60 * y2
            s3 += R19_60 * y3
            x1 = R720 * (x1 + t1 - 2.0 * t11 + t21)
            x2 = R720 * (x2 + t2 - 2.0 * t12 + t22)
            x3 = R720 * (x3 + t3 - 2.0 * t13 + t23)
            y1 = R720 * (y1 + f1 - 2.0 * u11 + u21)
            y2 = R720 * (y2 + f2 - 2.0 * u12 + u22)
            y3 = R720 * (y3 + f3 - 2.0 * u13 + u23)
            t31, t32, t33 = t21, t22, t23
            u31, u32, u33 = u21, u22, u23
        elif seen > 1:
            t31, t32, t33 = t21, t22, t23
            u31, u32, u33 = u21, u22, u23
        t21, t22, t23 = t11, t12, t13
        u21, u22, u23 = u11, u12, u13
        t11, t12, t13 = t1, t2, t3
        u11, u12, u13 = f1, f2, f3
        d3 = d2
        d2 = d1
        d1 = step
        seen += 1
        # coning and sculling: [D, B]
        o1 = t2 * w3 - t3 * w2
        o2 = t3 * w1 - t1 * w3
        o3 = t1 * w2 - t2 * w1
        g1 = t2 * s3 - t3 * s2 + f2 * w3 - f3 * w2
        g2 = t3 * s1 - t1 * s3 + f3 * w1 - f1 * w3
        g3 = t1 * s2 - t2 * s1 + f1 * w2 - f2 * w1
        if full:
            # E/360 is in x, y: first [B, E/360 - [D, B]/240]
            z1, z2, z3 = x1 - R240 * o1, x2 - R240 * o2, x3 - R240 * o3
            l1, l2, l3 = y1 - R240 * g1, y2 - R240 * g2, y3 - R240 * g3
            a1 = w2 * z3 - w3 * z2
            a2 = w3 * z1 - w1 * z3
            a3 = w1 * z2 - w2 * z1
            b1 = w2 * l3 - w3 * l2 + s2 * z3 - s3 * z2
            b2 = w3 * l1 - w1 * l3 + s3 * z1 - s1 * z3
            b3 = w1 * l2 - w2 * l1 + s1 * z2 - s2 * z1
            # then [D, [D, E/360 - [D, B]/720]]
            z1, z2, z3 = x1 - R720 * o1, x2 - R720 * o2, x3 - R720 * o3
            l1, l2, l3 = y1 - R720 * g1, y2 - R720 * g2, y3 - R720 * g3
            x1 = t2 * z3 - t3 * z2
            x2 = t3 * z1 - t1 * z3
            x3 = t1 * z2 - t2 * z1
            y1 = t2 * l3 - t3 * l2 + f2 * z3 - f3 * z2
            y2 = t3 * l1 - t1 * l3 + f3 * z1 - f1 * z3
            y3 = t1 * l2 - t2 * l1 + f1 * z2 - f2 * z1
            o1 = t1 + r12 * o1 + (a1 + (t2 * x3 - t3 * x2))
            o2 = t2 + r12 * o2 + (a2 + (t3 * x1 - t1 * x3))
            o3 = t3 + r12 * o3 + (a3 + (t1 * x2 - t2 * x1))
            g1 = f1 + r12 * g1 + (b1 + (t2 * y3 - t3 * y2 + f2 * x3 - f3 * x2))
            g2 = f2 + r12 * g2 + (b2 + (t3 * y1 - t1 * y3 + f3 * x1 - f1 * x3))
            g3 = f3 + r12 * g3 + (b3 + (t1 * y2 - t2 * y1 + f1 * x2 - f2 * x1))
        else:
            o1 = t1 + bracket * o1
            o2 = t2 + bracket * o2
            o3 = t3 + bracket * o3
            g1 = f1 + bracket * g1
            g2 = f2 + bracket * g2
            g3 = f3 + bracket * g3
        # rotation by phi: half-angle sine, cosine less one, and the two integrals of the velocity
        x = o1 * o1 + o2 * o2 + o3 * o3
        if x < 0.01:
            hs = 0.5 - x * (1.0 / 48.0 - x * (1.0 / 3840.0 - x * (1.0 / 645120.0 - x / 185794560.0)))
            hc1 = -x * (0.125 - x * (1.0 / 384.0 - x * (1.0 / 46080.0 - x / 10321920.0)))
            ja = 0.5 - x * (1.0 / 24.0 - x * (1.0 / 720.0 - x * (1.0 / 40320.0 - x / 3628800.0)))
            jb = 1.0 / 6.0 - x * (1.0 / 120.0 - x * (1.0 / 5040.0 - x / 362880.0))
            jc = 1.0 / 24.0 - x * (1.0 / 720.0 - x * (1.0 / 40320.0 - x / 3628800.0))
        else:
            ang = math.sqrt(x)
            sh = math.sin(0.5 * ang)
            hs = sh / ang
            hc1 = math.cos(0.5 * ang) - 1.0
            ja = 2.0 * sh * sh / x
            jb = (ang - math.sin(ang)) / (x * ang)
            jc = (0.5 - ja) / x
        # phi x u, phi x (phi x u)
        y1 = o2 * g3 - o3 * g2
        y2 = o3 * g1 - o1 * g3
        y3 = o1 * g2 - o2 * g1
        z1 = o2 * y3 - o3 * y2
        z2 = o3 * y1 - o1 * y3
        z3 = o1 * y2 - o2 * y1
        a1 = g1 + ja * y1 + jb * z1
        a2 = g2 + ja * y2 + jb * z2
        a3 = g3 + ja * y3 + jb * z3
        # mean over the interval of the velocity gained: constant twist less the moment of the slope, at the middle
        b1 = 0.5 * g1 + jb * y1 + jc * z1 - r12 * (s1 + 0.5 * (o2 * s3 - o3 * s2))
        b2 = 0.5 * g2 + jb * y2 + jc * z2 - r12 * (s2 + 0.5 * (o3 * s1 - o1 * s3))
        b3 = 0.5 * g3 + jb * y3 + jc * z3 - r12 * (s3 + 0.5 * (o1 * s2 - o2 * s1))
        # both into w, by C(q) at the start
        e11 = q0 * q0 + q1 * q1 - q2 * q2 - q3 * q3
        e22 = q0 * q0 - q1 * q1 + q2 * q2 - q3 * q3
        e33 = q0 * q0 - q1 * q1 - q2 * q2 + q3 * q3
        e12 = 2.0 * (q1 * q2 - q0 * q3)
        e13 = 2.0 * (q1 * q3 + q0 * q2)
        e21 = 2.0 * (q1 * q2 + q0 * q3)
        e23 = 2.0 * (q2 * q3 - q0 * q1)
        e31 = 2.0 * (q1 * q3 - q0 * q2)
        e32 = 2.0 * (q2 * q3 + q0 * q1)
        x1 = e11 * a1 + e12 * a2 + e13 * a3
        x2 = e21 * a1 + e22 * a2 + e23 * a3
        x3 = e31 * a1 + e32 * a2 + e33 * a3
        l1 = e11 * b1 + e12 * b2 + e13 * b3
        l2 = e21 * b1 + e22 * b2 + e23 * b3
        l3 = e31 * b1 + e32 * b2 + e33 * b3
        # Earth's axis in w at the middle; a crude transport rate is enough to get there
        half = 0.5 * step
        n1 = 2.0 * (p1 * p3 - p0 * p2)
        n2 = 2.0 * (p2 * p3 + p0 * p1)
        n3 = p0 * p0 - p1 * p1 - p2 * p2 + p3 * p3
        j1 = half * inv_a * v2
        j2 = -half * inv_a * v1
        x = n3 - (j1 * n2 - j2 * n1)
        hm = h - half * v3
        ss = x * x
        # radii and gravity there
        ww = 1.0 - e2 * ss
        w = math.sqrt(ww)
        re = a / w + hm
        rn = a * (1.0 - e2) / (w * ww) + hm
        ke = 1.0 / re
        kd = a * e2 / (w * ww * rn) * ke
        if sphere:
            gr = a * ke
            gr = ge * gr * gr
        else:
            gx = hm * inv_a
            gr = ge * (1.0 + gk * ss) / w * (1.0 - 2.0 * (1.0 + gf + gm - 2.0 * gf * ss) * gx + 3.0 * gx * gx)
        gr += loop
        # the axis again, with the transport rate of the start
        nv = kd * (n1 * v1 + n2 * v2)
        r1 = ke * v2 + nv * n2
        r2 = -ke * v1 - nv * n1
        j1 = half * r1
        j2 = half * r2
        n1, n2, n3 = n1 - j2 * n3, n2 + j1 * n3, n3 - (j1 * n2 - j2 * n1)
        i1, i2, i3 = omega * n1, omega * n2, omega * n3
        # mean velocity: gravity and Coriolis of the start carry it to the middle
        y1 = 2.0 * i1 + r1
        y2 = 2.0 * i2 + r2
        y3 = 2.0 * i3
        b1 = v1 + l1 - half * (y2 * v3 - y3 * v2)
        b2 = v2 + l2 - half * (y3 * v1 - y1 * v3)
        b3 = v3 + l3 + half * (gr - (y1 * v2 - y2 * v1))
        if vertical == HELD:
            hn = height[0] if one_h else height[i]
            b3 = (h - hn) / step
        # transport rate of the mean velocity
        nv = kd * (n1 * b1 + n2 * b2)
        r1 = ke * b2 + nv * n2
        r2 = -ke * b1 - nv * n1
        y1 = 2.0 * i1 + r1
        y2 = 2.0 * i2 + r2
        # rotation of w against i, in the interval
        j1 = step * (i1 + r1)
        j2 = step * (i2 + r2)
        j3 = step * i3
        l1 = x1 - l1
        l2 = x2 - l2
        l3 = x3 - l3
        v1 += x1 - (j2 * l3 - j3 * l2) - step * (y2 * b3 - y3 * b2)
        v2 += x2 - (j3 * l1 - j1 * l3) - step * (y3 * b1 - y1 * b3)
        v3 += x3 - (j1 * l2 - j2 * l1) + step * (gr - (y1 * b2 - y2 * b1))
        if vertical == HELD:
            hc = 0.0
            h = height[0] if one_h else height[i]
            v3 = v_down[0] if one_v else v_down[i]
        else:
            x = -step * b3 - hc
            y = h + x
            hc = (y - h) - x
            h = y
            if vertical == AIDED:
                x = h - (height[0] if one_h else height[i])
                h -= gains[0] * x * step
                v3 += gains[1] * x * step
                loop += gains[2] * x * step
        # attitude: q <- exp(-zeta) q exp(phi), as an increment
        x1 = hs * o1
        x2 = hs * o2
        x3 = hs * o3
        y0 = hc1 * q0 - x1 * q1 - x2 * q2 - x3 * q3
        y1 = hc1 * q1 + x1 * q0 + x3 * q2 - x2 * q3
        y2 = hc1 * q2 + x2 * q0 + x1 * q3 - x3 * q1
        y3 = hc1 * q3 + x3 * q0 + x2 * q1 - x1 * q2
        z0 = q0 + y0
        z1 = q1 + y1
        z2 = q2 + y2
        z3 = q3 + y3
        x = j1 * j1 + j2 * j2 + j3 * j3
        hs = -0.5 + x * (1.0 / 48.0 - x / 3840.0)
        hc1 = -x * (0.125 - x / 384.0)
        x1 = hs * j1
        x2 = hs * j2
        x3 = hs * j3
        x = 0.5 * (1.0 - (q0 * q0 + q1 * q1 + q2 * q2 + q3 * q3))
        hc1 += x
        y0 += hc1 * z0 - x1 * z1 - x2 * z2 - x3 * z3 - k0
        y1 += hc1 * z1 + x1 * z0 + x2 * z3 - x3 * z2 - k1
        y2 += hc1 * z2 + x2 * z0 + x3 * z1 - x1 * z3 - k2
        y3 += hc1 * z3 + x3 * z0 + x1 * z2 - x2 * z1 - k3
        z0 = q0 + y0
        z1 = q1 + y1
        z2 = q2 + y2
        z3 = q3 + y3
        k0 = (z0 - q0) - y0
        k1 = (z1 - q1) - y1
        k2 = (z2 - q2) - y2
        k3 = (z3 - q3) - y3
        q0, q1, q2, q3 = z0, z1, z2, z3
        # position: p <- p exp(step w_ew)
        x1 = 0.5 * step * r1
        x2 = 0.5 * step * r2
        x = x1 * x1 + x2 * x2
        hc1 = -0.5 * x * (1.0 - x / 12.0)
        hs = 1.0 - x * (1.0 / 6.0)
        x1 *= hs
        x2 *= hs
        hc1 += 0.5 * (1.0 - (p0 * p0 + p1 * p1 + p2 * p2 + p3 * p3))
        y0 = hc1 * p0 - x1 * p1 - x2 * p2 - c0
        y1 = hc1 * p1 + x1 * p0 - x2 * p3 - c1
        y2 = hc1 * p2 + x2 * p0 + x1 * p3 - c2
        y3 = hc1 * p3 + x2 * p1 - x1 * p2 - c3
        z0 = p0 + y0
        z1 = p1 + y1
        z2 = p2 + y2
        z3 = p3 + y3
        c0 = (z0 - p0) - y0
        c1 = (z1 - p1) - y1
        c2 = (z2 - p2) - y2
        c3 = (z3 - p3) - y3
        p0, p1, p2, p3 = z0, z1, z2, z3
        if (k + 1) % every == 0 and row < raw.shape[0]:
            raw[row, 0], raw[row, 1], raw[row, 2], raw[row, 3] = q0, q1, q2, q3
            raw[row, 4], raw[row, 5], raw[row, 6] = v1, v2, v3
            raw[row, 7], raw[row, 8], raw[row, 9], raw[row, 10] = p0, p1, p2, p3
            raw[row, 11] = h
            row += 1
    state[0], state[1], state[2], state[3] = q0, q1, q2, q3
    state[4], state[5], state[6], state[7] = k0, k1, k2, k3
    state[8], state[9], state[10] = v1, v2, v3
    state[11], state[12], state[13], state[14] = p0, p1, p2, p3
    state[15], state[16], state[17], state[18] = c0, c1, c2, c3
    state[19], state[20] = h, hc
    state[21], state[22], state[23] = t11, t12, t13
    state[24], state[25], state[26] = u11, u12, u13
    state[27], state[28], state[29] = t21, t22, t23
    state[30], state[31], state[32] = u21, u22, u23
    state[33], state[34], state[35] = t31, t32, t33
    state[36], state[37], state[38] = u31, u32, u33
    state[39], state[40], state[41] = d1, d2, d3
    state[42] = seen
    state[43] = loop


@njit(cache=True, error_model="numpy")
def to_ned(raw, out):
    """Rows of `run` (m, 12) into lat, lon, height, v_n (3), q_nb (4). At a pole north is the wander frame's x axis."""
    for i in range(raw.shape[0]):
        p0, p1, p2, p3 = raw[i, 7], raw[i, 8], raw[i, 9], raw[i, 10]
        n1 = 2.0 * (p1 * p3 - p0 * p2)
        n2 = 2.0 * (p2 * p3 + p0 * p1)
        n3 = p0 * p0 - p1 * p1 - p2 * p2 + p3 * p3
        c = math.sqrt(n1 * n1 + n2 * n2)
        out[i, 0] = math.atan2(-n3, c)
        out[i, 1] = math.atan2(-2.0 * (p2 * p3 - p0 * p1), -2.0 * (p1 * p3 + p0 * p2))
        out[i, 2] = raw[i, 11]
        if c > 1e-300:
            n1 /= c
            n2 /= c
        else:
            n1, n2 = 1.0, 0.0
        v1, v2 = raw[i, 4], raw[i, 5]
        out[i, 3] = n1 * v1 + n2 * v2
        out[i, 4] = n1 * v2 - n2 * v1
        out[i, 5] = raw[i, 6]
        # q_nw turns by minus the angle (n1, n2) about down
        if n1 >= 0.0:
            ch = math.sqrt(0.5 * (1.0 + n1))
            sh = 0.5 * n2 / ch
        else:
            sh = math.sqrt(0.5 * (1.0 - n1))
            ch = 0.5 * n2 / sh
            if ch < 0.0:
                ch, sh = -ch, -sh
        q0, q1, q2, q3 = raw[i, 0], raw[i, 1], raw[i, 2], raw[i, 3]
        out[i, 6] = ch * q0 + sh * q3
        out[i, 7] = ch * q1 + sh * q2
        out[i, 8] = ch * q2 - sh * q1
        out[i, 9] = ch * q3 - sh * q0
