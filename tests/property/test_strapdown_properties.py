"""Properties of the strapdown at random places, attitudes and motions: no drift, no dependence on the blocks."""

import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from schuler.inertial.alignment import SensorErrors
from schuler.inertial.alignment_filter import align
from schuler.inertial.strapdown import Start, Strapdown
from schuler.truth import trajectories
from schuler.truth.imu_errors import measure
from schuler.truth.instruments import ImuModel

D = math.pi / 180.0
angle = st.floats(-180.0, 180.0)
some = settings(max_examples=15, deadline=None, derandomize=True)


@some
@given(lat=st.floats(-85.0, 85.0), lon=angle, heading=angle, speed=st.floats(1.0, 300.0), turn=st.floats(-170.0, 170.0))
def test_a_flight_without_errors_closes_anywhere(
    lat: float, lon: float, heading: float, speed: float, turn: float
) -> None:
    flight = trajectories.legs(
        lat * D, lon * D, 500.0, speed=speed, heading=heading * D, turns=[turn * D], climbs=[50.0, -50.0],
        turn_rate=8.0 * D, duration=120.0,
    )  # fmt: skip
    ideal = flight.ideal(100.0)
    track = Strapdown(Start.of(ideal.start)).feed(ideal.dtheta, ideal.dv, ideal.dt)
    errors = track.minus(ideal.truth)
    assert np.abs(errors.position).max() < 1e-3
    assert np.abs(errors.velocity).max() < 1e-4
    assert np.abs(errors.phi).max() < 1e-8 / math.cos(lat * D)  # NED turns with longitude


def test_a_turn_of_a_hair_is_no_jolt() -> None:
    """Found by the property above: at the full turn rate it took a third of a millisecond."""
    flight = trajectories.legs(
        0.5, 0.0, 500.0, speed=100.0, heading=0.3, turns=[1e-3 * D], climbs=[1e-3], duration=60.0
    )
    ideal = flight.ideal(100.0)
    track = Strapdown(Start.of(ideal.start)).feed(ideal.dtheta, ideal.dv, ideal.dt)
    assert np.abs(track.minus(ideal.truth).position).max() < 1e-4


@some
@given(heading=angle, away=st.floats(0.0, 0.5), lon=angle, south=st.booleans())
def test_a_great_circle_over_or_beside_a_pole_closes(heading: float, away: float, lon: float, south: bool) -> None:
    lat = -90.0 + away if south else 90.0 - away
    circle = trajectories.great_circle(lat * D, lon * D, 9000.0, speed=250.0, heading=heading * D, duration=200.0)
    ideal = circle.ideal(50.0)
    track = Strapdown(Start.of(ideal.start)).feed(ideal.dtheta, ideal.dv, ideal.dt)
    errors = track.minus(ideal.truth)
    assert np.abs(errors.position).max() < 1e-3
    assert np.abs(errors.phi).max() < 1e-9


@some
@given(
    seed=st.integers(0, 10_000), cuts=st.lists(st.integers(1, 199), max_size=6), scheme=st.sampled_from(
        ["none", "one", "two", "three"]
    ),
)  # fmt: skip
def test_blocks_of_any_length_give_the_bits_of_the_batch(seed: int, cuts: list[int], scheme: str) -> None:
    rng = np.random.default_rng(seed)
    dtheta, dv = 0.01 * rng.standard_normal((200, 3)), 0.1 * rng.standard_normal((200, 3)) - [0.0, 0.0, 0.1]
    start = Start.level(*rng.uniform(-1.5, 1.5, 2), 100.0, heading=rng.uniform(-3, 3), v_n=rng.uniform(-50, 50, 3))
    whole = Strapdown(start, coning=scheme).feed(dtheta, dv, 0.01)  # type: ignore[arg-type]
    ins = Strapdown(start, coning=scheme)  # type: ignore[arg-type]
    edges = [0, *sorted(set(cuts)), 200]
    parts = [ins.feed(dtheta[a:b], dv[a:b], 0.01) for a, b in zip(edges[:-1], edges[1:], strict=True)]
    for name in ("lat", "lon", "height", "v_n", "q_nb"):
        joined = np.concatenate([getattr(p, name) for p in parts])
        assert joined.tobytes() == getattr(whole, name).tobytes(), name


@some
@given(lat=st.floats(-70.0, 70.0), roll=angle, pitch=st.floats(-80.0, 80.0), heading=angle)
def test_a_perfect_imu_at_rest_finds_any_attitude(lat: float, roll: float, pitch: float, heading: float) -> None:
    still = trajectories.rest(lat * D, 0.1, 50.0, roll=roll * D, pitch=pitch * D, heading=heading * D, duration=120.0)
    ideal = still.ideal(10.0)
    sensor = SensorErrors.of(accel_bias=5e-4, gyro_bias=5e-8, vrw=2e-4, arw=6e-7)
    found = align(ideal.table(), sensor, lat=lat * D, height=50.0, start=0.0, to=120.0)
    miss = (found.rpy - ideal.truth.rpy[-1] + math.pi) % (2.0 * math.pi) - math.pi
    assert np.abs(miss * [math.cos(pitch * D), 1.0, math.cos(pitch * D)]).max() < 1e-5


@some
@given(lat=st.floats(-65.0, 65.0), roll=st.floats(-60.0, 60.0), pitch=st.floats(-60.0, 60.0), heading=angle,
       seed=st.integers(0, 999))  # fmt: skip
def test_an_alignment_stays_within_its_sigma(lat: float, roll: float, pitch: float, heading: float, seed: int) -> None:
    still = trajectories.rest(lat * D, 0.1, 0.0, roll=roll * D, pitch=pitch * D, heading=heading * D, duration=120.0)
    imu = ImuModel(
        gyro_bias_deg_per_h=0.02, gyro_arw_deg_per_sqrt_h=0.002, accel_bias_ug=1000.0, accel_vrw_mps_per_sqrt_h=0.01,
        accel_scale_ppm=500.0, accel_misalignment_mrad=0.5,
    )  # fmt: skip
    ideal = still.ideal(10.0)
    sensor = SensorErrors.of(
        accel_bias=imu.accel_bias, gyro_bias=imu.gyro_bias, vrw=imu.vrw, arw=imu.arw, accel_scale=imu.accel_scale,
        accel_misalignment=imu.accel_misalignment,
    )  # fmt: skip
    found = align(measure(ideal, imu, seed=seed).table(), sensor, lat=lat * D, start=0.0, to=120.0)
    miss = (found.rpy - ideal.truth.rpy[-1] + math.pi) % (2.0 * math.pi) - math.pi
    assert np.abs(miss / found.std).max() < 4.5
