"""The paper's filter: its equations at one epoch, its outage policies, its dead reckoning, what it refuses."""

from dataclasses import replace

import numpy as np
import pytest

from schuler.aiding import paper
from schuler.aiding.paper import LITERAL_DEFECTS, PaperSettings, navigate_paper
from schuler.ground import frames
from schuler.ground.earth import WGS84, wrap_pi
from schuler.ground.errors import InputError, SchulerError
from schuler.ground.tables import Table
from schuler.kernels import paper as kernel
from schuler.truth.instruments import GARMIN_16_HVS, IMUS
from schuler.truth.missions import AuvMission, Waves
from schuler.truth.recording import SUITES, simulate

DEG = np.pi / 180.0
X = np.radians([5.0, -8.0, 60.0, 0.2, -0.1, -0.053])
U = np.array([0.02, -0.01, 0.03])
P = np.diag(np.radians([2.0, 2.0, 3.0, 0.1, 0.1, 0.05]) ** 2)
DT = 0.01
Q = np.diag([(0.03 * DEG) ** 2 * DT] * 3 + [(2e-4 * DEG) ** 2 * DT] * 3)
R = np.diag(np.radians([20.0, 20.0, 3.0]) ** 2)
H = np.eye(3, 6)


# ---- one epoch ------------------------------------------------------------------------------------------------------


def test_rates_and_jacobian_have_the_digits_of_the_recomputation():
    np.testing.assert_allclose(paper.state_rates(X, U)[:3], [0.01228076, -0.01091855, 0.03038359], atol=5e-9)
    A = paper.jacobian(X, U)
    np.testing.assert_allclose(A[0], [0.001534503, 0.030682192, 0, -1, 0.012248941, 0.140006034], atol=6e-10)
    np.testing.assert_allclose(A[1], [-0.030087903, 0, 0, 0, -0.996194698, 0.087155743], atol=6e-10)
    np.testing.assert_allclose(A[2], [-0.011025856, -0.004270136, 0, 0, -0.088012272, -1.005984874], atol=6e-10)
    assert not A[3:].any()


def test_first_row_of_the_jacobian_is_the_printed_one():
    """(18)-(23), typed as they are printed."""
    x, u = X, U
    A_11 = ((u[1] - x[4]) * np.cos(x[0]) - (u[2] - x[5]) * np.sin(x[0])) * np.tan(x[1])
    A_12 = ((u[1] - x[4]) * np.sin(x[0]) + (u[2] - x[5]) * np.cos(x[0])) * (1.0 + np.tan(x[1]) ** 2)
    printed = [A_11, A_12, 0.0, -1.0, -np.sin(x[0]) * np.tan(x[1]), -np.cos(x[0]) * np.tan(x[1])]
    np.testing.assert_allclose(paper.jacobian(x, u)[0], printed, rtol=1e-14)


def test_levelling_returns_the_attitude_of_a_vehicle_at_rest():
    rest = frames.dcm_from_euler(*X[:3]).T @ np.array([0.0, 0.0, -9.80])
    np.testing.assert_allclose(rest, [-1.36389639, -0.84581398, -9.66769804], atol=5e-9)
    np.testing.assert_allclose(paper.levelling(rest), X[:2], atol=1e-15)
    np.testing.assert_allclose(paper.levelling(rest, literal=True), X[:2], atol=1e-15)
    np.testing.assert_allclose(kernel.level(*rest, 9.80, False), X[:2], atol=1e-15)
    np.testing.assert_allclose(kernel.level(*rest, 9.80, True), X[:2], atol=1e-15)


def test_printed_levelling_fails_where_the_corrected_one_does_not():
    for roll in (170.0, -120.0):
        rest = frames.dcm_from_euler(roll * DEG, 0.1, 0.0).T @ np.array([0.0, 0.0, -9.80])
        assert paper.levelling(rest)[0] == pytest.approx(roll * DEG)
        assert abs(paper.levelling(rest, literal=True)[0] - roll * DEG) == pytest.approx(np.pi)
    pushed = np.array([9.9, 0.0, -1.0])
    assert np.isnan(paper.levelling(pushed, literal=True)[1])
    assert np.isnan(kernel.level(*pushed, 9.80, True)[1])
    assert np.isfinite(paper.levelling(pushed)).all()
    assert paper.levelling(1.03 * pushed) == pytest.approx(paper.levelling(pushed))  # free of scale


