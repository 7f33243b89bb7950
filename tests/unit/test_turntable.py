"""Lever arms from a turntable: exact without noise, honest with it, faults said."""

import numpy as np
import pytest

from schuler.calibration import thesis, turntable
from schuler.calibration.turntable import TurntableSettings, calibrate
from schuler.ground.errors import InputError
from schuler.ground.tables import Table
from schuler.ground.units import ARCMIN, DEG
from schuler.truth.turntable import THESIS_PLAN, Turntable, positions_table, spin_axis

LEVERS = np.array([[28.08, -14.2, 9.3], [5.0, 31.0, -22.0], [-11.0, 8.0, -66.51]]) * 1e-3
TILTED = {"bias": [0.02, -0.02, 0.02], "tilt": 2.0 * ARCMIN}


def plan(**changes):
    return positions_table(THESIS_PLAN, **{"still_s": 10.0, "spin_s": 37.0, "move_s": 2.0, **changes})


def run(positions=None, rate_hz=20.0, settings=None, changes=None, **table):
    positions = positions if positions is not None else plan()
    imu = Turntable(LEVERS, **{**TILTED, **table}).record(positions, rate_hz)
    if changes:
        changes(imu)
    return calibrate(imu, positions, settings)


def test_spin_axis_is_a_unit_vector_and_the_printed_one_is_not():
    assert np.linalg.norm(spin_axis(0.7, 0.5)) == pytest.approx(1.0)
    assert np.linalg.norm(thesis.printed_axis(0.7, 0.5)) == pytest.approx(1.149, abs=1e-3)


@pytest.mark.parametrize("rate_hz", [20.0, 17.3])
def test_true_levers_come_back_exactly(rate_hz):
    result = run(rate_hz=rate_hz)
    for lever, true in zip(result.levers, LEVERS, strict=True):
        assert lever.rho == pytest.approx(true, abs=1e-9)
        assert lever.observable.all()
    assert result.tilt["1"] == pytest.approx(2.0 * ARCMIN, rel=1e-3)


def test_levers_of_skewed_accelerometers():
    e = np.array([[1.0, 0.1, 0.0], [0.0, 1.0, -0.2], [0.3, 0.0, 1.0], [1.0, 1.0, 1.0]])
    e /= np.linalg.norm(e, axis=1)[:, None]
    levers = np.vstack([LEVERS, [[0.01, 0.02, -0.03]]])
    positions = plan()
    time, A, w = Turntable(levers, e, bias=0.02, tilt=2 * ARCMIN).outputs(positions, 20.0)
    from schuler.calibration.stretches import stretches_of

    found = turntable.calibrate_outputs(
        time, A, w, stretches_of(positions, "turntable"), TurntableSettings(directions=e, origin=(0.1, 0.0, 0.0))
    )
    for lever, true in zip(found.levers, levers, strict=True):
        assert lever.rho == pytest.approx(true + [0.1, 0.0, 0.0], abs=1e-9)


def test_both_directions_cancel_the_earth_and_the_latitude_does_it_alone():
    lat = 50.0 * DEG
    both = run(latitude=lat)
    one_way = plan(both_ways=False)
    known = run(one_way, latitude=lat, settings=TurntableSettings(latitude=lat))
    left = run(one_way, latitude=lat)
    size = [
        np.max([np.abs(x.rho - t).max() for x, t in zip(r.levers, LEVERS, strict=True)]) for r in (both, known, left)
    ]
    assert size[0] < 1e-8
    assert size[1] < 1e-8
    assert size[2] == pytest.approx(2 * 7.292115e-5 * np.sin(lat) / (20 * DEG) * 0.06651, rel=0.05)
    assert any("one way" in n for n in left.notes)


