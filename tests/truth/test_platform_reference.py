"""The platform against an independent recomputation (DOP853, 1e-12), and against what must be exact."""

import math
from dataclasses import replace

import numpy as np
import pytest

from schuler.inertial import platform as inertial
from schuler.inertial import platform_alignment as alignment
from schuler.inertial.platform import GRAVITY, PlatformCase
from schuler.published.platform import pitman_formula, pitman_simulated
from schuler.published.platform_figures import (
    DRIFTS,
    MODELS,
    RAMPED,
    RECOMPUTED,
    SCENARIOS,
    SIGNED,
    TABLE_2,
    TIMES,
)

DEG = math.pi / 180.0
DEG_H = DEG / 3600.0


def case_of(scenario, drift="none", **more):
    dlat, dlon = SCENARIOS[scenario]
    return PlatformCase(
        lat=35.7 * DEG,
        lon=51.4 * DEG,
        heading=math.pi,
        lat_change=dlat * DEG,
        lon_change=dlon * DEG,
        drift=tuple(x * DEG_H for x in DRIFTS[drift]),
        **more,
    )


@pytest.mark.parametrize("scenario", SCENARIOS)
def test_every_row_of_the_recomputation_within_a_centimetre(scenario):
    """Same algorithm, another integrator: 0.01 m, where errors reach 31 km."""
    rows = {key: value for key, value in RECOMPUTED.items() if key[0] == scenario}
    assert len(rows) >= 17
    for (_, drift, model), values in rows.items():
        case = case_of(scenario, drift)
        run = inertial.navigate(case, *MODELS[model], time=inertial.nodes(case, at=TIMES))
        np.testing.assert_allclose(run.at(TIMES)[:, 0], values, rtol=0, atol=0.01, err_msg=f"{drift} {model}")


def test_signed_errors_north_and_east():
    for (scenario, drift), values in SIGNED.items():
        for form, model, (north, east) in zip(
            ("literal", "exact", "exact"), ("pinav", "pinav_exact", "free"), values, strict=True
        ):
            run = inertial.navigate(case_of(scenario, drift), MODELS[model][0], form)
            assert run.north[-1] == pytest.approx(north, abs=0.01), (scenario, drift, model)
            assert run.east[-1] == pytest.approx(east, abs=0.01), (scenario, drift, model)


@pytest.mark.parametrize(("scenario", "model"), RAMPED)
def test_a_ramped_start(scenario, model):
    for drift, value in zip(("ch1", "ch3", "both"), RAMPED[scenario, model], strict=True):
        run = inertial.navigate(case_of(scenario, drift, start_ramp=300.0), *MODELS[model])
        assert run.error[-1] == pytest.approx(value, abs=0.051)  # printed to 0.1 m


@pytest.mark.parametrize("scenario", SCENARIOS)
@pytest.mark.parametrize("ramp", [0.0, 10.0, 300.0])
def test_without_drift_the_exact_forms_do_not_err(scenario, ramp):
    """Below 1e-4 m over two hours at up to 1.3 km/s: position-independent, free azimuth and both strapdowns."""
    case = case_of(scenario, start_ramp=ramp)
    for algorithm in ("position-independent", "free-azimuth", "strapdown", "strapdown-open-loop", "as-published"):
        assert inertial.navigate(case, algorithm).error.max() < 1e-4, algorithm


def test_height_profile_and_z_that_follows_it():
    """A climb from 1 to 16 km leaves the exact forms exact, because z follows the height."""
    case = case_of("latlon", start_ramp=300.0, height=1000.0, height_change=15000.0)
    for algorithm in ("position-independent", "free-azimuth", "strapdown"):
        assert inertial.navigate(case, algorithm).error.max() < 1e-4, algorithm
    wrong = inertial.navigate(replace(case, z_scale=1.001), form="corrected").error.max()
    assert wrong > 300.0


def test_z_off_by_a_thousandth():
    """35 m at rest and 877 m in flight with (15), bounded; nothing with (9), (11), which take the command as it is."""
    at = [600.0, 1800.0, 2400.0, 3600.0, 5400.0, 7200.0]
    rest = replace(case_of("rest"), z_scale=1.001)
    flight = replace(case_of("lat", start_ramp=300.0), z_scale=1.001)
    assert inertial.navigate(rest, form="corrected").at(at)[:, 0].max() == pytest.approx(35.3, abs=0.1)
    assert inertial.navigate(flight, form="corrected").at(at)[:, 0].max() == pytest.approx(876.5, abs=0.5)
    assert inertial.navigate(rest).error.max() < 1e-4


def test_direction_cosines_and_angles_are_one_algorithm():
    for algorithm, form in (
        ("position-independent", "corrected"),
        ("position-independent", "literal"),
        ("free-azimuth", "exact"),
    ):
        case = case_of("latlon", "both")
        a = inertial.navigate(case, algorithm, form, cosines=False)
        b = inertial.navigate(case, algorithm, form, cosines=True)
        assert a.code != b.code
        np.testing.assert_allclose(np.hypot(a.north - b.north, a.east - b.east), 0.0, atol=1e-5)


