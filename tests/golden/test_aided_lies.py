"""GNSS that lies, on a real drive: jumps and walks off; ten seconds after its end the filter is as good as without."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest

from schuler.aiding.aided import navigate, settled
from schuler.ground.tables import Table
from schuler.judging.distrust import distrusted
from schuler.studies.aided_mapping import aided_settings
from schuler.studies.inputs import to_body
from schuler.studies.model import parse_study

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "car-rtk-mems"
pytestmark = [pytest.mark.data, pytest.mark.slow]
R = 6.37e6
FROM, LAST = 150.0, 330.0  # s of the recording that is used
BEGIN = 230.0


@pytest.fixture(scope="module")
def drive(data_folder):
    """The study of the example and its tables in body axes, three minutes of them."""
    import tomllib

    spec = importlib.util.spec_from_file_location("prepare_car_rtk", EXAMPLE / "prepare.py")
    prepare = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(prepare)
    imu, gnss, _ = prepare.read(data_folder / "car_rtk_mems")
    study = parse_study(tomllib.loads((EXAMPLE / "study.toml").read_text(encoding="utf-8")))
    tables = {t.name: t.where((t.time >= FROM) & (t.time <= LAST)) for t in (imu, gnss)}
    to_body(study, tables)
    settings, _ = settled(tables, aided_settings(study))
    return tables, settings


def lied(gnss: Table, begin: float, seconds: float, jump: float, walk: float, velocity: bool) -> Table:
    """The fixes with an offset to the north-east; with velocity where it is told too."""
    columns = {name: values.copy() for name, values in gnss.columns.items()}
    t = gnss.time
    mine = (t >= begin) & (t < begin + seconds)
    off = np.where(mine, jump + walk * (t - begin), 0.0) / np.sqrt(2.0)
    columns["lat"] += off / R
    columns["lon"] += off / R / np.cos(columns["lat"])
    if velocity:
        rate = np.where(mine, walk if walk else jump / seconds, 0.0) / np.sqrt(2.0)
        columns["v_north"] += rate
        columns["v_east"] += rate
    return Table(gnss.name, columns, gnss.kind, gnss.source, gnss.notes)


def error_at(run, fixes: Table, begin: float, end: float) -> float:
    """Rms of the horizontal difference to the true fixes between two instants, m."""
    s = run.filter
    part = fixes.where((fixes.time >= begin) & (fixes.time <= end))
    delay = run.states["gnss_delay"].value[-1] if "gnss_delay" in run.states else 0.0
    north = (np.interp(part.time - delay, s.time, s.lat) - part["lat"]) * R
    east = (np.interp(part.time - delay, s.time, s.lon) - part["lon"]) * R * np.cos(part["lat"])
    return float(np.sqrt(np.mean(north**2 + east**2)))


LIES = {
    "a jump of 50 m for 10 s": (10.0, 50.0, 0.0, False),
    "a jump of 50 m for 10 s, velocity too": (10.0, 50.0, 0.0, True),
    "a walk of 1 m/s for 30 s": (30.0, 0.0, 1.0, False),
    "a walk of 1 m/s for 30 s, velocity too": (30.0, 0.0, 1.0, True),
}


@pytest.fixture(scope="module")
def clean(drive):
    tables, settings = drive
    return navigate(tables, settings)


@pytest.mark.parametrize("name", LIES)
def test_ten_seconds_after_a_lie_the_filter_is_as_good_as_without(drive, clean, name):
    tables, settings = drive
    seconds, jump, walk, velocity = LIES[name]
    gnss = lied(tables["gnss"], BEGIN, seconds, jump, walk, velocity)
    run = navigate(tables | {"gnss": gnss}, settings)
    end = BEGIN + seconds
    span = (end + 10.0, end + 20.0)
    found, plain = (error_at(r, tables["gnss"], *span) for r in (run, clean))
    worst = error_at(run, tables["gnss"], BEGIN, end)
    told = [e for e in distrusted(run.innovations) if e["sensor"].startswith("gnss")]
    print(f"{name}: {found:.3f} m, clean {plain:.3f} m, rms during the lie {worst:.2f} m, {told}")
    assert found < 3.0 * plain + 0.02
    assert told and any(e["start_s"] < end and e["end_s"] > BEGIN for e in told)
    assert worst < 0.5 * (jump or 0.58 * walk * seconds)


def test_a_wrong_arm_is_told_although_delays_and_mounting_take_it_in(drive):
    """Off by 1.8 m: the true arm is found to 15 cm by the second look, and the right arm raises no word."""
    from dataclasses import replace

    from schuler.studies.arm_notes import second_look

    tables, settings = drive

    def look(arm):
        s = replace(settings, antenna=arm, smoother=False)
        return second_look(navigate(tables, s), s, lambda other: navigate(tables, other))

    (words,) = look((1.5, -1.0, 0.0))
    said = [float(x) for x in words.split("type antenna_frd_m = [")[1].split("]")[0].split(",")]
    assert np.linalg.norm(np.array(said[:2]) - settings.antenna[:2]) < 0.15
    assert look(settings.antenna) == []