def test_one_filter_step_has_the_digits_of_the_recomputation():
    x, C = paper.predict(X, P, U, DT, Q)
    x, C = paper.update(x, C, np.radians([0.5, -0.3, 2.0]), H, R)
    expected = [8.74748282e-2, -1.39787694e-1, 1.06495469, 3.49065634e-3, -1.74534500e-3, -9.25073228e-4]
    np.testing.assert_allclose(x, expected, rtol=6e-9)
    np.testing.assert_allclose(np.sqrt(np.diag(C)[:3]) / DEG, [1.99010717, 1.99007693, 2.12132089], atol=6e-9)
    np.testing.assert_allclose(np.sqrt(np.diag(C)[3:]) / DEG, [0.1, 0.1, 0.05], atol=1e-5)


def test_printed_transition_collapses_every_sigma_a_hundredfold_in_one_step():
    _, C = paper.predict(X, P, U, DT, Q, literal=True)
    np.testing.assert_allclose(np.sqrt(np.diag(C)[:3]) / DEG, [0.02028818, 0.02025726, 0.03015488], atol=6e-9)
    np.testing.assert_allclose(paper.transition(np.zeros((6, 6)), DT, literal=True), DT * np.eye(6))
    np.testing.assert_allclose(paper.transition(np.zeros((6, 6)), DT), np.eye(6))


def test_joseph_form_equals_the_short_form_for_the_optimal_gain():
    C = paper.predict(X, P, U, DT, Q)[1]
    K = C @ H.T @ np.linalg.inv(H @ C @ H.T + R)
    np.testing.assert_allclose(
        paper.update(X, C, np.zeros(3), H, R)[1], (np.eye(6) - K @ H) @ C, rtol=1e-12, atol=1e-18
    )


def test_considered_states_keep_mean_and_variance_and_no_less_than_the_optimum_remains():
    C = paper.predict(X, P, U, DT, Q)[1]
    for _ in range(200):
        C = paper.predict(X, C, U, DT, Q)[1]
    y = np.radians([3.0, -2.0])
    x_best, best = paper.update(X, C, y, H[:2], R[:2, :2])
    x_kept, kept = paper.update(X, C, y, H[:2], R[:2, :2], considered=(2, 5))
    assert x_kept[2] == X[2] and x_kept[5] == X[5] and x_best[5] != X[5]
    np.testing.assert_allclose([kept[2, 2], kept[5, 5]], [C[2, 2], C[5, 5]], rtol=1e-14)
    assert np.linalg.eigvalsh(kept - best).min() > -1e-16  # the optimal gain is optimal
    assert np.linalg.eigvalsh(kept).min() > 0.0


def test_course_is_clockwise_from_north():
    assert paper.course([1.0, 0.0]) == 0.0
    assert paper.course([0.0, 2.0, 0.3]) == pytest.approx(np.pi / 2)
    assert paper.course([-1.0, -1e-9]) == pytest.approx(-np.pi)
    assert kernel.wrap(-np.pi) == pytest.approx(np.pi)
    assert kernel.wrap(2.5 * np.pi) == pytest.approx(0.5 * np.pi)


# ---- whole recordings -----------------------------------------------------------------------------------------------

QUIET_IMU = replace(
    IMUS["3dm-gx3-25"], gyro_arw_deg_per_sqrt_h=0.0, accel_vrw_mps_per_sqrt_h=0.0, gyro_instability_deg_per_h=0.0,
    gyro_bias_deg_per_h=0.0, accel_bias_ug=0.0, published=frozenset(),
)  # fmt: skip
QUIET = replace(
    SUITES["paper-test-1"],
    imu=QUIET_IMU,
    gnss=replace(GARMIN_16_HVS, white_m=(1e-6,) * 3, correlated_m=(0.0,) * 3, velocity_mps=1e-6, published=frozenset()),
    speed=replace(SUITES["paper-test-1"].speed, noise_kn=0.0, published=frozenset()),
)
CALM = AuvMission(
    surface=60.0, dive=120.0, surface_speed=2.5, final_surface=10.0, turns=(), speed_steps=(), pitch=0.0,
    waves=Waves.none(),
)  # fmt: skip


@pytest.fixture(scope="module")
def noisy():
    """The paper's instruments on a short mission that heads south, where the course jumps between +180 and -180 deg."""
    mission = AuvMission(surface=80.0, dive=100.0, heading=np.pi, turns=(), speed_steps=(), final_surface=20.0)
    return simulate(mission, SUITES["paper-test-1"], seed=3)


