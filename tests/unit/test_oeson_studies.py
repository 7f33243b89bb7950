"""The thesis's flights and listings as studies: the files are the cases; what is true is not what a filter is told."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from schuler.ground.units import DEG_PER_H, UG
from schuler.published.sins_filters import FAULTS as WRONG
from schuler.published.sins_filters import table_lines
from schuler.published.sins_filters_kept import KEPT
from schuler.studies.aided_mapping import aided_settings
from schuler.studies.model import load_study, parse_study
from schuler.studies.oeson import CASES, FAULTS, PATHS
from schuler.studies.oeson_runs import STATES, Runner
from schuler.studies.simulated import simulation

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
FLOWN = ("unaided", "landmarks-1px-6", "landmarks-5px-6", "landmarks-5px-1", "gap-300", "false-5-percent")
FILES = {f"oeson/{path}-{case}.toml": (case, path) for path in PATHS for case in FLOWN}
FILES |= {f"listing-a2/{x}.toml": (f"a2-{x}", "straight") for x in ("printed", "consistent", "zeroed")}
FILES |= {
    f"listing-a3/{x}.toml": (f"a3-{x}", "straight") for x in ("printed", "consistent", "correlated-15", "correlated-18")
}


@pytest.mark.parametrize("name", FILES)
def test_the_files_are_the_cases(name):
    case, path = FILES[name]
    assert load_study(EXAMPLES / name).model_dump() == parse_study(CASES[case].raw(path)).model_dump()


def test_what_is_true_is_not_what_the_filter_is_told():
    study = parse_study(CASES["a3-printed"].raw("turns"))
    told, real = aided_settings(study), simulation(study)
    np.testing.assert_allclose(told.gyro_bias_std, 0.05 * DEG_PER_H)
    np.testing.assert_allclose(real.imu.gyro_offset, np.array([1.0, 1.5, -2.0]) * DEG_PER_H)
    np.testing.assert_allclose(real.imu.accel_offset, np.array([200.0, 150.0, -100.0]) * UG)
    assert not np.any(real.imu.gyro_bias) and not np.any(told.gyro_arw)
    np.testing.assert_allclose(np.array(real.imu.arw) * 60.0, np.deg2rad([0.09, 0.05, 0.04]))
    assert told.start.std_heading == pytest.approx(1e-4, rel=1e-5)
    assert real.suite.start_std[8] == pytest.approx(1e-3, rel=1e-5)
    assert not told.gate


def test_true_errors_of_the_fixes_are_drawn_although_no_state_is_theirs():
    a, b, c = (
        simulation(parse_study(CASES[f"a3-{n}"].raw("straight"))).suite.gnss_correlated
        for n in ("consistent", "correlated-15", "correlated-18")
    )
    assert (a, b) == ((0.0, 0.0, 0.0), (2.0, 2.0, 3.0)) and b == c


def test_fixes_of_two_numbers():
    study = parse_study(CASES["a2-consistent"].raw("straight") | {"trajectory": {"preset": "legs", "duration_s": 20.0}})
    assert "height" not in simulation(study).record(1).tables["gnss"]


def test_the_turns_are_those_of_the_thesis():
    """30.6 deg right, then left, from 100 to 160 s of every 300 s; roll = atan(V rate / g)."""
    path = simulation(parse_study(CASES["unaided"].raw("turns"))).trajectory
    heading = np.array([np.degrees(np.arctan2(v[1], v[0])) for v in path.at([99.0, 161.0, 399.0, 461.0]).v_n])
    np.testing.assert_allclose(heading, [0.0, 30.6, 30.6, 0.0], atol=0.01)


def test_a_fault_changes_the_filter_and_not_the_flight():
    for name, case in FAULTS.items():
        base = CASES["a2-consistent" if name.startswith("a2") else "a3-consistent"]
        fault, clean = (parse_study(c.raw("turns")) for c in (case, base))
        assert aided_settings(fault) != aided_settings(clean) or "16-18" in name, name
        a, b = simulation(fault), simulation(clean)
        assert a.imu == b.imu and a.suite.start_std == b.suite.start_std, name


def test_a_run_is_repeatable_and_told_in_the_table_s_units():
    runner = Runner(CASES["unaided"], "straight")
    a, b, c = (runner.run(seed) for seed in (1, 1, 2))
    assert np.array_equal(a.square, b.square) and not np.array_equal(a.square, c.square)
    assert len(a.ratio) == len(STATES)
    assert 100.0 < np.sqrt(a.square[0]) < 8000.0 and a.end > np.sqrt(a.square[0])


@pytest.mark.parametrize("faults", [False, True])
def test_the_page_shows_what_is_kept(faults):
    page = (EXAMPLES.parent / "docs" / "optics.md").read_text(encoding="utf-8")
    assert "\n".join(table_lines(faults)) in page, "renew it: python benchmarks/oeson.py --page"


def test_all_that_is_told_is_kept():
    alone = [name for name, case in FAULTS.items() if case not in CASES.values()]
    told = {f"{case} {path}" for case in [*CASES, *alone] for path in PATHS}
    assert told == set(KEPT)
    assert {key for key, _, _ in WRONG.values()} <= {name.rsplit(" ", 1)[0] for name in KEPT}
