"""The result folder: complete or not at all, older ones replaced, anything else refused; files that others can read."""

import json
import math
import time
from xml.etree import ElementTree

import numpy as np
import pytest

from schuler.aiding.solution import Navigation, Solution
from schuler.ground.errors import InputError
from schuler.io import results

COLUMNS = (
    "time[s],lat[deg],lon[deg],height[m],v_north[m/s],v_east[m/s],v_down[m/s],roll[deg],pitch[deg],heading[deg],"
    "std_north[m],std_east[m],std_down[m],std_v_north[m/s],std_v_east[m/s],std_v_down[m/s],"
    "std_roll[deg],std_pitch[deg],std_heading[deg]"
)


def solution(n=200, lon=0.9):
    rng = np.random.default_rng(4)
    cov = np.broadcast_to(np.diag([4.0, 9.0, 16.0]), (n, 3, 3))
    return Solution(
        np.arange(n) * 0.1,
        0.64 + 1e-7 * np.arange(n),
        lon + 1e-7 * np.arange(n),
        rng.normal(size=n),
        rng.normal(size=(n, 3)),
        rng.normal(size=(n, 3)),
        cov,
        cov,
        cov * 1e-4,
    )


SUMMARY = {"study": {"name": "x", "kind": "auv"}, "made_by": {"version": "0"}, "errors": {"filter": math.nan}}


def write(out, **more):
    return results.write_results(out, Navigation(solution(), solution()), SUMMARY, page="<html></html>", **more)


def left_beside(path):
    return sorted(p.name for p in path.iterdir())


def test_a_folder_has_the_contract_s_files(tmp_path):
    out = write(tmp_path / "r")
    assert left_beside(out) == ["report.html", "smoothed.csv", "solution.csv", "summary.json", "track.kml"]
    assert left_beside(tmp_path) == ["r"]


def test_solution_csv_has_the_contract_s_columns_and_digits(tmp_path):
    s = solution()
    results.write_track(tmp_path / "s.csv", s)
    lines = (tmp_path / "s.csv").read_text().splitlines()
    assert lines[0] == COLUMNS
    assert len(lines[1].split(",")[1].split(".")[1]) == 12
    back = np.loadtxt(tmp_path / "s.csv", delimiter=",", skiprows=1)
    np.testing.assert_allclose(np.radians(back[:, 1]), s.lat, atol=1e-14)
    np.testing.assert_allclose(back[:, 10:13], np.tile([2.0, 3.0, 4.0], (len(s), 1)), atol=1e-6)
    assert (back[:, 9] >= 0).all() and (back[:, 9] < 360.0).all()


def test_columns_that_a_kind_cannot_fill_are_left_out(tmp_path):
    s = solution()
    s.height = np.full(len(s), np.nan)
    s.cov_vel = np.full((len(s), 3, 3), np.nan)
    assert not any("height" in c or "std_v" in c for c in results.track_columns(s))
    assert list(results.track_columns(s))[:3] == ["time[s]", "lat[deg]", "lon[deg]"]


def test_the_same_track_gives_the_same_bytes(tmp_path):
    a, b = write(tmp_path / "a"), write(tmp_path / "b")
    for file in a.iterdir():
        assert file.read_bytes() == (b / file.name).read_bytes()


def test_a_minute_at_100_hz_is_written_in_a_blink(tmp_path):
    s = solution(6000)
    results.write_track(tmp_path / "warm.csv", s)
    start = time.perf_counter()
    results.write_track(tmp_path / "s.csv", s)
    assert time.perf_counter() - start < 0.5


def test_summary_is_json_that_any_reader_takes(tmp_path):
    def refuse(word):
        raise AssertionError(f"{word} is not JSON")

    text = (write(tmp_path / "r") / "summary.json").read_text()
    assert json.loads(text, parse_constant=refuse)["errors"]["filter"] is None
    told = results.plain({"a": np.float64(1.5), "b": (np.int64(2), np.bool_(True)), "c": np.array([np.inf, 1.0])})
    assert told == {"a": 1.5, "b": [2, True], "c": [None, 1.0]}


def test_an_older_result_is_replaced_whole(tmp_path):
    out = write(tmp_path / "r")
    (out / "leftover.txt").write_text("from the older result")
    write(out)
    assert "leftover.txt" not in left_beside(out) and left_beside(tmp_path) == ["r"]


@pytest.mark.parametrize("content", ["[1]", "{}", "not json", None])
def test_anything_else_is_refused_and_left_alone(tmp_path, content):
    out = tmp_path / "photos"
    out.mkdir()
    (out / "me.jpg").write_text("!")
    if content is not None:
        (out / "summary.json").write_text(content)
    before = left_beside(out)
    with pytest.raises(InputError, match="not a result folder"):
        write(out)
    assert left_beside(out) == before and left_beside(tmp_path) == ["photos"]


def test_a_file_in_the_way_is_refused(tmp_path):
    (tmp_path / "r").write_text("mine")
    with pytest.raises(InputError, match="not a folder"):
        write(tmp_path / "r")
    with pytest.raises(InputError, match="cannot be written"):
        write(tmp_path / "r" / "deeper")
    assert (tmp_path / "r").read_text() == "mine"


@pytest.mark.parametrize("trouble", [RuntimeError, KeyboardInterrupt])
def test_trouble_half_way_leaves_the_older_result_and_nothing_else(tmp_path, trouble):
    out = write(tmp_path / "r")
    (out / "old.txt").write_text("still here")
    with pytest.raises(trouble), results.result_folder(out) as folder:
        (folder / "half.txt").write_text("half")
        raise trouble
    assert "old.txt" in left_beside(out) and left_beside(tmp_path) == ["r"]


def test_kml_is_xml_with_any_name_and_keeps_apart_what_crosses_the_antimeridian():
    s = solution(lon=np.pi - 1e-5)
    text = results.kml_text('a <b> & "c" \x01', Navigation(s), [("fix & 1", 0.64, 0.9)])
    root = ElementTree.fromstring(text)
    space = {"k": "http://www.opengis.net/kml/2.2"}
    assert root.find("k:Document/k:name", space).text.startswith('a <b> & "c"')
    lines = root.findall(".//k:LineString/k:coordinates", space)
    assert len(lines) == 2
    lon = [[float(c.split(",")[0]) for c in line.text.split()] for line in lines]
    assert min(lon[0]) > 179 and max(lon[1]) < -179


def test_a_long_track_is_thinned_for_the_map_and_keeps_its_ends():
    s = solution(20_000)
    line = ElementTree.fromstring(results.kml_text("x", Navigation(s))).find(
        ".//k:LineString/k:coordinates", {"k": "http://www.opengis.net/kml/2.2"}
    )
    points = line.text.split()
    assert len(points) <= results.KML_POINTS
    assert float(points[-1].split(",")[1]) == pytest.approx(np.degrees(s.lat[-1]), abs=1e-8)