def heading_error(navigation, recording):
    truth = recording.truth
    heading = np.interp(navigation.filter.time, truth.time, np.unwrap(truth["heading"]))
    return wrap_pi(navigation.filter.rpy[:, 2] - heading)


@pytest.fixture(scope="module")
def by_policy(noisy):
    """Navigations of the noisy recording, every policy, all epochs."""
    return {p: navigate_paper(noisy.tables, PaperSettings(outage_policy=p)) for p in paper.POLICIES}


def test_heading_innovation_is_wrapped(noisy, by_policy):
    course = by_policy["paper"].innovations["gnss_course"]
    assert np.abs(course.value).max() < 15.0 * DEG
    assert np.abs(heading_error(by_policy["paper"], noisy)).max() < 12.0 * DEG
    raw = navigate_paper(noisy.tables, PaperSettings(literal=True)).innovations["gnss_course"]
    assert np.abs(raw.value).max() > 300.0 * DEG  # as printed it is not


@pytest.mark.parametrize(
    ("policy", "still"), [("paper", True), ("consider", True), ("drop", False), ("zero-free", False)]
)
def test_frozen_bias_is_constant_through_the_outage(by_policy, policy, still):
    bias = by_policy[policy].states["gyro_bias_z"]
    dive = (bias.time > 82.0) & (bias.time < 180.0)
    assert (np.ptp(bias.value[dive]) == 0.0) == still
    assert np.ptp(by_policy[policy].states["gyro_bias_x"].value[dive]) > 0.0


def test_zero_innovation_makes_the_filter_believe_itself(by_policy):
    """The row with innovation zero drives sigma to 0.37 deg, 0.47 after 100 s; without the row sigma has grown."""
    sigma = {p: np.sqrt(n.filter.cov_rpy[n.filter.time <= 180.0][-1, 2, 2]) / DEG for p, n in by_policy.items()}
    for policy in ("paper", "zero-free", "held-course"):
        assert sigma[policy] == pytest.approx(0.47, abs=0.01)
    assert sigma["drop"] > 1.5 and sigma["consider"] > 1.5


def test_considering_gives_the_track_of_the_papers_policy_with_another_sigma(by_policy):
    a, b = by_policy["paper"].filter, by_policy["consider"].filter
    dive = a.time < 180.0
    assert np.abs(wrap_pi(a.rpy[dive] - b.rpy[dive])).max() < 0.1 * DEG


def test_first_course_after_surfacing_repairs_an_honest_heading_only(noisy, by_policy):
    """The gain is P/(P + R): small after the zero innovation, near one where the sigma has grown."""
    for policy, low, high in (("paper", 0.0, 0.06), ("consider", 0.3, 1.0)):
        navigation = by_policy[policy]
        course = navigation.innovations["gnss_course"]
        first = int(np.flatnonzero(course.time > 180.0)[0])
        track = navigation.filter
        k = int(np.searchsorted(track.time, course.time[first] - 1e-9))
        moved = float(wrap_pi(track.rpy[k, 2] - track.rpy[k - 1, 2]))
        assert low < moved / course.value[first, 0] < high, policy


def test_covariances_stay_symmetric_and_positive(by_policy):
    for navigation in by_policy.values():
        for covariance in (navigation.filter.cov_rpy, navigation.filter.cov_pos, navigation.filter.cov_vel):
            np.testing.assert_array_equal(covariance, covariance.transpose(0, 2, 1))
            assert np.linalg.eigvalsh(covariance).min() > 0.0


def test_exact_sensors_give_exact_dead_reckoning_at_any_depth():
    recording = simulate(CALM.with_changes(height=-3000.0), QUIET)
    track = navigate_paper(recording.tables, PaperSettings(rate=1.0, earth_rate=True)).filter
    end = int(np.flatnonzero(track.time <= 180.0)[-1])
    R_N, R_E = WGS84.radii(track.lat[end])
    at = {name: np.interp(track.time[end], recording.truth.time, recording.truth[name]) for name in ("lat", "lon")}
    north = (R_N - 3000.0) * (track.lat[end] - at["lat"])
    east = (R_E - 3000.0) * np.cos(track.lat[end]) * (track.lon[end] - at["lon"])
    assert abs(north) < 0.05 and abs(east) < 0.05
    assert track.height[end] == pytest.approx(-3000.0, abs=1.0)


