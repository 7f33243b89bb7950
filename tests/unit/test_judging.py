"""Judging: errors against an independent answer, consistency against drawn samples, outages against known tracks."""

import numpy as np
import pytest

from schuler.aiding.solution import Innovations, Navigation, Solution
from schuler.ground.earth import WGS84
from schuler.ground.frames import dcm_from_euler
from schuler.ground.tables import Table
from schuler.judging import consistency, errors, outages

LAT, LON = np.radians(36.73), np.radians(52.65)
DEG = np.pi / 180.0


def track(time, ned, *, v_n=None, rpy=None, sigma=1.0, lat=LAT, lon=LON):
    """A solution whose positions are NED metres (n, 3) from one place."""
    n = len(time)
    p, l, h = WGS84.displace(np.full(n, lat), np.full(n, lon), np.zeros(n), np.asarray(ned, dtype=float))
    eye = np.broadcast_to(np.eye(3), (n, 3, 3))
    return Solution(
        np.asarray(time, dtype=float),
        p,
        l,
        h,
        np.zeros((n, 3)) if v_n is None else np.asarray(v_n, dtype=float),
        np.zeros((n, 3)) if rpy is None else np.asarray(rpy, dtype=float),
        eye * sigma**2,
        eye * 0.1**2,
        eye * (1 * DEG) ** 2,
    )


def reference(time, ned, **more):
    s = track(time, ned, lat=more.pop("lat", LAT), lon=more.pop("lon", LON))
    return Table("reference", {"time": s.time, "lat": s.lat, "lon": s.lon, "height": s.height, **more})


def straight(time, v=(1.0, 2.0, 0.5)):
    return np.outer(time, v)


def test_errors_are_estimate_minus_reference_in_ned_metres():
    t = np.arange(0.0, 10.0, 0.1)
    e = errors.error_series(track(t, straight(t) + [3.0, -4.0, 1.0]), reference(t, straight(t)))
    np.testing.assert_allclose(e.position, np.tile([3.0, -4.0, 1.0], (len(t), 1)), atol=1e-5)
    told = errors.summary(e)
    assert told["horizontal_m"] == pytest.approx({"rms": 5.0, "p95": 5.0, "max": 5.0, "end": 5.0}, abs=1e-5)
    assert told["vertical_m"]["max"] == pytest.approx(1.0, abs=1e-5)
    assert told["roll_deg"] is None and told["velocity_mps"] is None  # the reference does not say


def test_a_slower_reference_is_interpolated_between_its_rows():
    t, slow = np.arange(0.0, 10.0, 0.1), np.arange(0.0, 10.0, 0.5)
    e = errors.error_series(track(t, straight(t)), reference(slow, straight(slow)))
    assert e.time[-1] == pytest.approx(9.5)  # never extrapolated
    assert e.horizontal.max() < 1e-5


def test_gaps_of_the_reference_are_not_bridged():
    t = np.arange(0.0, 10.0, 0.1)
    keep = (t < 3.0) | (t > 3.35)
    e = errors.error_series(track(t, straight(t)), reference(t[keep], straight(t[keep])))
    assert not ((e.time > 2.95) & (e.time < 3.35)).any()
    one_lost = np.delete(t, 50)
    e = errors.error_series(track(t, straight(t)), reference(one_lost, straight(one_lost)))
    assert 5.0 in np.round(e.time, 6)


def test_a_sparse_reference_is_met_at_its_own_moments():
    t, sparse = np.arange(0.0, 100.0, 0.1), np.arange(0.03, 100.0, 7.0)
    e = errors.error_series(track(t, straight(t)), reference(sparse, straight(sparse)))
    np.testing.assert_allclose(e.time, sparse)
    assert e.horizontal.max() < 1e-3


