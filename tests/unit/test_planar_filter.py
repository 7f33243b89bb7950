"""The planar filter on made-up drives: starts, causality, outliers, gaps, scales, what bad input gets."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from schuler.aiding.auv_settings import Start
from schuler.aiding.planar import navigate
from schuler.aiding.planar_motion import line_of
from schuler.aiding.planar_settings import Metres, PlanarSettings, Plane
from schuler.ground.errors import InputError
from schuler.ground.tables import Table

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from planar_runs import BEACONS, PLANE, errors, simulate  # noqa: E402


def rms(run, solution):
    return float(np.sqrt(np.mean(np.sum(errors(run, solution)[0] ** 2, axis=1))))


def cut(tables, t):
    return {n: table.where(table.time <= t) if "time" in table else table for n, table in tables.items()}


def changed(table, **columns):
    return Table(table.name, {**table.columns, **columns}, table.kind, table.source, [])


def with_imu(run, seed=4):
    """The same drive with the turn in an imu table of 25 Hz instead of the odometry's increments."""
    log = run.tables["speed"]
    rate = np.repeat(log["dheading"] / 0.2, 5)
    t = 0.04 * np.arange(1, len(rate) + 1)
    zero = np.zeros(len(t))
    columns = {"time": t, "gyro_x": zero, "gyro_y": zero, "gyro_z": rate, "accel_x": zero, "accel_y": zero}
    imu = Table("imu", {**columns, "accel_z": zero - 9.81}, "rates")
    speed = Table("speed", {"time": log.time, "speed": log["speed"]})
    return {**run.tables, "speed": speed, "imu": imu}


def test_ranges_hold_the_track_and_find_their_scale():
    run = simulate(2)
    nav = navigate(run.tables, run.settings, PLANE)
    assert rms(run, nav.filter) < 0.8 and rms(run, nav.smoother) < 0.6
    scale = nav.states["range_scale"]
    assert abs(run.truth["range_scale"]) > 0.02  # there is something to find
    assert abs(scale.value[-1] - run.truth["range_scale"]) < 0.01
    assert [b["id"] for b in nav.extras["beacons"]] == ["0", "1", "2", "3"]
    assert sum(b["ranges"] for b in nav.extras["beacons"]) == len(run.tables["ranges"])


@pytest.mark.parametrize("what", ["increments", "imu"])
def test_no_row_knows_what_comes_later(what):
    """Rows up to t are the same, to the last bit, where everything after t is taken away."""
    run = simulate(5, seconds=60.0, fixes=True)
    tables = run.tables if what == "increments" else with_imu(run)
    fixes = tables["gnss"]
    tables = {**tables, "gnss": changed(fixes, time=fixes.time + 0.13)}  # between the rows of the odometry
    settings = replace(run.settings, output_rate=None if what == "increments" else 20.0)
    whole = navigate(tables, settings, PLANE).filter
    for t in (20.13, 41.07, 50.0):
        part = navigate(cut(tables, t), settings, PLANE).filter
        rows = min(int(np.sum(whole.time <= t)), len(part))
        assert rows > 50 and abs(part.time[rows - 1] - t) < 0.25
        for name in ("time", "lat", "lon", "rpy", "v_n", "cov_pos"):
            np.testing.assert_array_equal(getattr(whole, name)[:rows], getattr(part, name)[:rows])


@pytest.mark.parametrize("fixes", [True, False])
def test_a_start_that_is_found_knows_nothing_later(fixes):
    run = simulate(35, fixes=fixes, ranges=not fixes, start=False)
    name = "gnss" if fixes else "ranges"
    table = run.tables[name]
    tables = {**run.tables, name: changed(table, time=table.time + 0.07)}
    plane = PLANE if not fixes else None  # that of the first fix
    whole = navigate(tables, run.settings, plane).filter
    t = float(whole.time[0]) + 5.0
    part = navigate(cut(tables, t), run.settings, plane).filter
    rows = min(int(np.sum(whole.time <= t)), len(part))
    assert rows > 20
    # the least squares of the start round otherwise over arrays of another length
    for field, close in (("time", 0.0), ("lat", 1e-12), ("lon", 1e-12), ("rpy", 1e-7), ("cov_pos", 1e-6)):
        np.testing.assert_allclose(getattr(whole, field)[:rows], getattr(part, field)[:rows], rtol=0.0, atol=close)


