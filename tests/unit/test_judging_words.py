"""Judging in words: sigmas that are not true, sensors that were distrusted, outages in % of the distance, sweeps."""

import numpy as np
import pytest
from test_judging import reference, straight, track

from fake_result import fake
from schuler.aiding.solution import Innovations, Navigation
from schuler.judging import outages
from schuler.judging.consistency import consistency, nis_table, typical
from schuler.judging.distrust import distrusted
from schuler.judging.words import consistency_words
from schuler.report.page import page
from schuler.studies.sweep import sweep


def innovations(kind, scale, n=400, d=2, bad=0.0, seed=1):
    """`scale` times larger than their sigma of 1; a share `bad` of outliers that the gate refused."""
    rng = np.random.default_rng(seed)
    y = scale * rng.normal(size=(n, d))
    out = rng.random(n) < bad
    y[out] *= 50.0
    return Innovations(
        kind, ("north", "east")[:d], "m", np.arange(float(n)), y, np.ones((n, d)), (y**2).sum(axis=1), ~out
    )


# ---- sigmas ----


@pytest.mark.parametrize("d", [1, 2, 3])
def test_the_typical_nis_is_one_for_a_true_sigma_and_outliers_move_it_little(d):
    rng = np.random.default_rng(3)
    nis = rng.chisquare(d, 20_000)
    assert typical(nis, np.full(20_000, d)) == pytest.approx(1.0, abs=0.05)
    nis[::5] = 1e6
    assert typical(nis, np.full(20_000, d)) < 1.8
    assert typical(np.array([np.nan]), np.array([d])) is None


def test_a_tenfold_sigma_is_found_and_said_and_a_true_one_is_not():
    good = {"nis": nis_table({"gnss_position": innovations("gnss_position", 1.0)})}
    assert good["nis"]["gnss_position"]["sigma_factor"] == pytest.approx(1.0, abs=0.1)
    assert consistency_words(good) == []
    small = {"nis": nis_table({"gnss_position": innovations("gnss_position", 10.0, bad=0.1)})}
    assert small["nis"]["gnss_position"]["sigma_factor"] == pytest.approx(10.0, rel=0.15)
    (words,) = consistency_words(small, {"gnss_m": (1.0, 1.0, 2.0)})
    assert "about 10 times too small" in words or "about 11 times too small" in words
    assert "type gnss_m = [1" in words and "under [noise]" in words
    (words,) = consistency_words(small, {"gnss_m": (1.0, 1.0, 2.0)}, {"gnss": ["std_north", "lat"]})
    assert "multiply the std_ columns of the gnss table by 1" in words
    large = {"nis": nis_table({"gnss_velocity": innovations("gnss_velocity", 0.1)})}
    (words,) = consistency_words(large, {"gnss_mps": (0.5, 0.5, 0.5)})
    assert "too large" in words and "type gnss_mps = [0.0" in words
    smooth = {"nis": nis_table({"speed": innovations("speed", 0.05, d=1), "zupt": innovations("zupt", 0.05, d=1)})}
    assert consistency_words(smooth) == []  # errors that live long, sigmas that are bounds


def test_what_recordings_do_gives_no_words():
    """Correlated receivers, careful settings, single outliers, few measurements."""
    for mean in (0.15, 0.24, 0.54, 1.9, 3.0):
        assert consistency_words({"nis": {"gnss_position": {"mean": mean, "n": 1000, "left_out": 20}}}) == []
    assert consistency_words({"nis": {"gnss_position": {"mean": 98.0, "n": 10, "left_out": 0}}}) == []
    assert consistency_words({"nees_position": 5.0, "inside_3_sigma": 0.9}) == []
    assert consistency_words({"nees_position": 35.0, "inside_3_sigma": 0.97}) == []  # a few moments make that mean
    assert consistency_words({}) == [] and consistency_words({"nis": {"x": None}, "nees_position": "high"}) == []


def test_other_faults_are_said_once():
    (words,) = consistency_words({"nees_position": 100.0, "inside_3_sigma": 0.4})
    assert "sigmas of the position are about 10 times too small" in words
    (words,) = consistency_words({"nis": {"gnss_position": {"mean": 1.0, "n": 60, "left_out": 40}}})
    assert "40 % of the measurements" in words
    both = consistency_words({"nees_position": 100.0, "nis": {"sonar": {"mean": 100.0, "n": 99, "left_out": 0}}})
    assert len(both) == 1 and "its sigma wants to be 10 times larger" in both[0]  # the cause, not what follows from it


# ---- distrust ----


