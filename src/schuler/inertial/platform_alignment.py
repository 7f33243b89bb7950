"""Alignment of a stable platform at rest: loop design, closed-loop response, end values, the switch to navigation.

Channels 1 and 2 level the platform with a PI law on the accelerometers, channel 3 holds the azimuth gimbal at its
angle. Units: rad, s, m/s^2. Frames and signs: `schuler.inertial.platform`. Source: Ghesmati et al., figures 3 and 4 and
equations (20)-(27), Table 1, corrected.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from schuler.ground.earth import OMEGA
from schuler.ground.errors import InputError
from schuler.inertial.platform import GRAVITY, RADIUS, PlatformCase, platform_angles, truth_of

Array = NDArray[np.float64]
SETTLING_BAND = 0.05  # of the step: where "settled" begins


@dataclass(frozen=True)
class Loop:
    """A PI loop on a double integration: s^2 + plant kp s + plant ki, with an optional first-order lag of its signal.

    kp, ki : gains (rad/s per signal, rad/s^2 per signal). plant : signal per rad (g_i for levelling, 1 for azimuth).
    lag : s.
    """

    name: str
    kp: float
    ki: float
    plant: float = 1.0
    lag: float = 0.0

    @property
    def natural(self) -> float:
        """Undamped natural frequency, rad/s (without the lag)."""
        return math.sqrt(abs(self.ki * self.plant))

    @property
    def damping(self) -> float:
        """Damping ratio (without the lag)."""
        return 0.5 * self.kp * self.plant / self.natural if self.natural > 0.0 else math.inf

    @property
    def poles(self) -> NDArray[np.complex128]:
        """Closed-loop poles, 1/s, the fastest to grow first."""
        denominator = [1.0, self.kp * self.plant, self.ki * self.plant]
        if self.lag > 0.0:
            denominator = [self.lag, *denominator]
        poles = np.roots(denominator).astype(np.complex128)
        return poles[np.argsort(-poles.real, kind="stable")]

    def check(self) -> None:
        """InputError with the pole that grows, where the loop is not stable."""
        pole = self.poles[0]
        if pole.real < -1e-12:
            return
        where = f"{pole.real:.4g}" + (f" +- {abs(pole.imag):.4g} j" if abs(pole.imag) > 0.0 else "")
        cause = (
            f"its damping ratio is {self.damping:.3g}; it must be positive"
            if self.kp * self.plant <= 0.0 or self.ki * self.plant <= 0.0
            else f"the lag of {self.lag:g} s must stay below {self.kp / self.ki:.3g} s (2 damping / natural frequency)"
        )
        raise InputError(f"The {self.name} loop is unstable: its pole at {where} 1/s does not decay; {cause}.")

    def open_loop(self, w: ArrayLike) -> NDArray[np.complex128]:
        """Open-loop frequency response at w, rad/s."""
        s = 1j * np.asarray(w, dtype=float)
        return self.plant * (self.kp * s + self.ki) / (s * s * (1.0 + self.lag * s))

    @property
    def crossover(self) -> float:
        """Gain crossover, rad/s."""
        a, b = (self.kp * self.plant) ** 2, (self.ki * self.plant) ** 2
        # |L|^2 = 1: (a w^2 + b) = w^4 (1 + lag^2 w^2), a cubic in w^2
        roots = np.roots([self.lag**2, 1.0, -a, -b] if self.lag > 0.0 else [1.0, -a, -b])
        real = roots[np.abs(roots.imag) < 1e-9 * np.abs(roots)].real
        return math.sqrt(float(real[real > 0.0].max()))

    @property
    def phase_margin(self) -> float:
        """rad."""
        w = self.crossover
        return math.atan2(self.kp * w, self.ki) - math.atan(self.lag * w)

    @property
    def gain_margin_db(self) -> float:
        """How much gain may be won or lost before the loop grows: no limit, if it is stable at all.

        The phase stays on one side of -pi at every frequency, with a lag or without.
        """
        return math.inf if self.lag < self.kp / self.ki else -math.inf

    def step_response(self, t: ArrayLike) -> Array:
        """Angle after a unit step of what it follows, at times t, s, from rest."""
        numerator = np.array([self.kp * self.plant, self.ki * self.plant])
        denominator = [1.0, self.kp * self.plant, self.ki * self.plant]
        if self.lag > 0.0:
            denominator = [self.lag, *denominator]
        return _inverse(numerator, np.array([*denominator, 0.0]), np.asarray(t, dtype=float))

    def remaining(self, t: ArrayLike) -> Array:
        """Angle left over of a unit angle at the start, at times t, s."""
        time = np.asarray(t, dtype=float)
        return 1.0 - self.step_response(time)

    def response(self) -> Response:
        """Overshoot, settling and margins."""
        self.check()
        slowest = abs(self.poles[0].real)
        t = np.linspace(0.0, 20.0 / slowest, 8001)
        y = self.step_response(t)
        outside = np.flatnonzero(np.abs(y - 1.0) > SETTLING_BAND)
        settled = float(t[min(outside[-1] + 1, len(t) - 1)]) if len(outside) else 0.0
        return Response(
            overshoot_percent=100.0 * max(0.0, float(y.max()) - 1.0),
            settling_s=settled,
            phase_margin_deg=math.degrees(self.phase_margin),
            gain_margin_db=self.gain_margin_db,
        )


@dataclass(frozen=True)
class Response:
    """Of the response to a step of what the loop follows. settling_s : into 5 % of the step, for good."""

    overshoot_percent: float
    settling_s: float
    phase_margin_deg: float
    gain_margin_db: float


def _inverse(numerator: Array, denominator: Array, t: Array) -> Array:
    """Inverse Laplace transform of numerator/denominator by its poles; the poles made simple where they coincide."""
    poles = np.roots(denominator)
    for i in range(len(poles)):
        for j in range(i):
            if abs(poles[i] - poles[j]) < 1e-7 * (abs(poles[i]) + 1e-12):
                poles[i] *= 1.0 + 1e-6
    slope = np.array([np.prod(p - np.delete(poles, i)) for i, p in enumerate(poles)]) * denominator[0]
    residues = np.polyval(numerator, poles) / slope
    return (residues * np.exp(np.multiply.outer(t, poles))).sum(axis=-1).real


def levelling_loop(natural: float, damping: float, lag: float = 0.0) -> Loop:
    """Gains of channels 1 and 2 from natural frequency (rad/s) and damping, k_F = k_G = 1; InputError if unstable."""
    loop = Loop("levelling", 2.0 * damping * natural / GRAVITY, natural**2 / GRAVITY, GRAVITY, lag)
    loop.check()
    return loop


def azimuth_loop(natural: float, damping: float, lag: float = 0.0) -> Loop:
    """Gains of channel 3 from natural frequency (rad/s) and damping, k_r = k_psi = 1; InputError if unstable."""
    loop = Loop("azimuth", 2.0 * damping * natural, natural**2, 1.0, lag)
    loop.check()
    return loop


@dataclass(frozen=True)
class Verdict:
    """A requirement: met or not, and by how much (positive: in hand; in the unit of the requirement)."""

    what: str
    unit: str
    required: float
    reached: float
    in_hand: float

    @property
    def met(self) -> bool:
        return self.in_hand >= 0.0


def judge(
    loop: Loop,
    *,
    duration: float,
    settling_s: float | None = None,
    overshoot_percent: float | None = None,
    steady_percent: float | None = None,
    phase_margin_deg: float | None = None,
    gain_margin_db: float | None = None,
) -> list[Verdict]:
    """What the loop reaches of what is asked; duration: when the steady error is read, s after the step."""
    r = loop.response()
    steady = 100.0 * float(np.abs(loop.remaining(np.array([duration])))[0])
    asked = (
        ("settling into 5 %", "s", settling_s, r.settling_s, -1.0),
        ("overshoot", "%", overshoot_percent, r.overshoot_percent, -1.0),
        (f"steady error after {duration:g} s", "%", steady_percent, steady, -1.0),
        ("phase margin", "deg", phase_margin_deg, r.phase_margin_deg, 1.0),
        ("gain margin", "dB", gain_margin_db, r.gain_margin_db, 1.0),
    )
    return [Verdict(w, u, req, got, sign * (got - req)) for w, u, req, got, sign in asked if req is not None]


@dataclass(frozen=True)
class AlignmentRun:
    """Transient of the three loops. time (n,) s; psi, phi_x, phi_y (n,) rad against mN; commands (n, 3) rad/s;
    force (n, 2) measured, m/s^2; gimbal (n,) measured gimbal angle, rad. q_mNS (4,) at the end."""

    time: Array
    psi: Array
    phi_x: Array
    phi_y: Array
    commands: Array
    force: Array
    gimbal: Array
    q_mNS: Array


def align(
    case: PlatformCase,
    level: Loop,
    azimuth: Loop,
    duration: float = 1500.0,
    start: Sequence[float] = (0.0, 0.0, 0.0),
    step: float = 0.5,
) -> AlignmentRun:
    """Run the loops at rest at the start of the case.

    start : (phi_x, phi_y) off the end values and psi off its own, rad, when the loops close. The drifts of the case are
    there if it carries them or not: during alignment a drift that steps on later is absent.
    """
    from schuler.kernels import platform_alignment as k
    from schuler.kernels.platform_truth import quat_of_axes

    level.check()
    azimuth.check()
    north, up, lat = _rest(case)
    c = np.zeros(k.N_PLANT)
    c[[k.F_NORTH, k.F_UP, k.W_NORTH, k.W_UP]] = north, up, OMEGA * math.cos(lat), OMEGA * math.sin(lat)
    c[[k.KP_LEVEL, k.KI_LEVEL, k.KP_AZIMUTH, k.KI_AZIMUTH]] = level.kp, level.ki, azimuth.kp, azimuth.ki
    c[k.LAG] = level.lag
    c[[k.PSI_BODY, k.BIAS_PSI]] = case.heading, case.gimbal_bias
    c[[k.BIAS_1, k.BIAS_2]], c[[k.SCALE_1, k.SCALE_2]] = case.accel_bias, case.accel_scale
    c[[k.TORQUER_1, k.TORQUER_2, k.TORQUER_3]] = case.torquer_scale
    if case.drift_carried:
        c[[k.DRIFT_1, k.DRIFT_2, k.DRIFT_3]] = case.drift
    end = end_values(case)
    q0 = np.array(quat_of_axes(end.psi + start[2], end.phi_y + start[1], end.phi_x + start[0]))
    fastest = max(float(np.abs(level.poles).max()), float(np.abs(azimuth.poles).max()))
    n = max(2, math.ceil(duration / min(step, 0.2 / fastest)) + 1)
    shown = np.empty((n, k.N_SHOWN))
    state = k.align(c, q0, duration / (n - 1), shown)
    t = np.linspace(0.0, duration, n)
    psi = np.unwrap(shown[:, 0])
    return AlignmentRun(t, psi, shown[:, 1], shown[:, 2], shown[:, 3:6], shown[:, 6:8], shown[:, 8], state[:4])


def _rest(case: PlatformCase) -> tuple[float, float, float]:
    """Specific force north and up (m/s^2) in mN where the case starts, at rest, and the mass latitude (rad)."""
    still = PlatformCase(lat=case.lat, lon=case.lon, height=case.height, earth=case.earth)
    truth = truth_of(still, [0.0])
    return float(truth.force_mN[0, 0]), float(truth.force_mN[0, 2]), float(truth.lat[0])


@dataclass(frozen=True)
class EndValues:
    """What alignment leaves: (20)-(24). Angles rad, rates rad/s.

    phi_x, phi_y : tilts against mN, exact; to first order (F sin psi + b_a2)/G and (F cos psi - b_a1)/G.
    rates (3,) of the real platform; commands (3,) = rates less drifts (where alignment knew them) over torquer scale.
    d_r : what the Earth rate about the platform's axis 3 differs from w_e sin(lat) with, negated.
    """

    psi: float
    phi_x: float
    phi_y: float
    rates: Array
    commands: Array
    d_r: float


def end_values(case: PlatformCase) -> EndValues:
    """End of alignment at the start of the case, exact: measured forces zero, gimbal at its angle, no rates left."""
    from schuler.kernels.platform_truth import level_tilts, quat_of_axes, turn

    north, up, lat = _rest(case)
    psi = case.heading + case.gimbal_bias
    f1, f2 = (b / (1.0 + k) for b, k in zip(case.accel_bias, case.accel_scale, strict=True))
    phi_x, phi_y = level_tilts(north, up, psi, f1, f2)
    q = quat_of_axes(psi, phi_y, phi_x)
    w = (OMEGA * math.cos(lat), 0.0, OMEGA * math.sin(lat))
    rates = np.array(turn(q[0], -q[1], -q[2], -q[3], *w))
    drift = np.array(case.drift) if case.drift_carried else np.zeros(3)
    commands = (rates - drift) / (1.0 + np.array(case.torquer_scale))
    return EndValues(psi, phi_x, phi_y, rates, commands, w[2] - float(rates[2]))


def end_values_first_order(case: PlatformCase) -> EndValues:
    """The same by the source's formulas (20), (23), (24), with sin and cos of psi put right and phi_L in (24)."""
    north, up, lat = _rest(case)
    psi = case.heading + case.gimbal_bias
    s, c = math.sin(psi), math.cos(psi)
    b1, b2 = case.accel_bias
    phi_y, phi_x = (north * c - b1) / up, (north * s + b2) / up
    alpha, t1, t2 = north / GRAVITY, b1 / GRAVITY, b2 / GRAVITY
    w = OMEGA * math.cos(lat)
    d_r = -alpha * w - w * (s * t2 - c * t1)
    r = OMEGA * math.sin(lat + alpha) + w * (s * t2 - c * t1)
    rates = np.array([w * c - phi_y * r, -w * s + phi_x * r, r])
    drift = np.array(case.drift) if case.drift_carried else np.zeros(3)
    return EndValues(psi, phi_x, phi_y, rates, (rates - drift) / (1.0 + np.array(case.torquer_scale)), d_r)


