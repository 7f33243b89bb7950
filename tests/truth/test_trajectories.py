"""The truth is one formula: its velocity is the derivative of its position, its rates those of its attitude."""

import math

import numpy as np
import pytest

from schuler.ground.earth import WGS84, C_en
from schuler.ground.errors import InputError
from schuler.ground.frames import dcm_from_quat
from schuler.truth import manoeuvres
from schuler.truth import trajectories as shapes
from schuler.truth.trajectories import TEXTBOOK

D = math.pi / 180.0
PLACE = (50.0 * D, 30.0 * D, 3000.0)


def made() -> dict[str, shapes.Trajectory]:
    flight = shapes.legs(
        *PLACE, speed=200.0, heading=40.0 * D, turns=[90 * D, -60 * D], climbs=[1000.0, -500.0, 0.0], duration=900.0
    )
    t = np.arange(0.0, 300.0, 2.0)
    seen = flight.at(t)
    return {
        "legs": flight,
        "sphere": shapes.legs(
            *PLACE, speed=200.0, heading=1.0, turns=[0.5], turn_rate=0.05, duration=300.0, earth=TEXTBOOK
        ),
        "weave": shapes.legs(*PLACE, speed=80.0, heading=1.0, duration=200.0).with_waves(
            ("course", 0.8, 0.05, 0.3), ("climb", 5.0, 0.08, 1.0), ("speed", 4.0, 0.1, 0.0), ("pitch", 0.1, 0.2, 0.5)
        ),
        "rhumb": shapes.rhumb_line(*PLACE, speed=200.0, heading=2.0, duration=200.0),
        "great circle": shapes.great_circle(*PLACE, speed=200.0, heading=1.0, duration=200.0),
        "over the pole": shapes.great_circle(89.99 * D, 0.3, 1000.0, speed=200.0, heading=0.01, duration=20.0),
        "dive": shapes.dive(*PLACE, speed=2.0, heading=1.0, depth=100.0, duration=300.0),
        "oscillation": shapes.oscillation(*PLACE, duration=100.0),
        "coning": shapes.coning(*PLACE, duration=10.0),
        "turntable": shapes.turntable(*PLACE, rate=0.4, mount=(0.5, 0.5, 0.5, 0.5), duration=30.0),
        "car": manoeuvres.car(*PLACE, speed=15.0, heading=1.0, duration=200.0),
        "flight": manoeuvres.flight(*PLACE, speed=60.0, heading=1.0, duration=200.0),
        "track": shapes.track(t, seen.lat, seen.lon, seen.height),
    }


@pytest.mark.parametrize("name", list(made()))
def test_formulas_are_derivatives_of_each_other(name: str) -> None:
    """Second differences of the inertial position give f_b, differences of the attitude w_ib_b, on a turning Earth."""
    path = made()[name]
    earth = path.earth
    h = 0.02 if path.fastest < 10.0 else 0.0005
    scale = 1.0 if path.fastest < 10.0 else 1e4  # positions at rest are coarse for differences over half a millisecond
    t0 = 0.37 * path.duration
    times = t0 + h * np.arange(-2, 3)
    s = path.at(times)
    turn = earth.omega * (times - t0)
    Z = np.array([[[math.cos(a), -math.sin(a), 0], [math.sin(a), math.cos(a), 0], [0, 0, 1]] for a in turn])
    r = np.einsum("nij,nj->ni", Z, earth.ecef_from_geodetic(s.lat, s.lon, s.height))
    C_ib = Z @ C_en(s.lat, s.lon) @ dcm_from_quat(s.q_nb)
    here = C_en(s.lat[2], s.lon[2])
    v = (r[0] - 8 * r[1] + 8 * r[3] - r[4]) / (12 * h) - np.cross([0, 0, earth.omega], r[2])
    np.testing.assert_allclose(here.T @ v, s.v_n[2], atol=2e-6 * max(1.0, 0.02 / h))
    accel = (-r[0] + 16 * r[1] - 30 * r[2] + 16 * r[3] - r[4]) / (12 * h * h)
    spin = np.array([0.0, 0.0, earth.omega])
    # the centrifugal part is in the plumb bob's gravity: take it out for the attraction alone
    gravitation = here @ earth.gravity_n(s.lat[2], s.height[2]) + np.cross(spin, np.cross(spin, r[2]))
    f = C_ib[2].T @ (accel - gravitation)
    np.testing.assert_allclose(f, s.f_b[2], atol=3e-5 * scale)
    dC = (C_ib[0] - 8 * C_ib[1] + 8 * C_ib[3] - C_ib[4]) / (12 * h)
    W = C_ib[2].T @ dC
    w = np.array([W[2, 1] - W[1, 2], W[0, 2] - W[2, 0], W[1, 0] - W[0, 1]]) / 2
    np.testing.assert_allclose(w, s.w_ib_b[2], atol=1e-7 if h > 0.01 else 1e-8)


@pytest.mark.parametrize("name", list(made()))
def test_increments_are_exact_integrals(name: str) -> None:
    """More quadrature nodes change nothing, and the positions of the generator are those of the formula."""
    path = made()[name]
    rate = 100.0 if path.fastest < 10.0 else 200.0
    usual, dense = (path.ideal(rate, 5.0, nodes=m) for m in (None, 10))
    np.testing.assert_allclose(usual.dtheta, dense.dtheta, atol=3e-16)
    np.testing.assert_allclose(usual.dv, dense.dv, atol=3e-15)
    at = path.at(usual.time[::100])
    np.testing.assert_allclose(usual.truth.lat[::100], at.lat, atol=3e-16)
    np.testing.assert_allclose(usual.truth.lon[::100], at.lon, atol=3e-16 if abs(PLACE[0]) < 1 else 1e-12)
    np.testing.assert_allclose(usual.truth.height[::100], at.height, atol=1e-9)


