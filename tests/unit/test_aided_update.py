"""How kind "aided" takes a measurement in: against the textbook's joint update, gates, nobody locked out, open loop,
sensors of the caller's own."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import chi2

from schuler.aiding.aided import navigate
from schuler.aiding.aided_engine import Engine, StartState
from schuler.aiding.aided_sensors import Sensor, State
from schuler.aiding.aided_settings import AidedSettings, Start, layout_of
from schuler.ground.errors import InputError
from schuler.ground.tables import Table
from schuler.kernels import aided_measure as m
from schuler.kernels import aided_state as k
from schuler.kernels import aided_update as u
from schuler.kernels.aided_run import measure, vehicle_constraints

BIASES = ("gyro_bias", "accel_bias")
QUIET = AidedSettings(estimate=BIASES)


def covariance(rng, n, smallest=1e-3):
    A = rng.normal(size=(n, n))
    sd = 10.0 ** rng.uniform(-3, 2, n)
    P = A @ A.T / n + smallest * np.eye(n)
    return P * np.outer(sd, sd)


def joint(P, H, r, R):
    """Textbook: K, error estimate, Joseph form."""
    S = H @ P @ H.T + R
    K = np.linalg.solve(S, H @ P).T
    I_KH = np.eye(len(P)) - K @ H
    return K @ r, I_KH @ P @ I_KH.T + K @ R @ K.T


@pytest.mark.parametrize("rows", [1, 2, 3])
def test_scalars_one_by_one_are_the_joint_update(rows):
    for seed in range(30):
        rng = np.random.default_rng(seed)
        n = int(rng.integers(4, 30))
        P = covariance(rng, n)
        H = rng.normal(size=(rows, n)) * (rng.random((rows, n)) < 0.6) / np.sqrt(np.diag(P))
        r, R = rng.normal(size=rows), np.diag(10.0 ** rng.uniform(-2, 1, rows))
        d, got = np.zeros(n), P.copy()
        for a in range(rows):
            u.scalar_update(got, d, H[a], r[a], R[a, a])
        wanted_d, wanted = joint(P, H, r, R)
        sd = np.sqrt(np.diag(P))
        np.testing.assert_allclose(d / sd, wanted_d / sd, atol=1e-9)
        np.testing.assert_allclose(got / np.outer(sd, sd), wanted / np.outer(sd, sd), atol=1e-9)
        np.testing.assert_allclose(got, got.T, rtol=0, atol=1e-14 * P.max())


@pytest.mark.parametrize("rows", [1, 2, 3])
def test_nis_and_innovation_covariance_are_the_textbooks(rows):
    rng = np.random.default_rng(rows)
    P, H, R = covariance(rng, 12), rng.normal(size=(rows, 12)), rng.uniform(0.1, 2, rows)
    S, y = np.zeros((3, 3)), rng.normal(size=3)
    u.innovation_covariance(P, H, R, 0, rows, S)
    np.testing.assert_allclose(S[:rows, :rows], H @ P @ H.T + np.diag(R), rtol=1e-12)
    wanted = y[:rows] @ np.linalg.solve(S[:rows, :rows], y[:rows])
    assert u.nis_of(S, y, rows) == pytest.approx(wanted, rel=1e-9)


def test_the_gates_are_those_of_chi_square():
    for limit, dof in ((u.LIMIT1, 1), (u.LIMIT2, 2), (u.LIMIT3, 3)):
        assert limit == pytest.approx(chi2.ppf(0.999, dof), abs=0.01)


# ---- gates -------------------------------------------------------------------------------------------------------


def filter_at(sigma=1.0, time=1000.0, settings=QUIET):
    """A filter that has run for long, at 50 N 30 E, whose position is known to sigma m."""
    e = Engine(settings, layout_of(settings, settings.estimate), 0.01)
    cov = np.diag([1e-4] * 3 + [1e-2] * 3 + [sigma**2] * 3)
    e.begin(StartState(0.0, np.array([1.0, 0, 0, 0]), np.zeros(3), 0.87, 0.52, 100.0, cov, level_from_force=False))
    e.x[k.T] = e.x[k.TSEEN] = time
    return e


def fix(e, north=0.0, east=0.0, up=np.nan, sigma=1.0):
    z = np.full(12, np.nan)
    z[0], z[1] = e.x[k.LAT] + north / e.x[k.RN], e.x[k.LON] + east / (e.x[k.RE] * e.x[k.CLAT])
    z[2] = e.x[k.HGT] + up
    z[3:6] = sigma
    return z


def taken(e, kind, z):
    out = np.full((2, u.INNOVATION), np.nan)
    n = e.layout.n
    measure(e.x, e.P, e.layout.ie, e.c, e.dx, e.ring, e.world, kind, z, np.zeros((3, n)), np.zeros(3), np.zeros(3), out)
    return out


def north_of(e, lat=0.87):
    return (e.x[k.LAT] - lat) * e.x[k.RN]


def test_a_fix_inside_the_bound_is_taken_whole_one_beyond_it_pulls_no_harder():
    pulls = []
    for away in (1.0, 5.0, 5.3, 10.0, 20.0, 26.0):
        e = filter_at()
        out = taken(e, m.POSITION, fix(e, away))
        nis = away**2 / 2.0
        assert out[0, 6] == pytest.approx(nis, rel=1e-6) and out[0, 0] == pytest.approx(away, rel=1e-6)
        if nis <= u.LIMIT2:
            assert (out[0, 8], out[0, 9]) == (1.0, u.TAKEN)
            assert north_of(e) == pytest.approx(away / 2, rel=1e-6)
        else:
            assert out[0, 9] == u.WEAKENED and out[0, 8] == pytest.approx(u.LIMIT2 / nis, rel=1e-6)
            pulls.append(north_of(e))
    assert len(pulls) >= 3 and max(pulls) <= 5.3 / 2 and np.all(np.diff(pulls) < 0)


def test_a_wild_fix_is_refused_and_leaves_no_trace():
    e = filter_at()
    P, x = e.P.copy(), e.x.copy()
    out = taken(e, m.POSITION, fix(e, 50.0))
    assert (out[0, 8], out[0, 9]) == (0.0, u.REFUSED)
    np.testing.assert_array_equal(e.P, P)
    np.testing.assert_array_equal(e.x[: k.NOMINAL], x[: k.NOMINAL])
    assert e.x[k.BADH] == 1000.0


def test_without_gates_everything_is_believed():
    e = filter_at(settings=replace(QUIET, gate=False))
    assert taken(e, m.POSITION, fix(e, 500.0))[0, 9] == u.TAKEN and north_of(e) == pytest.approx(250.0, rel=1e-4)


def until_believed(e, north, east, step, most=1000):
    """Seconds of constant fixes until one is taken whole, how far off it leaves the filter, and how it was taken."""
    z = fix(e, north, east)
    waited = 0.0
    for _ in range(most):
        out = taken(e, m.POSITION, z)
        np.testing.assert_allclose(e.P, e.P.T, rtol=1e-12, atol=1e-12)
        assert np.linalg.eigvalsh(e.P / np.outer(*[np.sqrt(np.diag(e.P))] * 2)).min() > -1e-9
        if out[0, 9] in (u.TAKEN, u.FORCED):
            break
        waited += step
        e.x[k.T] += step
        e.P[6:9, 6:9] += 0.01 * step * np.eye(3)
    away = np.hypot((e.x[k.LAT] - z[0]) * e.x[k.RN], (e.x[k.LON] - z[1]) * e.x[k.RE] * e.x[k.CLAT])
    return waited, away, out[0, 9]


@settings(max_examples=60, deadline=None)
@given(
    size=st.floats(0.0, 6.0), course=st.floats(0.0, 6.28), sigma=st.floats(-2.0, 2.0), step=st.floats(0.1, 9.0),
    young=st.booleans(),
)  # fmt: skip
def test_nobody_can_be_locked_out(size, course, sigma, step, young):
    """Any constant offset, 1 m to 1000 km, any certainty: believed at the latest one fix after distrust_s."""
    e = filter_at(sigma=10.0**sigma, time=1.0 if young else 1000.0)
    far = 10.0**size
    waited, away, how = until_believed(e, far * np.cos(course), far * np.sin(course), step)
    allowed = QUIET.distrust_early if young else QUIET.distrust
    assert waited <= allowed + step + 1e-9
    if how == u.FORCED:
        # what is left is a tenth, or what the fix itself may be wrong by
        assert away < max(0.2 * far, 3.0)


def test_a_refused_height_does_not_hold_up_the_place_and_is_believed_too():
    e = filter_at()
    z = fix(e, 0.0, 0.0, up=300.0)
    first = taken(e, m.POSITION, z)
    assert first[0, 9] == u.TAKEN and first[1, 9] == u.REFUSED
    for _ in range(70):
        e.x[k.T] += 1.0
        out = taken(e, m.POSITION, z)
    assert out[1, 9] == u.TAKEN and e.x[k.HGT] == pytest.approx(400.0, abs=30.0)


def test_an_outlier_of_another_sensor_is_refused_and_a_wrong_sensor_pulls_with_bound():
    e = filter_at()
    z = np.full(12, np.nan)
    z[0], z[3] = e.x[k.HGT] + 500.0, 1.0
    told = [taken(e, m.HEIGHT, z)[0, 9] for _ in range(8)]
    assert told[:5] == [u.REFUSED] * 5 and set(told[5:]) == {u.WEAKENED}
    z[0] = e.x[k.HGT]
    assert taken(e, m.HEIGHT, z)[0, 9] == u.TAKEN
    z[0] += 500.0
    assert taken(e, m.HEIGHT, z)[0, 9] == u.REFUSED  # the count began again


def test_constraints_of_standing_and_slip_come_when_due_only():
    s = replace(QUIET, constraints=("nhc", "zupt", "zaru"))
    e = filter_at(settings=s)
    n = e.layout.n
    counts = np.zeros(6, np.int64)
    told = np.zeros(8), np.zeros(8, np.int64), np.zeros((8, u.INNOVATION))
    e.x[k.STILL_S], e.x[k.TSTILL], e.x[k.TNHC] = 2.0, 999.0, 999.0

    def constrain(still):
        vehicle_constraints(
            e.x, e.P, e.layout.ie, e.c, e.dx, e.ring, still, np.zeros((3, n)), np.zeros(3), np.zeros(3), *told, counts
        )

    constrain(True)
    assert told[1][: counts[3]].tolist() == [m.STANDING_V, m.STANDING_W]
    constrain(True)
    assert counts[3] == 2  # not due yet
    constrain(False)
    assert told[1][2] == m.NONHOLONOMIC and counts[3] == 3


# ---- a short recording -------------------------------------------------------------------------------------------

D = np.pi / 180.0
PLACE = (50.0 * D, 30.0 * D)


def recording(duration=40.0, seed=0, size=1.0):
    """A vehicle that weaves north-east at 10 m/s on a plane; the truth, and tables with errors of this size."""
    from schuler.truth import trajectories as shapes

    path = shapes.legs(*PLACE, 100.0, speed=10.0, heading=40.0 * D, duration=duration).with_waves(
        ("course", 0.8, 0.1, 0.0), ("speed", 2.0, 0.07, 1.0)
    )
    rng = np.random.default_rng(seed)
    ideal = path.ideal(50.0)
    t = ideal.time
    gyro = ideal.dtheta / ideal.dt + size * (2e-3 + rng.normal(0, 2e-3, ideal.dtheta.shape))
    accel = ideal.dv / ideal.dt + size * (rng.normal(0, 0.05, ideal.dv.shape) - 0.05)
    imu = Table("imu", {"time": t} | {f"gyro_{a}": gyro[:, i] for i, a in enumerate("xyz")}
                | {f"accel_{a}": accel[:, i] for i, a in enumerate("xyz")}, "rates")  # fmt: skip
    at = path.at(np.arange(1.0, duration, 1.0))
    gnss = Table("gnss", {
        "time": at.time, "lat": at.lat + rng.normal(0, size * 0.5, len(at)) / 6.37e6,
        "lon": at.lon + rng.normal(0, size * 0.5, len(at)) / 6.37e6 / np.cos(PLACE[0]),
        "height": at.height + rng.normal(0, size * 1.0, len(at)),
        "v_north": at.v_n[:, 0] + rng.normal(0, size * 0.05, len(at)),
        "v_east": at.v_n[:, 1] + rng.normal(0, size * 0.05, len(at)),
        "v_down": at.v_n[:, 2] + rng.normal(0, size * 0.05, len(at)),
    })  # fmt: skip
    times = np.arange(1.5, duration, 2.0)
    height = Table(
        "height", {"time": times, "height": path.at(times).height + 3.0 + rng.normal(0, size * 0.3, len(times))}
    )
    return path, {"imu": imu, "gnss": gnss, "height": height}


def settings_of(path, size=1.0, **more):
    s = path.at(np.zeros(1))
    start = Start(
        time=0.0, lat=float(s.lat[0]), lon=float(s.lon[0]), height=100.0, v_n=tuple(float(v) for v in s.v_n[0]),
        roll=float(s.rpy[0, 0]), pitch=float(s.rpy[0, 1]), heading=float(s.rpy[0, 2]), std_roll=0.01 * size,
        std_pitch=0.01 * size, std_heading=0.02 * size, std_pos=(size,) * 3, std_vel=(0.1 * size,) * 3,
    )  # fmt: skip
    names = ("gyro_bias", "accel_bias", "height_bias")
    sigmas = {
        "gyro_bias_std": (3e-3 * size,) * 3, "accel_bias_std": (0.1 * size,) * 3, "gyro_arw": (1e-3 * size,) * 3,
        "accel_vrw": (0.05 * size,) * 3, "gyro_walk": 5e-5 * size, "accel_walk": 5e-4 * size,
        "gnss_std": (0.5 * size, 0.5 * size, size), "gnss_velocity_std": (0.05 * size, 0.05 * size, 0.1 * size),
        "height_std": 0.3 * size,
    }  # fmt: skip
    return AidedSettings(start=start, **{"estimate": names, **sigmas, **more})


@pytest.fixture(scope="module")
def recorded():
    return recording()


def test_open_loop_is_the_closed_loop_to_first_order():
    """The two estimates differ by the square of the errors: beside sigma the difference falls with their size."""
    sizes, apart = np.array([0.4, 0.2, 0.1]), []
    for size in sizes:
        path, tables = recording(size=size)
        closed = navigate(tables, settings_of(path, size))
        opened = navigate(tables, settings_of(path, size, open_loop=True))
        worst = []
        for a, b in ((closed.filter, opened.filter), (closed.smoother, opened.smoother)):
            sigma = np.sqrt(a.cov_pos[:, 0, 0])
            worst.append(np.abs((a.lat - b.lat) * 6.37e6 / sigma).max())
            turn = np.abs(np.angle(np.exp(1j * (a.rpy - b.rpy)))) / np.sqrt(np.einsum("nii->ni", a.cov_rpy))
            worst.append(turn.max())
            np.testing.assert_allclose(np.sqrt(b.cov_pos[:, 0, 0]), sigma, rtol=0.1 * size)
        bias = [run.states["accel_bias_x"] for run in (closed, opened)]
        worst.append(abs(bias[0].value[-1] - bias[1].value[-1]) / bias[0].std[-1])
        apart.append(worst)
    assert np.max(apart[-1]) < 0.15, apart
    slopes = [np.polyfit(np.log(sizes), np.log(column), 1)[0] for column in np.array(apart).T]
    assert min(slopes) > 0.8, slopes


def height_sensor(table, at="height_bias"):
    def barometer(state: State, z):
        H = np.zeros((1, state.n))
        H[0, state.at("position")][2] = -1.0
        H[0, state.at(at)] = 1.0
        return state.height + state.value(at), H

    return Sensor("barometer", ("up",), "m", table.time, table["height"], 0.3, barometer)


def test_a_sensor_of_ones_own_is_the_built_in_one(recorded):
    path, tables = recorded
    built_in = navigate(tables, settings_of(path))
    rest = {n: t for n, t in tables.items() if n != "height"}
    own = navigate(rest, settings_of(path), [height_sensor(tables["height"])])
    for a, b in ((built_in.filter, own.filter), (built_in.smoother, own.smoother)):
        for name in ("lat", "lon", "height", "v_n", "rpy", "cov_pos"):
            np.testing.assert_allclose(getattr(a, name), getattr(b, name), rtol=1e-9, atol=1e-12, err_msg=name)
    a, b = built_in.innovations["height"], own.innovations["barometer"]
    np.testing.assert_allclose(a.value, b.value, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(a.nis, b.nis, rtol=1e-8)
    assert (b.components, b.unit) == (("up",), "m")


def test_a_state_of_ones_own_is_estimated(recorded):
    """The barometer's offset as the caller's own state instead of height_bias: the same."""
    path, tables = recorded
    rest = {n: t for n, t in tables.items() if n != "height"}
    s = settings_of(path, estimate=BIASES, user_std=(50.0, 0.0, 0.0, 0.0), user_walk=(0.05, 0.0, 0.0, 0.0))

    def barometer(state, z):
        H = np.zeros((1, state.n))
        H[0, 8] = -1.0
        H[0, state.at("user").start] = 1.0
        return [state.height + state.value("user")[0]], H

    table = tables["height"]
    own = navigate(rest, s, [Sensor("barometer", ("up",), "m", table.time, table["height"], 0.3, barometer)])
    wanted = navigate(tables, settings_of(path)).states["height_bias"]
    found = own.states["user_0"]
    assert found.value[-1] == pytest.approx(wanted.value[-1], abs=1e-6)
    assert abs(found.value[-1] - 3.0) < 4 * found.std[-1]
    assert "user_1" not in own.states  # a state without variance is no state


def test_two_sensors_of_ones_own_at_one_instant_and_an_angle(recorded):
    path, tables = recorded
    times = np.arange(2.0, 39.0, 1.0)
    heading = path.at(times).rpy[:, 2] + 2 * np.pi * (np.arange(len(times)) % 3 - 1)

    def compass(state, z):
        H = np.zeros((1, state.n))
        H[0, state.at("attitude")][2] = -1.0
        return [np.arctan2(state.C_nb[1, 0], state.C_nb[0, 0])], H

    sensors = [Sensor("compass", ("heading",), "rad", times, heading, 0.01, compass, angle=True)]
    sensors.append(replace(sensors[0], name="second compass"))
    run = navigate(tables, settings_of(path), sensors)
    for name in ("compass", "second compass"):
        assert len(run.innovations[name].time) == len(times) and run.innovations[name].used.all()
        assert np.abs(run.innovations[name].value).max() < 0.05
    plain = navigate(tables, settings_of(path))
    assert run.filter.cov_rpy[-1, 2, 2] < 0.5 * plain.filter.cov_rpy[-1, 2, 2]


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (dict(measure=lambda s, z: ([1.0], np.zeros((1, 3)))), r"H of \(1, 3\).*expected \(1,\)"),
        (dict(measure=lambda s, z: ([np.nan], np.zeros((1, s.n)))), "gave NaN"),
        (dict(measure=lambda s, z: ([1.0], s.at("dvl_scale"))), "dvl_scale is not estimated"),
        (dict(measure=lambda s, z: ([1.0], s.at("wings"))), "there is no parameter wings"),
        (dict(time=np.array([1.0, np.nan])), "finite and of one length"),
    ],
)
def test_a_faulty_sensor_of_ones_own_gets_one_sentence(recorded, change, says):
    path, tables = recorded
    sensor = replace(height_sensor(tables["height"]), **change)
    with pytest.raises(InputError, match=says):
        navigate(tables, settings_of(path), [sensor])


def test_a_receiver_whose_place_is_wild_does_not_pull_by_its_velocity():
    """Position and velocity of one receiver that walks off together: the velocity alone would be worth many pulls."""
    e = filter_at(sigma=0.1)
    z = np.full(12, np.nan)
    z[:2], z[3:6] = (0.7, 0.7), 0.1
    weak = taken(e, m.VELOCITY, z)
    assert weak[0, 9] == u.WEAKENED
    taken(e, m.POSITION, fix(e, 50.0, sigma=0.1))
    assert taken(e, m.VELOCITY, z)[0, 9] == u.REFUSED
    e.P[3:5, 3:5] += np.eye(2)  # doubt has grown: now it would fit
    assert taken(e, m.VELOCITY, z)[0, 9] == u.REFUSED
    taken(e, m.POSITION, fix(e, 0.0, sigma=0.1))
    assert taken(e, m.VELOCITY, z)[0, 9] == u.TAKEN
    # a place that jumps alone costs no velocity
    taken(e, m.POSITION, fix(e, 50.0, sigma=0.1))
    z[:2] = e.x[k.VEL : k.VEL + 2]
    assert taken(e, m.VELOCITY, z)[0, 9] == u.TAKEN
    z[:2] += 3.0
    # and it is believed in the end, whatever the place does
    for _ in range(62):
        e.x[k.T] += 1.0
        taken(e, m.POSITION, fix(e, 500.0, sigma=0.1))
        how = taken(e, m.VELOCITY, z)[0, 9]
        if how == u.FORCED:
            break
    assert how == u.FORCED
