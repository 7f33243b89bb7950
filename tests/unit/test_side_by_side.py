"""Results side by side: names, best figures, differences of tracks, folders of other versions and of none."""

import json

import numpy as np
import pytest

from schuler.ground.earth import WGS84
from schuler.ground.errors import InputError
from schuler.io.read_results import read_results, read_track
from schuler.judging.side_by_side import Row, Stored, Track, difference, name_results, printable, rows, same_clock
from schuler.report.compare import compare_page
from schuler.studies.compare import Comparison, compare_results

SUMMARY = {
    "study": {"name": "trial", "kind": "aided"},
    "made_by": {"version": "0.0.1", "seed": 7, "study_sha256": "ab" * 32},
}
PLACE = (np.radians(36.73), np.radians(52.65))


def stored(folder="one", label="", track=None, **more):
    tracks = {} if track is None else {"filter": track}
    return Stored(
        folder if not isinstance(folder, str) else __import__("pathlib").Path(folder),
        {**SUMMARY, **more},
        tracks,
        [],
        label,
    )


def track(time, ned, heading=0.0, place=PLACE, std=1.0):
    n = len(time)
    lat, lon, height = WGS84.displace(np.full(n, place[0]), np.full(n, place[1]), np.zeros(n), np.asarray(ned, float))
    rpy = np.column_stack([np.zeros(n), np.zeros(n), np.mod(np.broadcast_to(heading, n), 2 * np.pi)])
    return Track(
        np.asarray(time, float), lat, lon, height, np.zeros((n, 3)), rpy, np.full((n, 3), std), np.full((n, 3), 0.01)
    )


def write(folder, summary=SUMMARY, solution=None):
    folder.mkdir(parents=True)
    (folder / "summary.json").write_text(json.dumps(summary))
    if solution is not None:
        (folder / "solution.csv").write_text(solution)
    return folder


# ---- figures ----


def test_the_best_of_a_row_is_what_its_figure_asks_for():
    assert Row("", "rms", "m", (3.0, 1.0, None, 1.0), "low").best == {1, 3}
    assert Row("", "NEES", "", (0.2, 3.0, 30.0), "one").best == {1}  # a factor of 3 is nearer than one of 5
    assert Row("", "inside", "%", (95.0, 99.9, 100.0), "share").best == {1}
    assert Row("", "duration", "s", (3.0, 1.0), "").best == set()
    assert Row("", "rms", "m", (3.0, None), "low").best == set()
    assert Row("", "rms", "m", (3.0, 3.0), "low").best == set()
    assert Row("", "NEES", "", (0.0, 2.0), "one").best == {1}


def test_rows_take_what_each_summary_has_and_nothing_that_is_no_number():
    first = stored(
        duration_s=10.0,
        errors={"filter": {"horizontal_m": {"rms": 2.0}}, "smoother": None},
        sweep=[{"length_s": 30, "windows": 4, "filter_end_m": {"p50": 1.5, "p95": None}, "nees_half": 0.9}],
        outages=[{"sensor": "gnss", "start_s": 1, "end_s": 3, "horizontal_end_m": 4.0}, "nonsense"],
        future={"new_figure_m": 3.5, "deeper": {"x": 1}},
        consistency={"nis": {"gnss_position": {"mean": 1.1, "left_out": 0}, "odd": 3}},
    )
    second = stored(
        duration_s="ten", errors=[1, 2], sweep={"a": 1}, outages=None, consistency={"nis": [1]}, future=float("nan")
    )
    found = {row.label: row.values for row in rows([first, second])}
    assert found["duration"] == (10.0, None)
    assert found["filter: horizontal, rms"] == (2.0, None)
    assert found["30 s: filter: error at the end, median"] == (1.5, None)
    assert "30 s: filter: error at the end, 95 %" not in found
    assert found["gnss 1 … 3 s: filter: error at the end"] == (4.0, None)
    assert found["NIS of gnss position"] == (1.1, None)
    assert found["future: new figure m"] == (3.5, None)