def test_printed_radii_cost_depth_over_radius():
    """h left out of (37): 300 m under water at 3000 m depth come out 300 * 3000 / R too short."""
    recording = simulate(CALM.with_changes(height=-3000.0), QUIET)
    ends = {}
    for literal in (False, True):
        settings = PaperSettings(rate=1.0, literal=literal, outage_policy="drop")
        track = navigate_paper(recording.tables, settings).filter
        ends[literal] = (
            track.lon[np.flatnonzero(track.time <= 180.0)[-1]] - track.lon[np.flatnonzero(track.time <= 60.0)[-1]]
        )
    R_E = float(WGS84.radii(CALM.lat)[1])
    assert ends[True] / ends[False] - 1.0 == pytest.approx(-3000.0 / R_E, abs=5e-5)


def test_a_current_is_missed_in_full_and_turns_the_heading_by_the_crab_angle():
    recording = simulate(CALM.with_changes(current=(0.0, 0.2)), QUIET)
    track = navigate_paper(recording.tables, PaperSettings(rate=1.0, earth_rate=True)).filter
    end = int(np.flatnonzero(track.time <= 180.0)[-1])
    lon = np.interp(track.time[end], recording.truth.time, recording.truth["lon"])
    east = WGS84.radii(track.lat[end])[1] * np.cos(track.lat[end]) * (track.lon[end] - lon)
    assert east == pytest.approx(-0.2 * 120.0, abs=0.5)  # the hold of the last fix knows the current for 1.5 s
    cross = simulate(CALM.with_changes(current=(0.25, 0.0)), QUIET)
    track = navigate_paper(cross.tables, PaperSettings(rate=1.0, earth_rate=True)).filter
    assert track.rpy[50, 2] == pytest.approx(np.arctan2(2.5, 0.25), abs=0.1 * DEG)


def test_earth_rate_goes_into_the_bias_unless_it_is_subtracted():
    recording = simulate(CALM.with_changes(surface=300.0, dive=60.0), QUIET)
    true = recording.truth_states["gyro_bias_z"][1][0]
    down = -7.292115e-5 * np.sin(CALM.lat)
    for subtracted, expected in ((False, true + down), (True, true)):
        bias = navigate_paper(recording.tables, PaperSettings(rate=1.0, earth_rate=subtracted)).states["gyro_bias_z"]
        assert bias.value[299] == pytest.approx(expected, abs=abs(down) / 20.0)


def test_position_sigma_grows_with_the_dive_and_holds_the_heading_error():
    recording = simulate(CALM, QUIET)
    track = navigate_paper(recording.tables, PaperSettings(rate=1.0, outage_policy="consider")).filter
    sigma = np.sqrt(track.cov_pos[:, 0, 0])  # north is across the track
    assert np.all(np.diff(sigma[63:179]) > 0.0)
    heading = np.sqrt(track.cov_rpy[61:180, 2, 2])
    assert sigma[179] == pytest.approx(np.hypot(2.5 * heading.sum(), 2.2), rel=0.05)
    assert sigma[185] < 3.0  # the next fix


def test_a_row_has_seen_nothing_later_than_itself(noisy):
    cut = 120.0
    tables = {name: table.where(table.time <= cut) for name, table in noisy.tables.items()}
    whole = navigate_paper(noisy.tables, PaperSettings()).filter
    part = navigate_paper(tables, PaperSettings()).filter
    for name in ("time", "lat", "lon", "height", "v_n", "rpy", "cov_pos", "cov_vel", "cov_rpy"):
        np.testing.assert_array_equal(getattr(part, name), getattr(whole, name)[: len(part)])


def test_increments_are_read_as_the_rates_they_are(noisy):
    imu = noisy.tables["imu"]
    dt = 0.01
    columns = {"time": imu.time}
    for axis in "xyz":
        columns[f"dtheta_{axis}"] = imu[f"gyro_{axis}"] * dt
        columns[f"dv_{axis}"] = imu[f"accel_{axis}"] * dt
    tables = {**noisy.tables, "imu": Table("imu", columns, kind="increments")}
    a, b = (
        navigate_paper(noisy.tables, PaperSettings(rate=1.0)).filter,
        navigate_paper(tables, PaperSettings(rate=1.0)).filter,
    )
    np.testing.assert_allclose(a.rpy, b.rpy, atol=1e-9)
    np.testing.assert_allclose(a.lat, b.lat, atol=1e-13)


def test_output_rate_gives_the_same_rows_as_all_epochs(noisy):
    every, some = (navigate_paper(noisy.tables, PaperSettings(rate=r)).filter for r in (None, 10.0))
    assert len(every) == 19901 and len(some) == 1991  # 1 to 200 s
    rows = np.searchsorted(every.time, some.time)
    np.testing.assert_array_equal(every.rpy[rows], some.rpy)
    assert some.time[0] == every.time[0] and some.time[-1] == every.time[-1]