def test_stretches_of_distrust_are_found_and_single_outliers_are_none():
    used = np.ones(200, dtype=bool)
    used[[10, 60, 62, 64, 100, 101, 150, 151, 152, 153]] = False
    i = innovations("gnss_position", 1.0, n=200)
    i.used = used
    found = distrusted({"gnss_position": i})
    assert [(f["start_s"], f["end_s"], f["rows"], f["of"]) for f in found] == [(60.0, 64.0, 3, 5), (150.0, 153.0, 4, 4)]
    i.used = np.ones(200, dtype=bool)
    assert distrusted([i]) == []
    i.weight = np.where((i.time >= 20) & (i.time <= 25), 0.01, 1.0)
    assert [(f["start_s"], f["end_s"]) for f in distrusted([i])] == [(20.0, 25.0)]


def test_the_page_says_when_a_sensor_was_distrusted_and_shades_it():
    result = fake()
    i = result.navigation.innovations["gnss_position"]
    i.used = np.ones(len(i.time), dtype=bool)
    assert "was distrusted" not in page(result)
    i.used[20:31] = False
    text = page(result)
    assert "When a sensor was distrusted" in text
    assert f"from {i.time[20]:.0f} to {i.time[30]:.0f} s; 11 measurements" in text
    assert '"yref":"y domain"' in text
    assert "GNSS position was distrusted for" in text


def test_the_opening_says_that_sigmas_are_too_small():
    result = fake()
    result.summary["consistency"]["nis"]["gnss_position"] |= {"mean": 98.0, "n": 300}
    text = page(result)
    assert "sigmas of gnss_position are about 10 times too small" in text and 'class="verdict warn"' in text


# ---- outages and sweeps ----


def test_an_outage_tells_its_share_of_the_distance():
    t = np.arange(0.0, 100.0, 0.1)
    drift = np.clip(t - 40.0, 0.0, 20.0)[:, None] * [0.05, 0.0, 0.0]
    nav = Navigation(track(t, straight(t) + drift, v_n=np.tile([1.0, 2.0, 0.5], (len(t), 1))))
    true = reference(t, straight(t))
    rows = true.where((t >= 40.0) & (t <= 60.0) & (np.arange(len(t)) % 10 == 0))
    rows.name = "gnss"
    length = 20.0 * np.sqrt(5.0)
    for judge in (true, None):
        entry = outages.outage(nav, rows, "gnss", 40.0, 60.0, judge)
        assert entry["distance_m"] == pytest.approx(length, rel=0.01)
        assert entry["percent_of_distance"] == pytest.approx(100.0 * 1.0 / length, rel=0.02)
    entry = outages.outage(nav, rows, "speed", 40.0, 60.0)
    assert entry["distance_m"] == pytest.approx(length, rel=0.05) and entry["percent_of_distance"] is None


def test_a_sweep_keeps_its_windows_and_the_page_draws_them():
    t = np.arange(0.0, 600.0, 1.0)
    rows = reference(t, straight(t))
    rows.name = "gnss"

    def judge(nav, withheld, start, end):
        return {
            "start_s": start, "end_s": end, "horizontal_end_m": 0.1 * start, "smoother_horizontal_max_m": 1.0,
            "nees_half_end": 1.0, "percent_of_distance": 2.0, "sigma_end_m": 3.0, "rows": len(withheld),
        }  # fmt: skip

    told, _ = sweep({"gnss": rows}, "gnss", (30.0, 60.0), 60.0, lambda tables: None, judge, lambda step: None)
    assert [len(s["entries"]) for s in told] == [s["windows"] for s in told]
    starts = [e["start_s"] for e in told[0]["entries"]]
    assert starts == sorted(starts) and "rows" not in told[0]["entries"][0]
    assert told[0]["filter_end_percent"] == {"p50": 2.0, "p95": 2.0} and told[0]["sigma_end_m"]["p50"] == 3.0
    result = fake()
    result.summary["sweep"] = told
    text = page(result)
    assert 'id="fig-sweep"' in text and 'id="fig-sweep-time"' in text
    for s in told:  # as an older version wrote it
        del s["entries"], s["filter_end_percent"], s["sigma_end_m"]
    text = page(result)
    assert 'id="fig-sweep"' not in text and "Outages slid over the recording" in text


def test_consistency_figures_of_a_run_hold_the_added_keys():
    nis = consistency(None, {"depth": innovations("depth", 1.0, d=1)})["nis"]["depth"]
    assert {"mean", "low", "high", "n", "dof", "left_out", "median", "sigma_factor"} == set(nis)