@pytest.mark.parametrize("lat_deg", [85.0, 89.9, -89.99])
def test_near_a_pole_the_form_is_switched_and_said(lat_deg):
    case = PlatformCase(lat=lat_deg * DEG, heading=0.3, drift=(0.01 * DEG_H, 0.0, 0.1 * DEG_H))
    exact = inertial.navigate(case)
    free = inertial.navigate(case, "free-azimuth")
    assert any("direction cosines" in note for note in free.notes)
    assert np.abs(exact.error - free.error).max() < 5.0
    assert 1800.0 < exact.error[-1] < 2300.0
    clean = replace(case, drift=(0.0, 0.0, 0.0))
    assert inertial.navigate(clean, "free-azimuth").error.max() < 1e-4


def test_what_a_drift_does_that_was_there_before_the_switch():
    """Steps on, carried with the command taken for the rate, carried with p started from the known rates."""
    case = case_of("rest", "ch1")
    assert inertial.navigate(case).error[-1] == pytest.approx(2103.008, abs=0.001)
    assert inertial.navigate(replace(case, drift_carried=True)).error[-1] == pytest.approx(2103.005, abs=0.001)
    assert inertial.navigate(replace(case, drift_carried=True, known_rates=True)).error.max() < 1e-4


@pytest.mark.parametrize("row", TABLE_2)
def test_table_2_simulated_and_by_its_formula(row):
    simulated, formula = TABLE_2[row]
    np.testing.assert_allclose(pitman_simulated(row), np.abs(simulated), atol=0.002)
    np.testing.assert_allclose(pitman_formula(row), np.abs(formula), atol=0.0011)


ALIGNED = dict(
    lat=35.7 * DEG,
    heading=40.0 * DEG,
    accel_bias=(1e-4 * GRAVITY, -2e-4 * GRAVITY),
    drift=(0.01 * DEG_H, -0.02 * DEG_H, 0.1 * DEG_H),
    gimbal_bias=1e-3,
)


def test_alignment_table_to_six_digits():
    case = PlatformCase(**ALIGNED, drift_carried=True)
    level, azimuth = alignment.levelling_loop(0.03, 0.8), alignment.azimuth_loop(0.05, 0.8)
    assert level.kp == pytest.approx(4.887859e-3, rel=1e-6)
    assert level.ki == pytest.approx(9.164736e-5, rel=1e-6)
    run = alignment.align(case, level, azimuth, 1500.0, start=(0.01, -0.01, 0.03))
    end = alignment.end_values(case)
    assert run.psi[-1] == pytest.approx(0.6991317008, rel=1e-9)
    assert run.phi_x[-1] == pytest.approx(8.5402217818e-4, rel=1e-9)
    assert run.phi_y[-1] == pytest.approx(1.15390164850e-3, rel=1e-9)
    np.testing.assert_allclose(run.commands[-1], [4.52279691e-5, -3.79766208e-5, 4.21524867e-5], rtol=2e-9)
    np.testing.assert_allclose(end.rates, [4.52764505e-5, -3.80735836e-5, 4.26373004e-5], rtol=2e-9)
    np.testing.assert_allclose(end.commands, run.commands[-1], rtol=1e-9)
    assert (end.phi_x, end.phi_y) == pytest.approx((run.phi_x[-1], run.phi_y[-1]), rel=1e-10)
    assert end.d_r == pytest.approx(-8.48041527e-8, rel=1e-8)
    linear = alignment.end_values_first_order(case)
    assert linear.d_r == pytest.approx(-8.46550620e-8, rel=1e-8)
    assert linear.phi_x == pytest.approx(end.phi_x, rel=2e-6)
    assert linear.phi_y == pytest.approx(end.phi_y, rel=2e-6)
    np.testing.assert_allclose(linear.rates, end.rates, rtol=6e-6)


def test_the_switch_carried_and_stepping_on():
    carried = {j.name: j for j in alignment.switch(PlatformCase(**ALIGNED, drift_carried=True))}
    steps = {j.name: j for j in alignment.switch(PlatformCase(**ALIGNED))}
    assert carried["phi_x'"].after == pytest.approx(-4.8639828e-8, rel=1e-7)
    assert carried["phi_y'"].after == pytest.approx(3.5999154e-8, rel=1e-7)
    assert steps["phi_x'"].after == pytest.approx(-1.5855515e-10, rel=1e-7)
    assert steps["phi_y'"].after == pytest.approx(-6.0963547e-8, rel=1e-7)
    assert carried["psi'"].after == pytest.approx(-4.21525e-5, rel=1e-6)
    for jumps in (carried, steps):
        assert all(j.may_jump or not j.jumps for j in jumps.values())
        assert {n for n, j in jumps.items() if j.jumps} >= {"psi'", "r", "w_x'", "w_y'", "phi_x'", "phi_y'"}
    assert not carried["p"].jumps
    assert steps["p"].jumps
    ratio = alignment.integral_gain_ratio(alignment.levelling_loop(0.03, 0.8))
    assert ratio == pytest.approx(584.0, abs=0.5)
    moved = alignment.jump_of_a_gain_after_the_integrator(
        PlatformCase(**ALIGNED, drift_carried=True), alignment.levelling_loop(0.03, 0.8)
    )
    assert moved == pytest.approx(-4.5e-5, abs=1e-6)