def test_a_given_start_is_taken(noisy):
    lat, lon = noisy.truth["lat"][0], noisy.truth["lon"][0]
    settings = PaperSettings(start_time=0.0, start_lat=lat, start_lon=lon, start_heading=np.pi, rate=1.0)
    navigation = navigate_paper(noisy.tables, settings)
    assert navigation.filter.time[0] == pytest.approx(0.01)
    assert abs(wrap_pi(navigation.filter.rpy[0, 2] - np.pi)) < 0.1 * DEG
    assert navigation.filter.lat[0] == pytest.approx(lat, abs=1e-8)
    assert any("as given" in note for note in navigation.notes)


def test_slow_fixes_give_no_course(noisy):
    gnss = noisy.tables["gnss"]
    columns = dict(gnss.columns)
    slow = (gnss.time > 40.0) & (gnss.time < 60.0)
    for name in ("v_north", "v_east"):
        columns[name] = np.where(slow, 0.01, columns[name])
    navigation = navigate_paper({**noisy.tables, "gnss": Table("gnss", columns)}, PaperSettings(rate=1.0))
    course = navigation.innovations["gnss_course"].time
    assert not ((course > 40.0) & (course < 60.0)).any()
    assert ((navigation.innovations["gnss_position"].time > 40.0) & (course.max() > 60.0)).any()
    assert any("gave no course" in note for note in navigation.notes)


def test_literal_method_says_what_it_keeps_and_is_of_no_use(noisy):
    navigation = navigate_paper(noisy.tables, PaperSettings(literal=True, rate=1.0))
    for defect in LITERAL_DEFECTS:
        assert any(defect in note for note in navigation.notes)
    sigma = np.sqrt(navigation.filter.cov_rpy[50, 2, 2]) / DEG
    assert sigma == pytest.approx(0.003, abs=0.0005)  # sqrt(Q) of one step, whatever was known before
    assert np.abs(navigation.states["gyro_bias_z"].value).max() < 0.01 * DEG  # -0.053 deg/s is never learnt


# ---- what it refuses ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("missing", ["imu", "gnss", "speed"])
def test_a_missing_table_is_named(noisy, missing):
    tables = {name: table for name, table in noisy.tables.items() if name != missing}
    with pytest.raises(InputError, match=f'needs a table "{missing}"'):
        navigate_paper(tables, PaperSettings())


def test_fixes_without_velocity_are_refused(noisy):
    gnss = noisy.tables["gnss"]
    columns = {name: values for name, values in gnss.columns.items() if not name.startswith("v_")}
    with pytest.raises(InputError, match="v_north"):
        navigate_paper({**noisy.tables, "gnss": Table("gnss", columns)}, PaperSettings())


def test_no_course_anywhere_is_refused(noisy):
    gnss = noisy.tables["gnss"]
    columns = {**gnss.columns, "v_north": np.zeros(len(gnss)), "v_east": np.zeros(len(gnss))}
    with pytest.raises(InputError, match="starts at a fix with a course"):
        navigate_paper({**noisy.tables, "gnss": Table("gnss", columns)}, PaperSettings())


def test_rows_that_are_not_finite_or_out_of_order_are_refused(noisy):
    imu = noisy.tables["imu"]
    broken = imu["gyro_x"].copy()
    broken[7] = np.nan
    with pytest.raises(InputError, match="1 rows that are not finite"):
        navigate_paper(
            {**noisy.tables, "imu": Table("imu", {**imu.columns, "gyro_x": broken}, "rates")}, PaperSettings()
        )
    time = imu.time.copy()
    time[100] = time[99]
    with pytest.raises(InputError, match="does not increase"):
        navigate_paper({**noisy.tables, "imu": Table("imu", {**imu.columns, "time": time}, "rates")}, PaperSettings())


def test_divergence_is_an_error_and_not_a_nan(noisy):
    imu = noisy.tables["imu"]
    wild = {**imu.columns, "gyro_x": imu["gyro_x"] + 1e300}
    with pytest.raises(SchulerError, match="diverged"):
        navigate_paper({**noisy.tables, "imu": Table("imu", wild, "rates")}, PaperSettings())


def test_an_unknown_policy_is_answered_with_the_known_ones(noisy):
    with pytest.raises(InputError, match="paper, zero-free, drop, consider"):
        navigate_paper(noisy.tables, PaperSettings(outage_policy="freeze"))