def test_angles_wrap_in_differences_and_between_rows():
    t = np.arange(0.0, 4.0, 0.1)
    turning = np.mod(359.0 * DEG + 0.01 * t, 2 * np.pi)
    rpy = np.column_stack([np.zeros_like(t), np.zeros_like(t), turning + 0.5 * DEG])
    coarse = t[::2]
    ref = reference(coarse, straight(coarse), heading=np.mod(359.0 * DEG + 0.01 * coarse, 2 * np.pi))
    e = errors.error_series(track(t, straight(t), rpy=rpy), ref)
    np.testing.assert_allclose(e.rpy[:, 2], 0.5 * DEG, atol=1e-12)


def test_across_the_antimeridian():
    t = np.arange(0.0, 10.0, 0.1)
    path = straight(t, (0.0, 5.0, 0.0)) - [0.0, 25.0, 0.0]
    e = errors.error_series(track(t, path + [0, 1.0, 0], lon=np.pi), reference(t[::2], path[::2], lon=np.pi))
    np.testing.assert_allclose(e.horizontal, 1.0, atol=1e-5)


def test_lever_arm_moves_the_track_to_the_point_of_the_reference():
    t = np.arange(0.0, 20.0, 0.1)
    rpy = np.column_stack([0.1 * np.sin(t), 0.05 * np.cos(t), 0.2 * t])
    arm = np.array([2.0, 0.5, -1.0])
    C_nb = dcm_from_euler(*rpy.T)
    ref = reference(t, straight(t) + C_nb @ arm)
    e = errors.error_series(track(t, straight(t), rpy=rpy), ref, arm)
    assert np.abs(e.position).max() < 1e-5
    assert errors.error_series(track(t, straight(t), rpy=rpy), ref).horizontal.max() > 1.9


def test_the_end_figure_is_the_last_one_known():
    assert errors.spread(np.array([1.0, -3.0, np.nan])) == pytest.approx(
        {"rms": np.sqrt(5.0), "p95": 2.9, "max": 3.0, "end": 3.0}
    )
    assert errors.spread(np.array([np.nan])) is None


def test_cep_and_r95_of_a_circular_sample():
    rng = np.random.default_rng(1)
    told = errors.circular(np.hypot(*rng.normal(size=(2, 200_000))))
    assert told["cep_m"] == pytest.approx(1.1774, rel=0.01)
    assert told["r95_m"] == pytest.approx(2.4477, rel=0.01)


def test_chi2_bounds_hold_the_share_they_promise():
    scipy_stats = pytest.importorskip("scipy.stats")
    for dof, n in ((1, 1), (2, 1), (3, 100)):
        low, high = consistency.chi2_bounds(dof, n, 0.99)
        assert low == pytest.approx(scipy_stats.chi2.ppf(0.005, dof * n) / (dof * n), rel=1e-9)
        assert high == pytest.approx(scipy_stats.chi2.ppf(0.995, dof * n) / (dof * n), rel=1e-9)
    assert consistency.chi2_quantile(2, 0.95) == pytest.approx(5.991, abs=1e-3)


def test_nees_of_samples_of_their_own_covariance_is_one():
    rng = np.random.default_rng(2)
    A = rng.normal(size=(3, 3)) * [[1000.0], [1.0], [1e-3]]
    P = A @ A.T
    e = rng.multivariate_normal(np.zeros(3), P, size=20_000)
    value = consistency.nees(e, np.broadcast_to(P, (20_000, 3, 3)))
    low, high = consistency.chi2_bounds(3, 20_000, 0.9999)
    assert low < value.mean() < high


def test_nees_says_nothing_where_the_covariance_says_nothing():
    e = np.ones((3, 2))
    P = np.array([np.eye(2), np.full((2, 2), np.nan), [[1.0, 1.0], [1.0, 1.0]]])
    assert np.isfinite(consistency.nees(e, P)).tolist() == [True, False, False]