@dataclass(frozen=True)
class Jump:
    """One signal at the switch from alignment to navigation: before, after, and whether it may jump (Table 1)."""

    name: str
    unit: str
    before: float
    after: float
    may_jump: bool

    @property
    def jumps(self) -> bool:
        scale = max(abs(self.before), abs(self.after))
        return abs(self.after - self.before) > 1e-9 * scale + 1e-18


def switch(case: PlatformCase) -> list[Jump]:
    """Table 1, corrected: the signals at 0- and 0+ of the switch, at rest.

    At the switch k_P goes to zero, k_I k_G k_F to 1/z (for any loop faster than Schuler a DEcrease), and channel 3 is
    commanded zero. A drift that steps on at this moment moves the true rates p, q by itself; the commands never jump.
    """
    from schuler.kernels.platform_truth import quat_of_axes, turn

    end = end_values(case)
    north, up, lat = _rest(case)
    q = quat_of_axes(end.psi, end.phi_y, end.phi_x)
    earth = np.array(turn(q[0], -q[1], -q[2], -q[3], OMEGA * math.cos(lat), 0.0, OMEGA * math.sin(lat)))
    f1, f2, _ = turn(q[0], -q[1], -q[2], -q[3], north, 0.0, up)
    after = (1.0 + np.array(case.torquer_scale)) * np.array([*end.commands[:2], 0.0]) + np.array(case.drift)
    rates = euler_rates(end.phi_x, end.phi_y, after - earth)
    a1, a2 = (
        f1 * (1.0 + case.accel_scale[0]) - case.accel_bias[0],
        f2 * (1.0 + case.accel_scale[1]) - case.accel_bias[1],
    )
    z = RADIUS + case.height
    p, r_q = end.commands[0], end.commands[1]
    both = p * end.phi_x + r_q * end.phi_y
    swing_x = -p * both - a2 / z + GRAVITY / z * end.phi_x
    swing_y = -r_q * both + a1 / z + GRAVITY / z * end.phi_y
    w = OMEGA * math.cos(lat)
    wx, wy = w * math.cos(end.psi), -w * math.sin(end.psi)
    return [
        Jump("phi_i", "rad", lat, lat, False),
        Jump("psi", "rad", end.psi, end.psi, False),
        Jump("w_x", "rad/s", wx, wx, False),
        Jump("w_y", "rad/s", wy, wy, False),
        Jump("w_x'", "rad/s^2", 0.0, swing_x, True),
        Jump("w_y'", "rad/s^2", 0.0, swing_y, True),
        Jump("psi'", "rad/s", 0.0, rates[2], True),
        Jump("r", "rad/s", float(end.rates[2]), float(after[2]), True),
        Jump("f_1", "m/s^2", f1, f1, False),
        Jump("f_2", "m/s^2", f2, f2, False),
        Jump("p commanded", "rad/s", float(end.commands[0]), float(end.commands[0]), False),
        Jump("q commanded", "rad/s", float(end.commands[1]), float(end.commands[1]), False),
        Jump("p", "rad/s", float(end.rates[0]), float(after[0]), not case.drift_carried),
        Jump("q", "rad/s", float(end.rates[1]), float(after[1]), not case.drift_carried),
        Jump("phi_x'", "rad/s", 0.0, rates[0], True),
        Jump("phi_y'", "rad/s", 0.0, rates[1], True),
        Jump("phi_x", "rad", end.phi_x, end.phi_x, False),
        Jump("phi_y", "rad", end.phi_y, end.phi_y, False),
    ]


def euler_rates(phi_x: float, phi_y: float, w: Array) -> tuple[float, float, float]:
    """(phi_x', phi_y', psi'), rad/s, of a platform that turns at w (3,) against mN, in its own axes."""
    w1, w2, w3 = (float(x) for x in w)
    s, c = math.sin(phi_x), math.cos(phi_x)
    psi = (w2 * s + w3 * c) / math.cos(phi_y)
    return w1 + math.sin(phi_y) * psi, w2 * c - w3 * s, psi


def integral_gain_ratio(level: Loop, z: float = RADIUS) -> float:
    """k_I k_G k_F of alignment over that of navigation, 1/z: more than one for any loop faster than Schuler."""
    return level.ki * z


def jump_of_a_gain_after_the_integrator(case: PlatformCase, level: Loop, z: float = RADIUS) -> float:
    """rad/s by which the command p would jump if k_I stood after the integrator and were changed at the switch."""
    return (1.0 / integral_gain_ratio(level, z) - 1.0) * float(end_values(case).commands[0])


def angles_at_end(run: AlignmentRun) -> Array:
    """(3,) phi_x, phi_y, psi, rad, at the end of a run."""
    return platform_angles(run.q_mNS)
