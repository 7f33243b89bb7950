"""Fine alignment: a Kalman filter that levels and gyrocompasses on a base that stands still or sways in place.

States (15): phi, dv, position error in NED metres, accelerometer biases, gyro biases (b). The strapdown runs from the
coarse attitude; once a second its distance from the place is measured, with the sway as noise. Corrections are fed
back.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from schuler.ground.earth import WGS84, Ellipsoid
from schuler.ground.errors import InputError
from schuler.ground.frames import (
    dcm_from_quat,
    dcm_from_rotvec,
    euler_from_dcm,
    quat_from_dcm,
    quat_from_rotvec,
    quat_multiply,
    skew,
)
from schuler.ground.tables import Table
from schuler.inertial.alignment import (
    POOR,
    Alignment,
    SensorErrors,
    find_still,
    heading_floor,
    inertial_coarse,
    level_only,
    rpy_from_phi,
)
from schuler.inertial.imu_input import prepare
from schuler.inertial.strapdown import Start, Strapdown

Array = NDArray[np.float64]


def align(
    imu: Table,
    sensor: SensorErrors,
    *,
    lat: float | None,
    lon: float = 0.0,
    height: float = 0.0,
    start: float | None = None,
    to: float | None = None,
    heading: float | None = None,
    heading_std: float | None = None,
    sway_m: float = 0.005,
    earth: Ellipsoid = WGS84,
) -> Alignment:
    """Attitude at `to` from the imu rows in (start, to], by default the first still stretch.

    lat (rad) is needed to find north. sensor: the IMU's errors; they set the sigma and decide whether the gyros can
    find
    north at all: where the heading that their bias leaves is above 10 deg, roll and pitch are levelled and the heading
    is
    the one given (or unknown, with the sigma of a uniform angle). sway_m: how far the base moves about its place, 1
    sigma.
    """
    ready = prepare(imu)
    time, dt, dtheta, dv, notes = ready.time, ready.dt, ready.dtheta, ready.dv, list(ready.notes)
    if start is None or to is None:
        first, last = find_still(time, dtheta, dv, dt)
        start, to = (first if start is None else start), (last if to is None else to)
        notes.append(f"aligned on the stretch from {start:.2f} to {to:.2f} s")
    if to > time[-1] + 1e-9:
        notes.append(f"the recording ends at {time[-1]:.2f} s, before the {to:g} s asked for: aligned until there")
        to = float(time[-1])
    rows = (time > start + 1e-9) & (time <= to + 1e-9)
    if int(rows.sum()) < 10:
        raise InputError(f"between {start:g} and {to:g} s there are {int(rows.sum())} IMU rows: too few to align on")
    time, dt, dtheta, dv = time[rows], dt[rows], dtheta[rows], dv[rows]
    T = float(dt.sum())
    g = float(earth.gravity(lat if lat is not None else math.radians(45.0), height))
    size = float(np.linalg.norm(dv.sum(axis=0))) / T
    if not 0.9 * g < size < 1.1 * g:
        raise InputError(
            f"the mean specific force is {size:.3f} m/s^2 where {g:.3f} is expected: not a still stretch, or not m/s^2"
        )
    sensor = sensor.at_rest(dv.sum(axis=0) / T)
    floor = math.pi / math.sqrt(3.0)
    if lat is not None and math.cos(lat) > 1e-3:
        floor = min(floor, float(np.max(heading_floor(sensor.gyro_bias, lat, earth.omega))))
        noise = float(np.max(sensor.arw)) / (earth.omega * math.cos(lat) * math.sqrt(T))
    else:
        noise = math.inf
    if math.hypot(floor, noise) > POOR:
        return _levelled(time, dt, dtheta, dv, sensor, lat, heading, heading_std, floor, noise, g, start, to, notes)
    assert lat is not None
    C = inertial_coarse(dtheta, dv, dt, lat, earth=earth, height=height)
    return _filter(time, dt, dtheta, dv, C, sensor, lat, lon, height, sway_m, earth, floor, noise, start, to, notes)


def _levelled(
    time: Array, dt: Array, dtheta: Array, dv: Array, sensor: SensorErrors, lat: float | None, heading: float | None,
    heading_std: float | None, floor: float, noise: float, g: float, start: float, to: float, notes: list[str],
) -> Alignment:  # fmt: skip
    if lat is None:
        notes.append("no latitude was given, so north was not looked for; give [start] lat_deg")
    else:
        limit = math.degrees(min(math.hypot(floor, noise), math.pi / math.sqrt(3.0)))
        what = "its bias" if floor > noise else "its noise over so short a time"
        notes.append(
            f"the gyro is too poor to find north: {what} leaves a heading sigma of {limit:.0f} deg here; roll and "
            f"pitch "
            "are levelled, give [start] heading_deg or align in motion"
        )
    # Mean force of each second: its direction in b stays where it is if the base is still.
    second = np.floor(np.cumsum(dt) - 0.5 * dt).astype(int)
    f = np.stack([np.bincount(second, dv[:, i]) for i in range(3)], axis=1)
    mean = f.sum(axis=0)
    turned = np.linalg.norm(np.cross(f, mean), axis=1) / np.maximum(np.linalg.norm(f, axis=1), 1e-9)
    if math.sqrt(float(np.mean(turned**2))) > math.radians(2.0) * float(np.linalg.norm(mean)):
        raise InputError(
            f"between {start:g} and {to:g} s the IMU is not still: the direction of gravity turns by several degrees, "
            "and these gyros cannot follow it; type [align] from_s and to_s of a still stretch"
        )
    unknown = math.pi / math.sqrt(3.0)
    std = unknown if heading is None else (heading_std if heading_std is not None else math.radians(5.0))
    rpy, cov, bias = level_only(dtheta, dv, dt, sensor, heading or 0.0, std, g)
    from schuler.ground.frames import dcm_from_euler

    t = np.cumsum(dt)
    level = np.sqrt(np.max(sensor.accel_bias) ** 2 + np.max(sensor.vrw) ** 2 / t) / g
    best = float(np.max(sensor.accel_bias)) / g
    useful = None
    if best > 0.0:
        useful = float((np.max(sensor.vrw) / g) ** 2 / (0.21 * best**2))
    history = np.column_stack([level, level, np.full(t.size, std)])
    keep = slice(None, None, max(1, t.size // 500))
    return Alignment(
        "still", start, to, rpy, np.asarray(dcm_from_euler(*rpy)), cov, bias, None, floor, useful,
        time[keep], history[keep], notes,
    )  # fmt: skip


def _filter(
    time: Array, dt: Array, dtheta: Array, dv: Array, C: Array, sensor: SensorErrors, lat: float, lon: float,
    height: float, sway: float, earth: Ellipsoid, floor: float, noise: float, start: float, to: float, notes: list[str],
) -> Alignment:  # fmt: skip
    from schuler.kernels import alignment as kernel

    g = float(earth.gravity(lat, height))
    r_n, r_e = (float(r) + height for r in earth.radii(lat))
    w_ie = earth.earth_rate_n(lat)
    begin = Start(float(time[0] - dt[0]), lat, lon, height, np.zeros(3), quat_from_dcm(C))
    # The coarse attitude already holds the biases' effect, so its prior must say nothing: loose by a factor of ten.
    tilt = 10.0 * float(np.max(sensor.accel_bias)) / g + 1e-3
    # Coarse heading: bias and noise of the gyros, and the sway's share in the turn of gravity between the two halves.
    half = 0.5 * float(dt.sum())
    turned = earth.omega * math.cos(lat) * half
    coarse = 10.0 * (math.hypot(floor, noise) + sway / (g * half * turned) + math.tan(abs(lat)) * tilt / 10.0) + 1e-2
    P = np.diag(
        np.concatenate([[tilt**2, tilt**2, coarse**2], [0.05**2] * 3, [sway**2 + 1e-4] * 3,
                        sensor.accel_bias**2, sensor.gyro_bias**2])
    )  # fmt: skip
    b_a, b_g = np.zeros(3), np.zeros(3)
    R = sway**2 + 1e-8
    edges = np.searchsorted(np.cumsum(dt), np.arange(1.0, float(dt.sum()) + 1e-6, 1.0) - 1e-6) + 1
    edges = np.unique(np.clip(edges, 1, len(dt)))
    if edges.size == 0 or edges[-1] != len(dt):
        edges = np.append(edges, len(dt))
    H = np.hstack([np.zeros((3, 6)), np.eye(3), np.zeros((3, 6))])
    eye = np.eye(15)
    times, stds = [], []
    state, q, v = begin, begin.q_nb, np.zeros(3)
    a = 0
    ins = Strapdown(begin, earth=earth, coning="two")
    # F is taken at the coarse attitude carried by the gyros, never at the estimate: what tilt and bias do together is
    # unobservable, and an attitude that wanders with the corrections would seem to tell them apart.
    f = np.array([0.0, 0.0, -g])
    carry = np.array([1.0, 0.0, 0.0, 0.0])
    C0 = C
    for b in edges:
        n = b - a
        if n <= 0:
            continue
        block = float(dt[a:b].sum())
        rows = ins.feed(dtheta[a:b] - b_g * dt[a:b, None], dv[a:b] - b_a * dt[a:b, None], dt[a:b], every=int(n))
        q = rows.q_nb[-1]
        kernel.turn(dtheta[a:b], carry)
        back = dcm_from_rotvec(-w_ie * float(rows.time[-1] - begin.time))
        C1 = back @ C @ dcm_from_quat(carry)
        Cm, C0 = 0.5 * (C0 + C1), C1
        F = np.zeros((15, 15))
        F[0:3, 0:3] = -skew(w_ie)
        F[0, 4], F[1, 3], F[2, 4] = 1.0 / r_e, -1.0 / r_n, -math.tan(lat) / r_e
        F[0, 6], F[2, 6] = -earth.omega * math.sin(lat) / r_n, -earth.omega * math.cos(lat) / r_n
        F[3:6, 0:3] = skew(f)
        F[3:6, 3:6] = -skew(2.0 * w_ie)
        F[3:6, 9:12] = Cm
        F[0:3, 12:15] = -Cm
        F[6:9, 3:6] = np.eye(3)
        F[5, 8] = 2.0 * g / r_n
        A = F * block
        Phi = eye + A + 0.5 * (A @ A) + (A @ A @ A) / 6.0
        Qc = np.concatenate([sensor.arw**2, sensor.vrw**2, np.zeros(6), sensor.gyro_walk**2])
        Qd = 0.5 * block * (Phi @ np.diag(Qc) @ Phi.T + np.diag(Qc))
        P = Phi @ P @ Phi.T + Qd
        z = earth.displacement_n(rows.lat[-1], rows.lon[-1], rows.height[-1], lat, lon, height)
        S = P[6:9, 6:9] + R * np.eye(3)
        K = np.linalg.solve(S, P[6:9]).T
        x = K @ z
        IKH = eye - K @ H
        P = IKH @ P @ IKH.T + R * (K @ K.T)
        P = 0.5 * (P + P.T)
        q = quat_multiply(quat_from_rotvec(x[0:3]), q)
        v = rows.v_n[-1] - x[3:6]
        p_lat, p_lon, p_h = earth.displace(rows.lat[-1], rows.lon[-1], rows.height[-1], -x[6:9])
        b_a, b_g = b_a + x[9:12], b_g + x[12:15]
        state = Start(float(rows.time[-1]), float(p_lat), float(p_lon), float(p_h), v, q)
        ins.restart(state)
        E = rpy_from_phi(np.array(euler_from_dcm(dcm_from_quat(q)), dtype=np.float64))
        times.append(float(time[b - 1]))
        stds.append(np.sqrt(np.diag(E @ P[0:3, 0:3] @ E.T)))
        a = b
    C_nb = dcm_from_quat(q)
    rpy = np.array(euler_from_dcm(C_nb), dtype=np.float64)
    E = rpy_from_phi(rpy)
    cov = E @ P[0:3, 0:3] @ E.T
    std = np.array(stds)
    t = np.array(times)
    # The east accelerometer's bias tilts about north, and the Earth's rate seen there turns that into heading.
    best = max(math.hypot(floor, math.tan(lat) * float(np.max(sensor.accel_bias)) / g), 1e-12)
    near = std[:, 2] <= 1.1 * best
    useful = float(t[int(np.argmax(near))] - start) if near.any() else None
    if useful is None:
        # The white noise goes on averaging out as t^(-3/2) at first, t^(-1/2) later; the slower law is the safe guess.
        notes.append(
            f"heading sigma is {math.degrees(std[-1, 2]):.4f} deg and still falling towards the "
            f"{math.degrees(best):.4f} deg that the sensors' biases leave: a longer alignment helps"
        )
    return Alignment("still", start, to, rpy, C_nb, cov, b_g, b_a, floor, useful, t, std, notes)
