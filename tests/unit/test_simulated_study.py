"""From a study of kind "aided" without [input] to its simulated recording, and what bad keys get."""

import math

import numpy as np
import pytest

from schuler.ground.errors import StudyError
from schuler.studies.model import parse_study
from schuler.studies.simulated import simulation

D = math.pi / 180.0


def raw(**sections):
    found = {
        "study": {"name": "x", "kind": "aided"},
        "start": {"lat_deg": 50.0, "lon_deg": 30.0, "heading_deg": 40.0},
        "trajectory": {"preset": "car", "duration_s": 200.0, "rate_hz": 50.0},
        "imu": {"gyro_bias_deg_per_h": 10.0, "gyro_scale_ppm": 300.0},
    }
    for name, keys in sections.items():
        found[name] = {**found.get(name, {}), **keys}
    return parse_study(found)


def test_keys_arrive_in_si() -> None:
    made = simulation(
        raw(
            simulate={
                "speed_hz": 5.0, "dvl_hz": 2.0, "height_hz": 1.0, "mounting_deg": 2.0, "antenna_lever_m": 0.2,
                "gnss_delay_s": 0.1, "height_bias_m": 4.0, "height_walk_m_per_sqrt_h": 6.0, "mag_bias_ut": 1.5,
                "magnetometer": True, "heading_offset_deg": 3.0, "dvl_misalignment_deg": 1.0,
                "range_scale_percent": 5.0, "depth_bias_m": 7.0, "range_bias_m": 0.7,
            },
            noise={"speed_mps": 0.2, "speed_scale_percent": 2.0, "gnss_correlated_m": 1.0, "mag_deg": 2.5,
                   "current_walk_mps_per_sqrt_h": 0.6},
            mounting={"antenna_frd_m": [1.0, 0.0, -2.0], "imu_to_body_rpy_deg": [180.0, 0.0, 90.0]},
            start={"std_north_m": 3.0, "std_heading_deg": 5.0},
            input={"gnss_delay_s": 0.25},
            filter={"speed_is": "water"},
        )
    )  # fmt: skip
    s = made.suite
    assert (s.speed_hz, s.dvl_hz, s.gnss_hz, s.depth_hz) == (5.0, 2.0, 1.0, 0.0)
    assert s.mounting_std == pytest.approx(2.0 * D) and s.dvl_misalignment_std == pytest.approx(D)
    assert (s.antenna_std, s.gnss_delay_std, s.height_bias_std) == (0.2, 0.1, 4.0)
    assert s.height_walk == pytest.approx(0.1) and s.depth_bias_std == 7.0 and s.range_bias_std == 0.7
    assert s.gnss_delay == 0.25 and s.speed_is == "water"
    assert s.speed_scale_std == 0.02 and s.speed_std == 0.2 and s.range_scale_std == 0.05
    assert s.gnss_correlated == (1.0, 1.0, 1.5) and s.current_walk == pytest.approx(0.01)
    assert s.magnetometer.bias_deg == pytest.approx(3.0) and s.magnetometer.noise_deg == 2.5
    assert s.magnetometer.hard_iron_ut == pytest.approx(1.5)
    assert s.antenna == (1.0, 0.0, -2.0) and s.imu_to_body == pytest.approx((math.pi, 0.0, math.pi / 2))
    assert s.start_std == pytest.approx((3.0, 0, 0, 0, 0, 0, 0, 0, 5.0 * D))
    assert made.imu.gyro_scale[0] == pytest.approx(3e-4) and made.rate_hz == 50.0