def test_names_are_made_different_and_harmless():
    results = [stored("a/x"), stored("b/x"), stored("c/y"), stored("d/z", study={"name": "other\x1b[2J\nname"})]
    name_results(results)
    assert [r.label for r in results[:3]] == ["trial (a/x)", "trial (b/x)", "trial (c/y)"]
    assert results[3].label == "other [2J name"
    same = [stored("a"), stored("a")]
    name_results(same)
    assert same[0].label != same[1].label
    assert len(printable("x" * 500)) == 60


# ---- tracks ----


def test_a_difference_is_the_first_minus_the_second_in_ned_metres():
    t = np.arange(0.0, 20.0, 0.1)
    path = np.outer(t, (10.0, 3.0, 0.2))
    coarse = t[::4] + 0.03
    d = difference(
        track(t, path + [3.0, -4.0, 1.0], heading=0.01), track(coarse, np.outer(coarse, (10.0, 3.0, 0.2)), -0.01)
    )
    np.testing.assert_allclose(d.ned, np.tile([3.0, -4.0, 1.0], (len(d.time), 1)), atol=1e-3)
    np.testing.assert_allclose(d.heading, 0.02, atol=1e-12)  # across north
    assert d.time[0] >= coarse[0] and d.time[-1] <= coarse[-1]
    assert d.told()["horizontal_m"]["rms"] == pytest.approx(5.0, abs=1e-3)


def test_gaps_are_not_bridged_and_nothing_is_made_up():
    t = np.arange(0.0, 20.0, 0.1)
    path = np.outer(t, (10.0, 0.0, 0.0))
    kept = (t < 5.0) | (t > 9.0)
    d = difference(track(t, path), track(t[kept], path[kept]))
    assert not ((d.time > 5.0) & (d.time < 8.95)).any() and d.horizontal.max() < 1e-6
    assert difference(track(t, path), track(t + 100.0, path)) is None
    assert difference(track(t, path), track(t, path, place=(0.1, 0.2))) is None
    assert same_clock([stored(track=track(t, path)), stored(track=track(t + 5.0, path))])
    assert not same_clock([stored(track=track(t, path)), stored(track=track(t + 100.0, path))])


# ---- folders ----


def test_folders_that_are_no_results_are_named_all_at_once(tmp_path):
    good = write(tmp_path / "good")
    (tmp_path / "empty").mkdir()
    (tmp_path / "allan").mkdir()
    (tmp_path / "allan" / "allan.json").write_text("{}")
    write(tmp_path / "foreign", {"hello": 1})
    (write(tmp_path / "broken") / "summary.json").write_text('{"study": ')
    with pytest.raises(InputError) as error:
        read_results(
            [
                good,
                tmp_path / "empty",
                tmp_path / "allan",
                tmp_path / "foreign",
                tmp_path / "broken",
                tmp_path / "none",
                tmp_path,
            ]
        )
    sentences = str(error.value).splitlines()
    words = (
        "no summary.json",
        "Allan deviation",
        "not written by schuler",
        "damaged",
        "no such folder",
        "schuler compare",
    )
    assert len(sentences) == 6
    for sentence, word in zip(sentences, words, strict=True):
        assert word in sentence


def test_deep_json_and_large_files_are_refused(tmp_path, monkeypatch):
    (write(tmp_path / "deep") / "summary.json").write_text("[" * 100_000)
    with pytest.raises(InputError, match="damaged"):
        read_results([tmp_path / "deep"])
    write(tmp_path / "large")
    monkeypatch.setattr("schuler.io.read_results.SUMMARY_BYTES", 10)
    with pytest.raises(InputError, match="larger"):
        read_results([tmp_path / "large"])


def test_a_track_that_cannot_be_read_costs_only_the_track(tmp_path, monkeypatch):
    text = "time[s],lat[deg],lon[deg]\n0.0,1.0,2.0\n1.0,1.0,2.0\n"
    folders = [write(tmp_path / "a", solution=text), write(tmp_path / "b", solution="\x00\x01"), write(tmp_path / "c")]
    folders.append(write(tmp_path / "d", solution="when,where\n1,2\n3,4\n"))
    a, b, c, d = read_results(folders)
    assert len(a.tracks["filter"]) == 2 and not a.notes
    assert not b.tracks and "left out" in b.notes[0]
    assert not c.tracks and "solution.csv" in c.notes[0]
    assert not d.tracks and "time[s]" in d.notes[0]
    monkeypatch.setattr("schuler.io.read_results.TRACK_BYTES", 20)
    assert "MiB" in read_results(folders[:1])[0].notes[0]