def test_position_nees_leaves_out_a_height_that_is_not_estimated():
    t = np.arange(0.0, 5.0, 0.1)
    s = track(t, straight(t) + [1.0, 1.0, 50.0])
    flat = errors.error_series(s, reference(t, straight(t)))
    flat.cov_pos = flat.cov_pos.copy()
    flat.cov_pos[:, 2, 2] = np.nan
    np.testing.assert_allclose(consistency.position_nees(flat), 1.0, rtol=1e-4)
    full = errors.error_series(s, reference(t, straight(t)))
    np.testing.assert_allclose(consistency.position_nees(full), (1 + 1 + 2500) / 3, rtol=1e-4)


def test_consistency_counts_only_used_innovations():
    value = np.array([[1.0, 1.0], [2.0, 0.0], [100.0, 0.0]])
    nis = np.array([2.0, 4.0, 1e4])
    i = Innovations(
        "gnss_velocity", ("n", "e"), "m/s", np.arange(3.0), value, np.ones((3, 2)), nis, np.array([True, True, False])
    )
    told = consistency.consistency(None, {"gnss_velocity": i})
    row = told["nis"]["gnss_velocity"]
    assert row["mean"] == pytest.approx(1.5) and row["n"] == 2 and row["left_out"] == 1
    assert row["low"] < 1.0 < row["high"]
    assert told["nees_position"] is None and told["inside_3_sigma"] is None


def test_inside_3_sigma_is_a_share():
    t = np.arange(0.0, 10.0, 0.1)
    off = np.zeros((len(t), 3))
    off[:10, 0] = 4.0  # of 1 m sigma
    e = errors.error_series(track(t, straight(t) + off), reference(t, straight(t)))
    assert consistency.inside_3_sigma(e) == pytest.approx(1.0 - 10 / 300)


# ---- outages, dives, surfacings ----


def gnss(time, ned):
    s = track(time, ned)
    return Table("gnss", {"time": s.time, "lat": s.lat, "lon": s.lon})


def drifting(t, start, rate):
    """Errors that grow from a moment on, and vanish at the moment 90 s later (a fix)."""
    grown = np.where((t > start) & (t < start + 90.0), (t - start) * rate, 0.0)
    return np.column_stack([grown, 0 * t, 0 * t])


def test_an_outage_ends_at_its_last_withheld_row():
    t = np.arange(0.0, 200.0, 0.1)
    v = (1.0, 2.0, 0.0)
    nav = Navigation(track(t, straight(t, v) + drifting(t, 50.0, 0.1), v_n=np.tile(v, (len(t), 1)), sigma=9.0))
    rows = gnss(np.arange(50.5, 139.9, 1.0), straight(np.arange(50.5, 139.9, 1.0), v))
    for judge in (reference(t, straight(t, v)), None):
        told = outages.outage(nav, rows, "gnss", 50.0, 140.0, judge)
        assert told["horizontal_end_m"] == pytest.approx(8.95, abs=0.06)
        assert told["horizontal_max_m"] == pytest.approx(8.95, abs=0.06)
        assert told["smoother_horizontal_max_m"] is None
        sigma2 = 81.0 if judge is not None else 82.0  # a fix has its own error
        assert told["nees_half_end"] == pytest.approx(8.95**2 / sigma2 / 2, rel=0.03)


def test_a_dive_is_judged_just_before_the_fix_that_ends_it():
    t = np.arange(0.0, 200.0, 0.1)
    v = (1.0, 2.0, 0.0)
    filtered = track(t, straight(t, v) + drifting(t, 50.0, 0.1), v_n=np.tile(v, (len(t), 1)), sigma=9.0)
    nav = Navigation(filtered, track(t, straight(t, v) + [0.5, 0.0, 0.0]))
    fixes = np.concatenate([np.arange(0.0, 50.5, 1.0), np.arange(140.0, 200.0, 1.0)])
    (dive,) = outages.dives(nav, gnss(fixes, straight(fixes, v)), reference(t, straight(t, v)))
    assert (dive["start_s"], dive["end_s"]) == (50.0, pytest.approx(139.9))
    assert dive["horizontal_end_m"] == pytest.approx(8.99, abs=0.02)
    assert dive["distance_m"] == pytest.approx(np.sqrt(5) * 89.9, rel=1e-3)
    assert dive["percent_of_distance"] == pytest.approx(100 * 8.99 / (np.sqrt(5) * 89.9), rel=5e-3)
    assert dive["smoother_rms_m"] == pytest.approx(0.5, abs=1e-3)