def test_a_row_at_a_fix_has_seen_it():
    run = simulate(6, fixes=True, ranges=False)
    table = run.tables["gnss"]
    tables = {**run.tables, "gnss": changed(table, time=table.time + 0.1)}
    nav = navigate(tables, run.settings, PLANE).filter
    assert np.isin(tables["gnss"].time[:-1], nav.time).all()
    at = tables["gnss"].time[3]
    without = {**tables, "gnss": tables["gnss"].where(tables["gnss"].time != at)}
    blind = navigate(without, replace(run.settings, output_rate=10.0), PLANE).filter
    seeing = navigate(tables, replace(run.settings, output_rate=10.0), PLANE).filter
    row = int(np.searchsorted(seeing.time, at - 1e-6))
    assert seeing.time[row] == pytest.approx(at)
    assert seeing.lat[row] != blind.lat[row] and seeing.lat[row - 1] == blind.lat[row - 1]
    assert seeing.cov_pos[row, 0, 0] < blind.cov_pos[row, 0, 0]


def test_turn_rate_from_an_imu_is_as_good():
    run = simulate(7)
    settings = replace(run.settings, output_rate=5.0)
    one = navigate(run.tables, settings, PLANE)
    other = navigate(with_imu(run), settings, PLANE)
    assert rms(run, other.smoother) < 1.1 * rms(run, one.smoother)
    assert any("gyro z" in note for note in other.notes)


def test_without_a_turn_rate_fixes_alone_turn_it():
    run = simulate(8, fixes=True, ranges=False)
    speed = run.tables["speed"]
    tables = {**run.tables, "speed": Table("speed", {"time": speed.time, "speed": speed["speed"]})}
    nav = navigate(tables, run.settings, PLANE)
    assert rms(run, nav.filter) < 4.0
    assert any("heading follows from fixes" in note for note in nav.notes)


@pytest.mark.parametrize("seed", [11, 14])
@pytest.mark.parametrize("fixes", [True, False])
def test_the_start_is_found(seed, fixes):
    run = simulate(seed, fixes=fixes, ranges=not fixes, start=False)
    nav = navigate(run.tables, run.settings, PLANE)
    _, heading, _ = errors(run, nav.filter)
    assert abs(np.degrees(heading[0])) < 25.0
    later = nav.filter.time > nav.filter.time[0] + 60.0
    assert np.abs(np.degrees(heading[later])).max() < 12.0
    assert any("place and heading found" in note for note in nav.notes)
    assert nav.smoother.time[0] < nav.filter.time[0]  # the smoother knows the way there too


def test_a_typed_start_is_kept():
    run = simulate(15, fixes=True)
    nav = navigate(run.tables, run.settings, PLANE)
    assert nav.filter.time[0] == pytest.approx(0.2)
    assert not any("start:" in note for note in nav.notes)
    only_heading = replace(run.settings, start=Start(heading=run.settings.start.heading))
    nav = navigate(run.tables, only_heading, PLANE)
    assert any("start: place found" in note for note in nav.notes)
    nav = navigate(run.tables, replace(run.settings, start=replace(run.settings.start, time=30.0)), PLANE)
    assert 30.0 <= nav.filter.time[0] < 30.4


def test_nothing_to_start_from_is_said_in_one_sentence():
    run = simulate(16, ranges=False)
    for start, missing in (
        (Start(), "lat_deg and lon_deg and heading_deg"),
        (Start(heading=0.1), "lat_deg and lon_deg"),
    ):
        with pytest.raises(InputError, match=missing):
            navigate(run.tables, replace(run.settings, start=start), PLANE)
    dead = navigate(run.tables, run.settings, PLANE)  # dead reckoning alone
    assert dead.filter.cov_pos[-1, 0, 0] > dead.filter.cov_pos[0, 0, 0]