def test_acceleration_has_a_continuous_derivative() -> None:
    """At the joints of turns and climbs specific force and rate have no kink."""
    path = made()["legs"]
    for joint in path.breaks[1:]:
        e = 1e-4
        a, b, c, d = (path.at(joint + k * e).f_b[0] for k in (-2, -1, 1, 2))
        left, right = (b - a) / e, (d - c) / e
        np.testing.assert_allclose(left, right, atol=2e-3)


def test_a_great_circle_on_a_sphere_keeps_its_speed_and_plane() -> None:
    path = shapes.great_circle(*PLACE, speed=300.0, heading=1.0, duration=3600.0, earth=TEXTBOOK)
    s = path.at(np.linspace(0.0, 3600.0, 50))
    np.testing.assert_allclose(np.linalg.norm(s.v_n, axis=1), 300.0, rtol=1e-12)
    r = TEXTBOOK.ecef_from_geodetic(s.lat, s.lon, s.height)
    normal = np.cross(r[0], r[-1])
    assert np.abs(r @ normal).max() / np.linalg.norm(normal) < 1e-6


def test_a_rhumb_line_ends_where_the_isometric_latitude_says() -> None:
    """On the sphere: d lon = tan(heading) (psi2 - psi1), psi the isometric latitude."""
    heading, speed, duration = 30.0 * D, 200.0, 3600.0
    path = shapes.rhumb_line(50.21 * D, 30.3 * D, speed=speed, heading=heading, duration=duration, earth=TEXTBOOK)
    end = path.at(duration)
    lat = 50.21 * D + speed * duration * math.cos(heading) / TEXTBOOK.a
    psi = [math.asinh(math.tan(x)) for x in (50.21 * D, lat)]
    assert end.lat[0] == pytest.approx(lat, abs=1e-14)
    assert end.lon[0] == pytest.approx(30.3 * D + math.tan(heading) * (psi[1] - psi[0]), abs=1e-14)


def test_a_track_passes_through_its_points() -> None:
    t = np.linspace(0.0, 60.0, 31)
    lat, lon = 0.9 + 1e-6 * np.sin(0.1 * t), -3.14 - 1e-4 * t
    path = shapes.track(t, lat, lon, 10.0 * np.cos(0.05 * t))
    s = path.at(t)
    assert np.abs(s.lat - lat).max() < 1e-15
    assert np.abs((s.lon - lon + math.pi) % (2 * math.pi) - math.pi).max() < 1e-12
    assert np.abs(s.lon).max() <= math.pi


def test_the_pieces_of_the_generator_join_without_a_seam() -> None:
    from schuler.kernels import motion

    path = made()["legs"]
    whole = path.ideal(50.0, 20.0)
    c, b, a = shapes.gauss(path.nodes_for(0.02))
    pos = np.array([path.lat, path.lon, path.height, 0.0, 0.0, 0.0])
    rows = np.empty((0, motion.SHORT))
    got = []
    for k0, n in ((0, 300), (300, 700)):
        w, f = np.empty((n, 3)), np.empty((n, 3))
        motion.generate(
            k0, n, 50.0, pos, path.par, path.earth_array, path.breaks, path.coefs, path.waves, c, b, a, 1, w, f, rows
        )
        got.append(np.hstack([w, f]))
    assert np.array_equal(np.vstack(got), np.hstack([whole.dtheta, whole.dv]))


@pytest.mark.parametrize(
    ("what", "says"),
    [
        (lambda: shapes.legs(*PLACE, speed=200.0, heading=0.0, turns=[3.0], duration=60.0), "longer than its leg"),
        (lambda: shapes.rhumb_line(1.5707, 0.0, speed=10.0, heading=0.0), "great-circle"),
        (lambda: shapes.track([0, 1, 2], [0] * 3, [0] * 3, [0] * 3), "six points"),
        (lambda: shapes.track([0, 1, 2, 2, 4, 5], [0] * 6, [0] * 6, [0] * 6), "row 4"),
        (lambda: shapes.rest(*PLACE, duration=-1.0), "duration_s"),
        (lambda: shapes.rest(*PLACE).ideal(0.0), "rate_hz"),
        (lambda: shapes.rest(*PLACE).at(1e9), "runs from 0"),
    ],
)
def test_bad_trajectories_are_refused_with_what_to_change(what, says: str) -> None:
    with pytest.raises(InputError, match=says):
        what()


def test_ecef_radius_of_a_rest_is_constant() -> None:
    s = shapes.rest(*PLACE, roll=0.1, pitch=0.2, heading=0.3, duration=100.0).at([0.0, 50.0, 100.0])
    np.testing.assert_allclose(np.linalg.norm(s.f_b, axis=1), float(WGS84.gravity(PLACE[0], PLACE[2])), rtol=1e-14)
    np.testing.assert_allclose(s.rpy, np.tile([0.1, 0.2, 0.3], (3, 1)), atol=1e-14)