def test_a_mission_that_ends_submerged_has_a_dive_without_a_fix_after_it():
    t = np.arange(0.0, 200.0, 0.1)
    nav = Navigation(track(t, straight(t)))
    fixes = np.arange(0.0, 100.5, 1.0)
    (dive,) = outages.dives(nav, gnss(fixes, straight(fixes)), None)
    assert dive["start_s"] == 100.0 and dive["end_s"] == pytest.approx(199.9)
    assert dive["horizontal_end_m"] is None and dive["sigma_end_m"] == pytest.approx(1.0)


def test_surfacing_miss_is_predicted_minus_fix_with_the_fix_s_own_sigma():
    t = np.arange(0.0, 200.0, 0.1)
    v = (1.0, 2.0, 0.0)
    nav = Navigation(track(t, straight(t, v) + drifting(t, 50.0, 0.1), v_n=np.tile(v, (len(t), 1)), sigma=3.0))
    fixes = np.concatenate([np.arange(0.0, 50.5, 1.0), np.arange(140.0, 200.0, 1.0)])
    (s,) = outages.surfacings(nav, gnss(fixes, straight(fixes, v)), gnss_m=(4.0, 4.0, 4.0))
    assert s["time_s"] == 140.0 and s["gap_s"] == 90.0
    assert (s["north_m"], s["east_m"]) == (pytest.approx(8.99, abs=0.02), pytest.approx(0.0, abs=0.02))
    assert s["sigma_major_m"] == pytest.approx(5.0)
    assert s["mahalanobis2"] == pytest.approx(8.99**2 / 25, rel=0.01)
    assert s["inside_95"] is True


def test_surfacing_uses_the_filter_s_own_innovation_when_it_has_one():
    t = np.arange(0.0, 200.0, 0.1)
    filtered = track(t, straight(t), sigma=3.0)
    filtered.cov_pos = filtered.cov_pos.copy()
    filtered.cov_pos[:, 0, 1] = filtered.cov_pos[:, 1, 0] = 4.0
    i = Innovations(
        "gnss_position",
        ("north", "east"),
        "m",
        np.array([140.0]),
        np.array([[-30.0, 0.0]]),
        np.array([[5.0, 5.0]]),
        np.array([36.0]),
        np.array([True]),
    )
    fixes = np.concatenate([np.arange(0.0, 50.5, 1.0), np.arange(140.0, 200.0, 1.0)])
    nav = Navigation(filtered, innovations={"gnss_position": i})
    (s,) = outages.surfacings(nav, gnss(fixes, straight(fixes)))
    assert s["north_m"] == 30.0 and s["miss_m"] == 30.0
    S = np.array([[25.0, 4.0], [4.0, 25.0]])
    assert s["mahalanobis2"] == pytest.approx(np.array([30.0, 0]) @ np.linalg.inv(S) @ [30.0, 0])
    assert s["inside_95"] is False


def test_surfacing_tells_how_deep_the_vehicle_was():
    t = np.arange(0.0, 200.0, 0.1)
    fixes = np.concatenate([np.arange(0.0, 50.5, 1.0), np.arange(140.0, 200.0, 1.0)])
    depth = Table("depth", {"time": np.array([30.0, 60.0, 120.0, 150.0]), "depth": np.array([99.0, 7.0, 12.5, 99.0])})
    nav = Navigation(track(t, straight(t)))
    (s,) = outages.surfacings(nav, gnss(fixes, straight(fixes)), depth=depth)
    assert s["max_depth_m"] == 12.5
