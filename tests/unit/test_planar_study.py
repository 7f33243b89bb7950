"""Studies of kind "planar" from files: metres and degrees, what is written, outages, what bad input gets."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest

from schuler.ground.errors import InputError, StudyError
from schuler.io.tables import read_table
from schuler.studies.model import load_study
from schuler.studies.run import run_study

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from planar_runs import BEACONS, PLANE, simulate  # noqa: E402

TABLES = {"speed": "speed.csv", "ranges": "ranges.csv", "landmarks": "landmarks.csv", "reference": "reference.csv"}


def write(path, **columns):
    rows = zip(*columns.values(), strict=True)
    text = ",".join(columns) + "\n" + "".join(",".join(str(v) for v in row) + "\n" for row in rows)
    path.write_text(text, encoding="utf-8")


def study_of(folder, run, *, metres=True, more="", inputs=None, shift=(0.0, 0.0)):
    """The files of a run and its study."""
    log, r = run.tables["speed"], run.tables["ranges"]
    write(folder / "speed.csv", **{"time[s]": log.time, "speed[m/s]": log["speed"], "dheading[rad]": log["dheading"]})
    write(folder / "ranges.csv", **{"time[s]": r.time, "id": r["id"], "range[m]": r["range"]})

    def place(north, east):
        if metres:
            return {"north[m]": np.asarray(north) + shift[0], "east[m]": np.asarray(east) + shift[1]}
        lat, lon = PLANE.geodetic(north, east)
        return {"lat[deg]": [f"{v:.12f}" for v in np.degrees(lat)], "lon[deg]": [f"{v:.12f}" for v in np.degrees(lon)]}

    write(folder / "landmarks.csv", id=["0", "1", "2", "3"], **place(BEACONS[:, 0], BEACONS[:, 1]))
    heading = np.degrees(run.heading) % 360.0
    write(
        folder / "reference.csv",
        **{"time[s]": run.time, **place(run.place[:, 0], run.place[:, 1]), "heading[deg]": heading},
    )
    named = "\n".join(f'{k} = "{v}"' for k, v in (inputs or TABLES).items())
    text = f'[study]\nname = "drive"\nkind = "planar"\n[input]\n{named}\n{more}'
    (folder / "study.toml").write_text(text, encoding="utf-8")
    return load_study(folder / "study.toml")


@pytest.fixture(scope="module")
def run():
    return simulate(2, seconds=150.0)


def test_metres_in_metres_out(run, tmp_path):
    result = run_study(study_of(tmp_path, run))
    out = result.write(tmp_path / "out")
    head = (out / "solution.csv").read_text().splitlines()[0]
    assert head.startswith("time[s],north[m],east[m],v_north[m/s],v_east[m/s],heading[deg],std_north[m],std_east[m]")
    assert "lat" not in head and "height" not in head and "roll" not in head
    back = read_table(out / "solution.csv", "solution")
    row = np.searchsorted(run.time, back.time - 1e-6)
    size = np.hypot(back["north"] - run.place[row, 0], back["east"] - run.place[row, 1])
    rms = float(np.sqrt(np.mean(size**2)))
    summary = json.loads((out / "summary.json").read_text())
    assert summary["errors"]["filter"]["horizontal_m"]["rms"] == pytest.approx(rms, rel=1e-3)
    assert rms < 1.0 and summary["errors"]["filter"]["heading_deg"]["rms"] < 10.0
    assert summary["errors"]["filter"]["vertical_m"] is None
    assert {"range"} <= set(summary["consistency"]["nis"]) and len(summary["beacons"]) == 4
    assert "<coordinates>" not in (out / "track.kml").read_text()  # nobody said where on the Earth
    page = (out / "report.html").read_text()
    assert "Metres north and east as in the tables" in page and "beacon" in page


def test_degrees_give_the_same_track(run, tmp_path):
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    one = run_study(study_of(tmp_path / "a", run))
    two = run_study(study_of(tmp_path / "b", run, metres=False))
    a, b = (r.summary["errors"]["smoother"]["horizontal_m"]["rms"] for r in (one, two))
    assert a == pytest.approx(b, abs=1e-3)
    out = two.write(tmp_path / "out")
    assert (out / "solution.csv").read_text().startswith("time[s],lat[deg],lon[deg],v_north[m/s]")
    assert "<coordinates>" in (out / "track.kml").read_text()


def test_metres_of_a_map_grid(run, tmp_path):
    """Large numbers lose nothing."""
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    one = run_study(study_of(tmp_path / "a", run))
    grid = run_study(study_of(tmp_path / "b", run, shift=(5.82e6, 3.9e5)))
    key = ("errors", "filter", "horizontal_m", "rms")
    assert _at(one.summary, key) == pytest.approx(_at(grid.summary, key), abs=2e-3)
    out = grid.write(tmp_path / "out")
    back = read_table(out / "solution.csv", "solution")
    assert 5.8199e6 < back["north"][0] < 5.8201e6


def _at(thing, keys):
    for key in keys:
        thing = thing[key]
    return thing


def test_a_start_in_metres_and_one_on_the_earth(run, tmp_path):
    place = run.place[0]
    typed = f"[start]\nnorth_m = {place[0]}\neast_m = {place[1]}\nheading_deg = {np.degrees(run.heading[0]) % 360}\n"
    result = run_study(study_of(tmp_path, run, more=typed))
    assert result.navigation.filter.time[0] < 0.5 and not any("start:" in n for n in result.notes)
    # with lat and lon the metres are counted from there, and the result is on the Earth
    result = run_study(
        study_of(tmp_path, run, more="[start]\nlat_deg = 50.0\nlon_deg = 8.0\nstd_north_m = 100\nstd_east_m = 100\n")
    )
    out = result.write(tmp_path / "out")
    assert (out / "solution.csv").read_text().startswith("time[s],lat[deg],lon[deg],north[m],east[m]")
    assert result.navigation.filter.lat[0] == pytest.approx(np.radians(50.0), abs=1e-4)


def test_outage_and_sweep_of_the_ranges(run, tmp_path):
    more = '[[outage]]\nsensor = "ranges"\nstart_s = 60\nend_s = 110\n'
    more += '[sweep]\nsensor = "ranges"\nlength_s = 20\nsettle_s = 40\n'
    result = run_study(study_of(tmp_path, run, more=more))
    (outage,) = result.summary["outages"]
    assert outage["horizontal_end_m"] > 0.0 and outage["nees_half_end"] < 8.0
    assert outage["smoother_horizontal_max_m"] < outage["horizontal_max_m"]
    (entry,) = result.summary["sweep"]
    assert entry["windows"] >= 3 and entry["filter_end_m"]["p50"] > 0.0
    assert not ((result.tables["ranges"].time >= 60) & (result.tables["ranges"].time <= 110)).any()


def test_an_outage_of_the_odometer(run, tmp_path):
    more = '[[outage]]\nsensor = "speed"\nstart_s = 80\nend_s = 90\n'
    result = run_study(study_of(tmp_path, run, more=more))
    assert any("the longest 10" in n for n in result.notes)
    assert result.summary["consistency"]["nees_position"] < 3.0


def test_estimate_is_kept_to(run, tmp_path):
    more = '[filter]\nestimate = ["range_scale", "current"]\nsmoother = false\n'
    result = run_study(study_of(tmp_path, run, more=more))
    assert set(result.summary["states"]) == {"range_scale"} and result.summary["errors"]["smoother"] is None
    assert any("does not learn current" in n for n in result.notes)


@pytest.mark.parametrize(
    "change,error,says",
    [
        ({"inputs": {"ranges": "ranges.csv", "landmarks": "landmarks.csv"}}, StudyError, "needs odometry"),
        ({"inputs": {k: v for k, v in TABLES.items() if k != "landmarks"}}, InputError, "landmarks.csv"),
        ({"more": "[start]\nnorth_m = 1.0\n"}, StudyError, "type both north_m and east_m"),
        ({"inputs": {"speed": "speed.csv"}}, InputError, "no start was found"),
        ({"metres": False, "more": "[start]\nnorth_m = 1.0\neast_m = 2.0\n"}, StudyError, "type lat_deg and lon_deg"),
    ],
)
def test_bad_studies_get_a_sentence(run, tmp_path, change, error, says):
    with pytest.raises(error, match=says):
        run_study(study_of(tmp_path, run, **change))


def test_dead_reckoning_in_metres(run, tmp_path):
    more = "[start]\nnorth_m = 0.0\neast_m = 0.0\nheading_deg = 0.0\n"
    result = run_study(study_of(tmp_path, run, more=more, inputs={"speed": "speed.csv"}))
    assert result.navigation.extras["metres"] is not None
    assert result.write(tmp_path / "out").is_dir()


def test_mixed_places_are_refused(run, tmp_path):
    study_of(tmp_path, run)
    lat, lon = PLANE.geodetic(run.place[::5, 0], run.place[::5, 1])
    write(tmp_path / "gnss.csv", **{"time[s]": run.time[::5], "lat[deg]": np.degrees(lat), "lon[deg]": np.degrees(lon)})
    study = study_of(tmp_path, run, inputs={**TABLES, "gnss": "gnss.csv"})
    with pytest.raises(InputError, match="landmarks, reference in north and east, gnss in lat and lon"):
        run_study(study)


def test_rows_out_of_order_are_sorted_and_told(run, tmp_path):
    study_of(tmp_path, run)
    lines = (tmp_path / "ranges.csv").read_text().splitlines()
    lines[10], lines[11] = lines[11], lines[10]
    text = "\n".join(lines)
    study = study_of(tmp_path, run)
    (tmp_path / "ranges.csv").write_text(text)
    result = run_study(study)
    assert any("out of order" in n for n in result.notes)