@pytest.mark.slow
def test_beacons_on_one_line_leave_the_side_open():
    assert line_of(np.array([[0.0, 0.0], [10.0, 0.0], [20.0, 0.1]])) and line_of(BEACONS[:2]) and not line_of(BEACONS)
    # a straight drive beside the line; in a curve the turn would tell the side
    n = 400
    t = 0.2 * np.arange(1, n + 1)
    place = np.column_stack([-100.0 + 0.3 * np.arange(1, n + 1), np.full(n, 20.0)])
    north, east = np.array([-120.0, -40.0, 60.0, 130.0]), np.full(4, 50.0)
    which = np.arange(n) % 4
    d = np.hypot(place[:, 0] - north[which], place[:, 1] - east[which])
    lat, lon = PLANE.geodetic(north, east)
    tables = {
        "speed": Table("speed", {"time": t, "speed": np.full(n, 1.5), "dheading": np.zeros(n)}),
        "landmarks": Table("landmarks", {"id": np.array(list("abcd")), "lat": lat, "lon": lon}),
        "ranges": Table("ranges", {"time": t, "id": np.array(list("abcd"))[which], "range": d + 0.2 * np.sin(7.0 * t)}),
    }
    nav = navigate(tables, PlanarSettings(), PLANE)
    assert any("NOT CERTAIN" in note and "one line" in note for note in nav.notes)
    begin = Start(heading=0.0, **dict(zip(("lat", "lon"), map(float, PLANE.geodetic(-100.0, 20.0)), strict=True)))
    nav = navigate(tables, PlanarSettings(start=begin), PLANE)
    found = PLANE.north_east(nav.filter.lat, nav.filter.lon)
    assert np.abs(found[1] - 20.0).max() < 3.0 and not any("NOT CERTAIN" in note for note in nav.notes)


def test_unknown_beacons():
    run = simulate(18)
    ids = run.tables["ranges"]["id"].copy()
    ids[::4] = "77"
    nav = navigate({**run.tables, "ranges": changed(run.tables["ranges"], id=ids)}, run.settings, PLANE)
    assert any("go to beacon 77, and landmarks lists 0, 1, 2, 3; they were left out" in note for note in nav.notes)
    ids[:] = "77"
    with pytest.raises(InputError, match="write the same ids in both tables"):
        navigate({**run.tables, "ranges": changed(run.tables["ranges"], id=ids)}, run.settings, PLANE)
    tables = {k: v for k, v in run.tables.items() if k != "landmarks"}
    with pytest.raises(InputError, match="landmarks"):
        navigate(tables, run.settings, PLANE)
    marks = run.tables["landmarks"]
    with pytest.raises(InputError, match="more than once"):
        navigate({**run.tables, "landmarks": changed(marks, id=np.array(["0", "1", "2", "2"]))}, run.settings, PLANE)


@pytest.mark.slow
def test_echoes_do_not_pull_the_track_away():
    """One range in ten is an echo, 5 to 30 m too long."""
    run = simulate(19)
    rng = np.random.default_rng(2)
    r = run.tables["ranges"]
    echo = rng.random(len(r)) < 0.1
    spoilt = changed(r, range=r["range"] + echo * rng.uniform(5.0, 30.0, len(r)))
    clean = navigate(run.tables, run.settings, PLANE)
    nav = navigate({**run.tables, "ranges": spoilt}, run.settings, PLANE)
    assert rms(run, nav.filter) < 1.5 * rms(run, clean.filter) + 0.1
    assert (~nav.innovations["range"].used).sum() > 0.5 * echo.sum()
    found = navigate({**run.tables, "ranges": spoilt}, replace(run.settings, start=Start()), PLANE)
    later = found.filter.time > 100.0
    assert np.hypot(*errors(run, found.filter)[0][later].T).max() < 5.0


@pytest.mark.slow
@pytest.mark.parametrize("seed", [31, 32])
def test_one_range_in_four_an_echo_and_no_start(seed):
    """A filter that begins with wide sigmas could not tell them; the start does."""
    run = simulate(seed, start=False)
    rng = np.random.default_rng(seed)
    r = run.tables["ranges"]
    spoilt = changed(r, range=r["range"] + (rng.random(len(r)) < 0.25) * rng.uniform(5.0, 40.0, len(r)))
    nav = navigate({**run.tables, "ranges": spoilt}, run.settings, PLANE)
    later = nav.filter.time > 100.0
    assert np.hypot(*errors(run, nav.filter)[0][later].T).max() < 4.0
    assert any("contradict the others" in note for note in nav.notes)


@pytest.mark.slow
def test_one_beacon_tells_no_heading():
    run = simulate(33, start=False)
    one = run.tables["ranges"].where(run.tables["ranges"]["id"] == "1")
    with pytest.raises(InputError, match="ranges to 1 beacon .* do not tell where the vehicle heads; type the place"):
        navigate({**run.tables, "ranges": one}, run.settings, PLANE)
    told = simulate(33)
    nav = navigate({**told.tables, "ranges": one}, told.settings, PLANE)
    without = navigate({"speed": told.tables["speed"]}, told.settings, PLANE)
    assert (
        nav.filter.cov_pos[-1, 0, 0] + nav.filter.cov_pos[-1, 1, 1] < without.filter.cov_pos[-1, [0, 1], [0, 1]].sum()
    )


