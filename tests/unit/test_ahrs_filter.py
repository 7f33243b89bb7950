"""The attitude filter: what it finds, what a gap, a bent field and a dead sensor do to it, batch against row by row."""

from dataclasses import replace
from math import inf, radians

import numpy as np
import pytest

from ahrs_motion import FIELD, PERFECT, SETTINGS, error_of, motion, record, wandering
from schuler.aiding.ahrs import AhrsFilter, AhrsSettings, attitude, navigate
from schuler.ground.errors import InputError
from schuler.ground.tables import Table

DEG = np.pi / 180.0
EVERY = replace(SETTINGS, output_rate=inf)


@pytest.fixture(scope="module")
def rec():
    return record(40.0, made=wandering(40.0, 3))


def rms(e):
    return float(np.sqrt(np.mean(np.sum(e**2, axis=1)))) / DEG


def test_perfect_sensors_give_the_truth():
    perfect = record(30.0, model=PERFECT, mag_std=0.0, made=motion(30.0))
    found = attitude(*perfect.arrays(), settings=SETTINGS)
    e = error_of(perfect, found)
    assert np.abs(e[len(e) // 3 :]).max() < 0.03 * DEG


def test_row_by_row_gives_the_same_numbers(rec):
    t, w, f, m = rec.arrays()
    batch = attitude(t, w, f, m, SETTINGS)
    nav = AhrsFilter(SETTINGS, interval=float(np.median(np.diff(t))))
    q, P, times = [], [], []
    for i in range(len(t)):
        nav.update(t[i], w[i], f[i], m[i])
        if nav.ready:
            times.append(nav.time)
            q.append(nav.q_nb)
            P.append(nav.cov_phi)
    assert np.array_equal(times, batch.time)
    assert np.array_equal(q, batch.q) and np.array_equal(P, batch.cov_phi)
    assert nav.rpy.shape == nav.gyro_bias.shape == (3,)


def test_a_row_has_seen_nothing_later(rec):
    t, w, f, m = rec.arrays()
    n = 1500
    whole, part = attitude(t, w, f, m, SETTINGS), attitude(t[:n], w[:n], f[:n], m[:n], SETTINGS)
    assert np.array_equal(whole.q[: len(part.time)], part.q)


def test_biases_are_learnt(rec):
    navigation, _ = navigate({"imu": rec.imu}, SETTINGS)
    for axis in "xyz":
        bias = navigation.states[f"gyro_bias_{axis}"]
        assert bias.std[-1] < 0.3 * bias.std[0]
        # the true bias: what the rates are too large against a filter-free count of the turn
    half = len(rec.time) // 2
    ideal = record(40.0, model=PERFECT, made=wandering(40.0, 3))
    true = (rec.imu.stack("gyro_x", "gyro_y", "gyro_z") - ideal.imu.stack("gyro_x", "gyro_y", "gyro_z"))[half:]
    for i, axis in enumerate("xyz"):
        bias = navigation.states[f"gyro_bias_{axis}"]
        assert abs(bias.value[-1] - true[:, i].mean()) < 4.0 * bias.std[-1] + 2e-4


def test_six_axes_know_tilt_as_well_and_say_that_the_heading_drifts(rec):
    nine, six = (navigate({"imu": r.imu}, EVERY)[1] for r in (rec, rec.six()))
    assert six.relative and not nine.relative
    a, b = error_of(rec, nine.filter)[2000:, :2], error_of(rec, six.filter, relative=True)[2000:, :2]
    assert abs(rms(a) - rms(b)) < 0.1
    heading = np.sqrt(six.filter.cov_phi[:, 2, 2])
    assert heading[0] < 0.2 * DEG and heading[-1] > 5.0 * heading[50]


def test_a_given_heading_starts_there(rec):
    s = replace(EVERY, start_heading=1.0, std_heading=0.5 * DEG)
    _, run = navigate({"imu": rec.six().imu}, s)
    assert not run.relative
    assert abs(run.filter.rpy[0, 2] - 1.0) < 5.0 * DEG  # it has turned since
    assert abs(np.sqrt(run.filter.cov_phi[0, 2, 2]) - 0.5 * DEG) < 0.1 * DEG


@pytest.mark.parametrize("gap", [0.5, 2.0])
def test_a_gap_widens_the_sigma_and_is_recovered_from(rec, gap):
    keep = (rec.time < 20.0) | (rec.time > 20.0 + gap)
    imu = rec.imu.where(keep)
    _, run = navigate({"imu": imu}, EVERY)
    e, t = error_of(rec, run.filter), run.filter.time
    sigma = np.sqrt(np.einsum("nii->ni", run.filter.cov_phi))
    before, after = np.searchsorted(t, 19.9), np.searchsorted(t, 20.0 + gap + 0.02)
    assert (sigma[after] > 3.0 * sigma[before]).all()
    assert (np.abs(e[after]) < 4.0 * sigma[after]).all()
    late = t > 32.0
    assert rms(e[late][:, :2]) < 0.6 and np.isfinite(sigma).all()
    assert np.isfinite(run.smoother.q).all() and rms(error_of(rec, run.smoother)[late][:, :2]) < 0.6


def test_rows_that_are_no_numbers(rec):
    t, w, f, m = (a.copy() for a in rec.arrays())
    w[1000:1003] = np.nan
    m[500:600] = np.nan
    nav = AhrsFilter(SETTINGS, interval=0.01)
    for i in range(1500):
        nav.update(t[i], w[i], f[i], m[i])
    assert np.isfinite(nav.q_nb).all() and np.isfinite(nav.cov_phi).all()
    clean = attitude(*(a[:1500] for a in rec.arrays()), settings=SETTINGS)
    turn = 2.0 * np.arccos(min(1.0, abs(float(nav.q_nb @ clean.q[-1]))))
    assert turn < 1.5 * DEG


def bent(rec, start, end, extra):
    """The field with something magnetic near from start to end, s: it turns the heading while size and dip change."""
    near = (rec.time > start) & (rec.time < end)
    shift = np.einsum("nji,j->ni", rec.C, extra) * near[:, None]
    columns = {f"mag_{a}": rec.imu[f"mag_{a}"] + shift[:, i] for i, a in enumerate("xyz")}
    return rec.changed(**columns)


def test_a_bent_field_is_distrusted_and_forgotten(rec):
    extra = np.array([0.0, 12e-6, 10e-6])
    disturbed = bent(rec, 15.0, 25.0, extra)
    _, aware = navigate({"imu": disturbed.imu}, EVERY)
    _, blind = navigate({"imu": disturbed.imu}, replace(EVERY, bend=0.0))
    t = aware.filter.time
    near, after = (t > 15.0) & (t < 25.0), t > 33.0
    worst = [np.abs(error_of(rec, r.filter)[near, 2]).max() for r in (aware, blind)]
    would_be = np.arctan2(extra[1], FIELD[0])
    assert worst[0] < 6.0 * DEG and worst[1] > 2.0 * worst[0] and would_be > 30.0 * DEG
    assert np.abs(error_of(rec, aware.filter)[after, 2]).max() < 6.0 * DEG
    # the tilt is never taken from the field
    tilts = [error_of(rec, r.filter)[:, :2] for r in (aware, navigate({"imu": rec.imu}, EVERY)[1])]
    assert abs(rms(tilts[0]) - rms(tilts[1])) < 0.02


def test_a_field_that_stays_bent_is_not_shut_out_for_good(rec):
    """Where the field changes for good (another room), size and dip are learnt anew and the heading follows."""
    turned = rec.changed(
        **{f"mag_{a}": v for a, v in zip("xyz", _with_field(rec, np.array([0.0, 19e-6, 45e-6]), 10.0).T, strict=True)}
    )
    _, run = navigate({"imu": turned.imu}, EVERY)
    e = error_of(rec, run.filter)[run.filter.time > 38.0, 2]
    assert (np.abs(e) > 60.0 * DEG).all()  # the heading is the new field's, 90 deg away


def _with_field(rec, field, start):
    m = rec.imu.stack("mag_x", "mag_y", "mag_z")
    other = np.einsum("nji,j->ni", rec.C, field)
    return np.where((rec.time > start)[:, None], other, m)


def test_a_magnetometer_that_comes_and_goes(rec):
    m = rec.imu.stack("mag_x", "mag_y", "mag_z")
    m[(rec.time < 5.0) | (np.arange(len(m)) % 10 != 0)] = np.nan  # late, and at a tenth of the rate
    other = rec.changed(**{f"mag_{a}": m[:, i] for i, a in enumerate("xyz")})
    navigation, run = navigate({"imu": other.imu}, EVERY)
    assert run.filter.time[0] > 5.0 and any("attitude begins" in n for n in navigation.notes)
    assert rms(error_of(rec, run.filter)[1500:]) < 4.0
    assert np.isfinite(run.smoother.cov_phi).all()


@pytest.mark.parametrize(
    ("value", "said"), [(0.0, "reads nothing or zero"), (np.nan, "reads nothing or zero"), (2e-5, "it is stuck")]
)
def test_a_dead_magnetometer_is_left_out(rec, value, said):
    dead = rec.changed(**{f"mag_{a}": np.full(len(rec.time), value) for a in "xyz"})
    navigation, run = navigate({"imu": dead.imu}, SETTINGS)
    assert run.relative and any(said in n for n in navigation.notes)
    plain, _ = navigate({"imu": rec.six().imu}, SETTINGS)
    assert np.array_equal(plain.filter.rpy, navigation.filter.rpy)


def test_smoother_is_the_filter_at_the_end_and_better_before(rec):
    _, run = navigate({"imu": rec.imu}, EVERY)
    np.testing.assert_allclose(run.smoother.q[-1], run.filter.q[-1], atol=1e-9)
    early = (run.filter.time > 1.0) & (run.filter.time < 20.0)
    assert rms(error_of(rec, run.smoother)[early]) < 0.7 * rms(error_of(rec, run.filter)[early])
    a, b = (np.einsum("nii->n", x.cov_phi) for x in (run.filter, run.smoother))
    assert (b[early] < 1.001 * a[early]).all()


def test_increments_are_rates_times_the_interval(rec):
    columns = {"time": rec.time}
    dt = np.diff(rec.time, prepend=0.0)
    for a in "xyz":
        columns |= {f"dtheta_{a}": rec.imu[f"gyro_{a}"] * dt, f"dv_{a}": rec.imu[f"accel_{a}"] * dt}
        columns |= {f"mag_{a}": rec.imu[f"mag_{a}"]}
    one, _ = navigate({"imu": rec.imu}, SETTINGS)
    other, _ = navigate({"imu": Table("imu", columns, "increments")}, SETTINGS)
    np.testing.assert_allclose(other.filter.rpy, one.filter.rpy, atol=1e-9)


def test_rows_come_at_the_rate_that_is_asked_for(rec):
    for rate in (1.0, 10.0, 25.0):
        navigation, _ = navigate({"imu": rec.imu}, replace(SETTINGS, output_rate=rate))
        assert abs(np.median(np.diff(navigation.filter.time)) - 1.0 / rate) < 0.011
    navigation, _ = navigate({"imu": rec.imu}, EVERY)
    assert len(navigation.filter) > len(rec.time) - 30


def test_bad_input_gets_a_sentence(rec):
    t, w, f, m = rec.arrays()
    with pytest.raises(InputError, match="one row of three"):
        attitude(t, w[:-1], f, m)
    with pytest.raises(InputError, match="fewer than two"):
        attitude(t[:1], w[:1], f[:1])
    with pytest.raises(InputError, match="above 0"):
        AhrsFilter(interval=0.0)
    nav = AhrsFilter(AhrsSettings(), interval=0.01)
    nav.update(1.0, w[0], f[0])
    with pytest.raises(InputError, match="rows go forward"):
        nav.update(0.5, w[0], f[0])
    with pytest.raises(InputError, match="three numbers each"):
        nav.update(1.1, w[0], f[0], (1.0, 2.0))
    with pytest.raises(InputError, match="too short"):
        navigate({"imu": rec.imu.where(rec.time < 0.1)}, SETTINGS)
    assert not nav.update(1.1, (np.nan, 0.0, 0.0), f[0])


def test_a_free_fall_leaves_the_attitude_to_the_gyros(rec):
    """No specific force for two seconds: nothing levels, nothing breaks."""
    t, w, f, m = (a.copy() for a in rec.arrays())
    f[(t > 20.0) & (t < 22.0)] = 0.0
    found = attitude(t, w, f, m, SETTINGS)
    e = error_of(rec, found)[found.time > 20.0]
    assert np.isfinite(e).all() and np.abs(e[:, :2]).max() < radians(25.0)
    assert np.abs(e[-1, :2]).max() < radians(3.0)