def test_conditions_and_gains_of_the_corrected_positions():
    expected = [
        ((1.0, 2.236, 5.149), 7.39, (0.617, 1.414, 3.464), 5.78),
        ((1.414, 1.414, 3.742), 3.73, (1.155, 1.414, 2.828), 3.23),
        ((2.828, 2.915, 1.0), 4.53, (2.828, 2.345, 0.577), 5.79),
    ]
    result = run()
    for i, (three, cond3, five, cond5) in enumerate(expected):
        assert thesis.gains(i, thesis.USED[i])[0] == pytest.approx(three, abs=6e-4)
        assert thesis.gains(i, thesis.USED[i])[1] == pytest.approx(cond3, abs=5e-3)
        assert thesis.gains(i)[0] == pytest.approx(five, abs=6e-4)
        assert result.levers[i].condition == pytest.approx(cond5, abs=5e-3)


def test_printed_equations_give_wrong_levers():
    assert thesis.printed_third([-11.0, 8.0, -66.51]) == pytest.approx([-66.51, -39.25, -70.28], abs=5e-3)
    ranks = [np.linalg.matrix_rank(thesis.rows(i, thesis.PRINTED_PLAN)[list(thesis.USED[i])]) for i in range(2)]
    assert ranks == [2, 1]


def test_table_4_2_does_not_fit_twenty_degrees_a_second():
    for accelerometer, implied in ((0, (53.7, 54.0)), (2, (55.2, 55.4))):
        verdict = thesis.rate_verdict(accelerometer)
        assert implied[0] < verdict.implied[0] <= verdict.implied[1] < implied[1]
        assert verdict.step[0] < 1e-4
    assert thesis.rate_verdict(0).step[1] > 1e-4
    assert thesis.statistics(2).std_n == pytest.approx(0.1144, abs=1e-4)
    assert thesis.statistics(2).single == pytest.approx(0.204, abs=1e-3)


def scatter(runs):
    """Squared errors over the reported covariance: (runs, 3) for the three accelerometers."""
    positions, table = plan(), Turntable(LEVERS, noise=2e-3, **TILTED)
    nees, std, rho = [], [], []
    for k in range(runs):
        found = calibrate(table.record(positions, 10.0, run=k), positions, TurntableSettings(check=False))
        errors = [x.rho - t for x, t in zip(found.levers, LEVERS, strict=True)]
        nees.append([d @ np.linalg.solve(x.covariance, d) for x, d in zip(found.levers, errors, strict=True)])
        std.append([x.std for x in found.levers])
        rho.append(errors)
    return np.array(nees), np.array(std), np.array(rho)


def bounds(dof):
    from scipy.stats import chi2

    return chi2.ppf([0.5e-4, 1 - 0.5e-4], dof) / dof


def test_scatter_is_the_reported_covariance():
    nees, std, rho = scatter(25)
    low, high = bounds(nees.size * 3)
    assert low < nees.mean() / 3 < high * 1.05  # 120 degrees of freedom of the noise estimate: a few per cent


@pytest.mark.slow
def test_scatter_is_the_reported_covariance_over_500_runs():
    nees, std, rho = scatter(500)
    low, high = bounds(500 * 3)
    assert np.all(nees.mean(axis=0) / 3 > low)
    assert np.all(nees.mean(axis=0) / 3 < high * 1.05)
    assert rho.std(axis=0) / np.sqrt((std**2).mean(axis=0)) == pytest.approx(np.ones((3, 3)), abs=0.15)


# ---- what bad input gets ----


def keep(table, mask):
    return Table(table.name, {k: v[mask] for k, v in table.columns.items()})


def edit(table, **columns):
    return Table(table.name, {**table.columns, **columns})


def test_one_position_sees_one_component_of_two_accelerometers():
    positions = plan()
    result = run(keep(positions, positions["position"] == "1"))
    seen = [list(x.observable) for x in result.levers]
    assert seen == [[True, False, False], [False, False, False], [False, False, True]]
    assert result.levers[0].rho[0] == pytest.approx(LEVERS[0, 0], abs=1e-9)
    assert np.isnan(result.levers[0].rho[1])
    assert np.isinf(result.levers[0].condition)