def test_tracks_are_read_with_whatever_columns_and_rows_they_have(tmp_path):
    file = tmp_path / "solution.csv"
    file.write_text(
        "time[s],heading[deg],std_heading[deg],odd[furlong]\n0,350,1,3\n1,10,1,3\n0.5,20,1,3\nnan,1,1,3\n2,30,2,3\n"
    )
    t = read_track(file)
    assert t.time.tolist() == [0.0, 1.0, 2.0] and not t.placed
    np.testing.assert_allclose(np.degrees(t.rpy[:, 2]), [350, 10, 30])
    file.write_text("time[s],north[m],east[m]\n0,0,0\n1,3,4\n")
    plane = read_track(file)
    assert plane.local and plane.placed
    ned = WGS84.displacement_n(plane.lat[1], plane.lon[1], 0.0, 0.0, 0.0, 0.0)
    np.testing.assert_allclose(ned[:2], [3.0, 4.0], atol=1e-6)
    assert difference(plane, track([0.0, 1.0], np.zeros((2, 3)))) is None


def test_many_rows_are_thinned_and_the_last_is_kept(tmp_path, monkeypatch):
    body = "".join(f"{k},1.0,2.0\n" for k in range(100))
    folder = write(tmp_path / "a", solution="time[s],lat[deg],lon[deg]\n" + body)
    monkeypatch.setattr("schuler.io.read_results.ROWS", 60)
    result = read_results([folder])[0]
    assert len(result.tracks["filter"]) <= 31 and result.tracks["filter"].time[-1] == 99.0
    assert "every row of 4" in result.notes[0]


def test_a_folder_given_twice_is_shown_once(tmp_path):
    folder = write(tmp_path / "a")
    found = read_results([folder, tmp_path / "a" / ".." / "a"])
    assert len(found) == 1 and "twice" in found[0].notes[0]


# ---- page and terminal ----


def test_the_page_escapes_every_name_and_stands_alone(tmp_path):
    bad = "<img src=x onerror=alert(1)>"
    summary = {
        **SUMMARY,
        "study": {"name": bad, "kind": bad},
        "method": bad,
        "notes": [bad],
        "states": {bad: {"value": 1.0, "unit": bad}},
    }
    text = "time[s],lat[deg],lon[deg]\n0.0,1.0,2.0\n1.0,1.0,2.0\n"
    found = compare_results([write(tmp_path / "a", summary, text), write(tmp_path / "b", summary, text)])
    page = found.page()
    assert "<img src=x" not in page and "&lt;img src=x" in page
    assert "https://" not in page
    assert page == found.page()


def test_twenty_results_are_laid_over_several_tables():
    t = np.arange(0.0, 5.0, 0.5)
    results = [stored(f"r{k}", f"r{k}", track(t, np.outer(t, (1.0, k, 0.0))), duration_s=float(k)) for k in range(20)]
    page = compare_page(results, {"version": "0", "seed": None, "study_sha256": ""})
    assert page.count("<th>r19</th>") >= 1 and page.count('<th class="left">figure</th>') == 4
    lines = Comparison(results, rows(results)).lines(60)
    assert max(map(len, lines)) <= 60
    assert sum(line.startswith("duration") for line in lines) > 3


def test_tracks_of_different_places_are_said_so_and_not_drawn_over_each_other():
    t = np.arange(0.0, 5.0, 0.5)
    here, there = track(t, np.outer(t, (1.0, 0.0, 0.0))), track(t, np.outer(t, (1.0, 0.0, 0.0)), place=(0.1, 0.2))
    page = compare_page(
        [stored("a", "a", here), stored("b", "b", there)], {"version": "0", "seed": None, "study_sha256": ""}
    )
    assert "b lies elsewhere" in page and "No other track shares time and place with that of a" in page