def test_a_gate_that_refuses_most_is_opened():
    """The vehicle is carried 30 m away between four beacons: now and then a wrong range still fits by chance."""
    run = simulate(34)
    r = run.tables["ranges"]
    row = np.searchsorted(run.time, r.time - 1e-6)
    moved = run.place + np.outer(run.time >= 120.0, [0.0, 30.0])
    which = r["id"].astype(int)
    d = [np.linalg.norm(p[row] - BEACONS[which], axis=1) for p in (run.place, moved)]
    told = r["range"] + (1.0 + run.truth["range_scale"]) * (d[1] - d[0])
    nav = navigate({**run.tables, "ranges": changed(r, range=told)}, run.settings, PLANE)
    run.place = moved
    assert np.hypot(*errors(run, nav.filter)[0][nav.filter.time > 150.0].T).max() < 2.0


def test_a_lying_receiver_is_left_out_and_believed_again():
    settings = PlanarSettings(gnss_correlated_std=0.0)
    run = simulate(20, fixes=True, ranges=False, settings=settings)
    g = run.tables["gnss"]
    lie = (g.time >= 100.0) & (g.time < 110.0)
    north, east = PLANE.north_east(g["lat"], g["lon"])
    lat, lon = PLANE.geodetic(north + 50.0 * lie, east)
    nav = navigate({**run.tables, "gnss": changed(g, lat=lat, lon=lon)}, run.settings, PLANE)
    clean = navigate(run.tables, run.settings, PLANE)
    assert np.hypot(*errors(run, nav.filter)[0].T).max() < 3.0 * np.hypot(*errors(run, clean.filter)[0].T).max()
    used = nav.innovations["gnss_position"].used
    assert not used[lie].any() and used[~lie].all()


def test_no_gate_stays_shut():
    """The vehicle is carried 60 m away: the fixes are right, and after the patience they are believed."""
    settings = PlanarSettings(gnss_correlated_std=0.0)
    run = simulate(21, fixes=True, ranges=False, settings=settings)
    g = run.tables["gnss"]
    after = g.time >= 120.0
    north, east = PLANE.north_east(g["lat"], g["lon"])
    lat, lon = PLANE.geodetic(north + 60.0 * after, east)
    nav = navigate({**run.tables, "gnss": changed(g, lat=lat, lon=lon)}, run.settings, PLANE)
    run.place = run.place + np.outer(run.time >= 120.0, [60.0, 0.0])
    size = np.hypot(*errors(run, nav.filter)[0].T)
    assert size[(nav.filter.time > 150.0)].max() < 4.0
    assert np.isfinite(nav.smoother.cov_pos[:, :2, :2]).all()


def test_gaps_are_told_and_make_it_uncertain():
    run = simulate(22)
    log = run.tables["speed"]
    keep = (log.time < 80.0) | (log.time > 88.0)
    tables = {
        **run.tables,
        "speed": log.where(keep),
        "ranges": run.tables["ranges"].where(run.tables["ranges"].time < 80.0),
    }
    nav = navigate(tables, run.settings, PLANE)
    assert any("1 gap, the longest 8.4 s" in note for note in nav.notes)
    a, b = np.searchsorted(nav.filter.time, [80.0, 88.1])
    assert nav.filter.cov_pos[b, 0, 0] + nav.filter.cov_pos[b, 1, 1] > 10.0
    e = errors(run, nav.filter)[0][b]
    assert e @ np.linalg.solve(nav.filter.cov_pos[b, :2, :2], e) < 11.8


def test_an_increment_over_a_gap_holds_the_whole_way():
    run = simulate(23, ranges=False)
    log = run.tables["speed"]
    ddist = log["speed"] * 0.2
    way = np.cumsum(ddist)
    keep = np.ones(len(log), dtype=bool)
    keep[300:320] = False
    t = log.time[keep]
    thin = Table(
        "speed",
        {
            "time": t,
            "ddist": np.diff(way[keep], prepend=0.0),
            "dheading": np.diff(np.cumsum(log["dheading"])[keep], prepend=0.0),
        },
    )
    nav = navigate({"speed": thin}, run.settings, PLANE)
    whole = Table("speed", {"time": log.time, "ddist": ddist, "dheading": log["dheading"]})
    other = navigate({"speed": whole}, run.settings, PLANE)
    assert np.hypot(*(errors(run, nav.filter)[0][-1] - errors(run, other.filter)[0][-1])) < 4.0
    assert nav.filter.cov_pos[-1, 0, 0] > other.filter.cov_pos[-1, 0, 0]