def test_incomplete_turns():
    positions = plan()
    end = np.where(positions["kind"] == "spin", positions["start"] + 10.0, positions["end"])
    with pytest.raises(InputError, match="not a whole turn.*at least 18.0 s"):
        run(edit(positions, end=end))


def test_no_stops_and_no_spins():
    positions = plan()
    with pytest.raises(InputError, match='no row of kind "still"'):
        run(keep(positions, positions["kind"] == "spin"))
    with pytest.raises(InputError, match='no row of kind "spin"'):
        run(keep(positions, positions["kind"] == "still"))


def during(imu, positions, row):
    return (imu.time > positions["start"][row]) & (imu.time <= positions["end"][row])


def test_a_rate_that_was_not_held():
    positions = plan()

    def slow(imu):
        late = imu.time[during(imu, positions, 8)][-80:]
        rows = np.isin(imu.time, late)
        for a in "xyz":
            imu.columns[f"gyro_{a}"][rows] *= 0.9

    with pytest.raises(InputError, match="did not hold its rate"):
        run(positions, changes=slow)


def test_a_stop_that_was_not_still():
    positions = plan()

    def push(imu):
        imu.columns["gyro_y"][during(imu, positions, 3)] += 0.02

    with pytest.raises(InputError, match="still of position 1 .* was not still"):
        run(positions, changes=push)


def test_axes_swapped_or_flipped():
    def swap(imu):
        for s in ("gyro", "accel"):
            imu.columns[f"{s}_y"], imu.columns[f"{s}_z"] = imu.columns[f"{s}_z"], -imu.columns[f"{s}_y"]

    with pytest.raises(InputError, match=r"axes swapped or flipped.*fits if the recording's axes are \(x, -z, y\)"):
        run(changes=swap)

    def gyros_only(imu):
        for a in "xyz":
            imu.columns[f"gyro_{a}"] = -imu.columns[f"gyro_{a}"]

    with pytest.raises(InputError, match="opposite sense"):
        run(changes=gyros_only)


def test_a_saturated_accelerometer():
    def clip(imu):
        imu.columns["accel_x"] = np.minimum(imu.columns["accel_x"], 6.94)

    with pytest.raises(InputError, match="accelerometer x stays at its largest value.*saturated"):
        run(changes=clip, noise=2e-2)


def test_an_accelerometer_stuck_at_its_range():
    with pytest.raises(InputError, match="accelerometer x gives 5 m/s.2 in every row.*saturated"):
        run(changes=lambda imu: imu.columns.update(accel_x=np.minimum(imu.columns["accel_x"], 5.0)), noise=2e-3)


def test_unequal_spins_and_a_warming_sensor_are_noted():
    positions = plan()
    shorter = np.where(positions["rate"] < 0, positions["start"] + 19.0, positions["end"])
    result = run(edit(positions, end=np.where(positions["kind"] == "spin", shorter, positions["end"])))
    assert any("differ in length" in n for n in result.notes)

    def warm(imu):
        imu.columns["temperature"] = np.linspace(22.0, 31.0, len(imu))

    assert any("22." in n and "warm up" in n for n in run(changes=warm).notes)


def test_faults_of_the_positions_table_come_together():
    positions = plan()
    rate = positions["rate"].copy()
    rate[8] = 0.0
    kind = positions["kind"].copy()
    kind[0] = "stil"
    with pytest.raises(InputError) as error:
        run(edit(positions, rate=rate, kind=kind))
    assert "row 1" in str(error.value) and "row 9" in str(error.value)


def test_the_table_s_outside_is_told():
    positions = plan()
    with pytest.raises(InputError, match="lies outside the recording"):
        run(edit(positions, start=positions["start"] + np.where(positions["position"] == "5", 5000.0, 0.0),
                 end=positions["end"] + np.where(positions["position"] == "5", 5000.0, 0.0)),
            changes=lambda imu: imu.columns.update({k: v[: 20 * 900] for k, v in imu.columns.items()}))  # fmt: skip