def test_what_the_filter_estimates_is_drawn_with_its_prior_and_nothing_else() -> None:
    sensors = {"speed_hz": 1.0, "dvl_hz": 1.0, "height_hz": 1.0, "depth_hz": 1.0, "ranges_hz": 1.0}
    names = ("speed_scale", "mounting", "dvl_scale", "dvl_misalignment", "height_bias", "depth_bias", "range_scale",
             "range_bias")  # fmt: skip
    own = simulation(raw(simulate=sensors)).suite  # what the filter chooses itself
    assert all(getattr(own, f"{name}_std") > 0.0 for name in names)
    assert own.gnss_correlated == (2.0, 2.0, 3.0)
    assert own.antenna_std == own.gnss_delay_std == own.speed_arm_std == 0.0
    few = simulation(raw(simulate=sensors, filter={"estimate": ["antenna_lever", "gnss_delay"]})).suite
    assert all(getattr(few, f"{name}_std") == 0.0 for name in names)
    assert few.gnss_correlated == (0.0, 0.0, 0.0) and few.height_walk == 0.0
    assert few.antenna_std > 0.0 and few.gnss_delay_std > 0.0 and few.gnss_velocity_delay_std == 0.0
    both = simulation(raw(filter={"estimate": ["gnss_velocity_delay", "gnss_delay"]})).suite
    assert both.gnss_velocity_delay_std is None  # as late as the position


def test_a_study_becomes_a_recording() -> None:
    r = simulation(raw(simulate={"ranges_hz": 1.0, "beacons": 3, "speed_hz": 10.0, "mounting_deg": 0.0})).record(seed=1)
    assert {n: len(t) for n, t in r.tables.items()} == {
        "imu": 10000, "gnss": 200, "speed": 2000, "ranges": 600, "landmarks": 3
    }  # fmt: skip
    assert r.tables["imu"].kind == "increments" and r.reference["heading"][0] == pytest.approx(40.0 * D)
    assert np.all(r.tables["speed"]["speed"][:200] < 0.5)  # a car stands at first


@pytest.mark.parametrize("preset", ["legs", "flight", "dive", "rhumb-line", "great-circle", "oscillation", "rest"])
def test_other_trajectories_carry_the_sensors_too(preset: str) -> None:
    made = simulation(raw(trajectory={"preset": preset, "speed_mps": 40.0}, simulate={"dvl_hz": 1.0}))
    assert len(made.record(seed=0).tables["dvl"]) == 200


def test_speed_and_standing_time_are_the_presets_own_where_not_typed() -> None:
    assert simulation(raw()).trajectory.at(29.9).v_n[0, 0] == 0.0
    assert np.linalg.norm(simulation(raw(trajectory={"preset": "flight"})).trajectory.at(0.0).v_n) == pytest.approx(60)
    brisk = simulation(raw(trajectory={"stand_s": 2.0, "speed_mps": 5.0})).trajectory.at(np.arange(0.0, 200.0))
    assert 0.0 < np.linalg.norm(brisk.v_n[5]) and np.linalg.norm(brisk.v_n, axis=1).max() < 6.6


def test_all_faults_come_together() -> None:
    with pytest.raises(StudyError) as caught:
        simulation(
            raw(
                trajectory={"earth": "sphere", "speed_mps": 0.0},
                simulate={"sightings_per_s": 1.0, "depth_hz": 0.001},
            )
        )
    said = "\n".join(caught.value.faults)
    for part in ("earth", "goes nowhere", "[camera] is absent", "depth_hz = 0.001"):
        assert part in said
    assert len(caught.value.faults) == 4


@pytest.mark.parametrize(
    ("simulate", "says"),
    [
        ({"gnss_hz": -1.0}, "gnss_hz: must be at least 0"),
        ({"beacons": 0}, "beacons: must be at least 1"),
        ({"speed_is": "mud"}, '"ground", "water", "air"'),
        ({"gnss_rate": 1.0}, "gnss_hz"),
        ({"year": 1999.0}, "year: must be at least 2025"),
    ],
)
def test_bad_keys_get_one_sentence(simulate: dict, says: str) -> None:
    with pytest.raises(StudyError) as caught:
        raw(simulate=simulate)
    assert len(caught.value.faults) == 1 and says in caught.value.faults[0]


def test_a_start_without_a_place_and_a_recording_are_refused() -> None:
    study = parse_study({"study": {"name": "x", "kind": "aided"}, "simulate": {"gnss_hz": 1.0}})
    with pytest.raises(StudyError, match="lat_deg is absent"):
        simulation(study)
    with pytest.raises(StudyError, match=r"came beside \[input\] imu"):
        simulation(raw(input={"imu": "imu.csv"}))