def test_standing_still_tells_the_gyro_bias_but_turning_on_the_spot_does_not():
    quiet = replace(PlanarSettings(), gyro_bias_std=0.01)
    run = simulate(24, ranges=False, stand=40.0, settings=quiet)
    nav = navigate(run.tables, run.settings, PLANE)
    bias = nav.states["gyro_bias_z"]
    i = int(np.searchsorted(bias.time, 39.0))
    assert bias.std[i] < 0.15 * quiet.gyro_bias_std and "rest" in nav.innovations
    log = run.tables["speed"]
    spin = changed(log, dheading=log["dheading"] + np.where(log.time <= 40.0, 0.1, 0.0))  # 0.5 rad/s
    nav = navigate({**run.tables, "speed": spin}, run.settings, PLANE)
    assert not nav.innovations["rest"].used.any()
    assert abs(nav.states["gyro_bias_z"].value[-1] - run.truth["gyro_bias_z"]) < 0.03


def test_the_antenna_has_an_arm():
    run = simulate(25, fixes=True, ranges=False)
    arm = (3.0, -1.0, 0.0)
    g = run.tables["gnss"]
    row = np.searchsorted(run.time, g.time - 1e-6)
    co, si = np.cos(run.heading[row]), np.sin(run.heading[row])
    north, east = PLANE.north_east(g["lat"], g["lon"])
    lat, lon = PLANE.geodetic(north + arm[0] * co - arm[1] * si, east + arm[0] * si + arm[1] * co)
    tables = {**run.tables, "gnss": changed(g, lat=lat, lon=lon)}
    told = navigate(tables, replace(run.settings, antenna=arm), PLANE)
    plain = navigate(run.tables, run.settings, PLANE)
    np.testing.assert_allclose(told.smoother.lat, plain.smoother.lat, atol=0.05 / 6.4e6)


def test_what_is_not_estimated_stays_out():
    run = simulate(26)
    settings = replace(run.settings, range_scale_std=0.0, range_bias_std=0.0, gyro_scale_std=0.0)
    nav = navigate(run.tables, settings, PLANE)
    assert set(nav.states) == {"gyro_bias_z", "speed_scale"}


def test_rows_as_asked():
    run = simulate(27, seconds=60.0, fixes=True)
    nav = navigate(run.tables, replace(run.settings, output_rate=2.0), PLANE)
    np.testing.assert_allclose(np.diff(nav.filter.time), 0.5, atol=1e-9)
    assert len(nav.smoother) == len(nav.filter)
    nav = navigate(run.tables, replace(run.settings, smoother=False), PLANE)
    assert nav.smoother is None and len(nav.filter) == len(run.time)


def test_the_plane_is_a_map():
    plane = Plane(np.radians(52.5), np.radians(13.4), 80.0)
    north, east = np.array([0.0, 12e3, -30e3]), np.array([0.0, -9e3, 25e3])
    lat, lon = plane.geodetic(north, east)
    back = plane.north_east(lat, lon)
    np.testing.assert_allclose(back[0], north, atol=0.01)
    np.testing.assert_allclose(back[1], east, atol=0.01)
    metres = Metres(plane, 5.8e6, 3.9e5)
    np.testing.assert_allclose(
        metres.north_east(*metres.geodetic(5.8e6 + north, 3.9e5 + east))[0], 5.8e6 + north, atol=0.01
    )


def test_true_north_turns_away_from_the_plane():
    """Straight on in the plane, the compass heading changes by the convergence of the meridians."""
    plane = Plane(np.radians(60.0), 0.0)
    t = np.arange(1.0, 601.0)
    tables = {"speed": Table("speed", {"time": t, "speed": np.full(600, 50.0), "dheading": np.zeros(600)})}
    start = Start(lat=plane.lat, lon=0.0, heading=np.pi / 2)
    nav = navigate(tables, PlanarSettings(start=start), plane).filter
    turned = nav.rpy[-1, 2] - nav.rpy[0, 2]
    assert turned == pytest.approx((nav.lon[-1] - nav.lon[0]) * np.sin(plane.lat), rel=1e-2)
