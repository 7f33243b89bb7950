"""The study file: what it accepts, how each fault is said, and that its page agrees with the model."""

import tomllib
from importlib.resources import files
from math import radians
from pathlib import Path

import pytest

from schuler.ground.errors import StudyError
from schuler.studies.describe import renewed, sections
from schuler.studies.model import Study, load_study, parse_study

PAGE = Path(__file__).parents[2] / "docs" / "study-file.md"
AUV = {"study": {"name": "x", "kind": "auv"}, "mission": {"preset": "demo"}}


def faults_of(raw, folder=None):
    with pytest.raises(StudyError) as caught:
        parse_study(raw, folder)
    return caught.value.faults


def fault_of(section, **keys):
    """The one fault of a section in a study that is otherwise right."""
    found = faults_of({**AUV, section: keys})
    assert len(found) == 1, found
    return found[0]


# ---- what is accepted ----


def test_the_embedded_demo_is_a_study():
    raw = tomllib.loads((files("schuler.studies") / "demo.toml").read_text())
    assert parse_study(raw).mission.preset == "demo"


CONTRACT = """
[study]
name = "harbour trial 7"
kind = "aided"
[input]
imu = "imu.csv"
rate_hz = 100
scale_gyro_deg_per_s = 0.01
scale_accel_g = 0.001
declination_deg = -3
[start]
lat_deg = 36.73
heading_deg = 90.0
std_heading_deg = 2
[imu]
gyro_arw_deg_per_sqrt_h = 0.3
gyro_bias_deg_per_h = [10, 10, 20]
accel_x_lever_mm = [1, 2, 3]
calibration = "calibration.json"
[noise]
gnss_m = [1.0, 1.0, 2.0]
[mounting]
imu_to_body_rpy_deg = [0, 0, 0]
antenna_frd_m = [0, 0, -0.65]
[camera]
focal_px = 8889.0
body_to_camera_rpy_deg = [180, 0, 0]
[filter]
smoother = true
estimate = ["gyro_bias", "accel_bias", "current", "gnss_velocity_delay", "accel_misalignment"]
constraints = ["nhc", "zupt"]
vertical = "free"
[output]
rate_hz = "imu"
[[outage]]
sensor = "gnss"
start_s = 100.0
end_s = 620
[sweep]
sensor = "gnss"
length_s = [15, 30, 60]
settle_s = 60
[align]
from_s = 0.0
to_s = 300.0
[trajectory]
preset = "legs"
turns_deg = []
[errors]
gyro_bias_deg_per_h = 0.01
accel_bias_ug = [100, 0, 0]
[platform]
drift_deg_per_h = [0.01, 0.0, 0.1]
algorithms = ["strapdown"]
accel_bias_ug = [0, 0]
[platform.alignment]
damping = 0.8
settling_s = 300
[platform.map]
lat_deg = [-85.0, 85.0, 60]
"""


def test_every_section_of_the_contract_is_read():
    study = parse_study(tomllib.loads(CONTRACT))
    assert study.outage[0].end_s == 620.0
    assert study.errors.gyro_bias_deg_per_h == (0.01, 0.01, 0.01)
    assert study.platform.alignment.settling_s == 300 and study.platform.map.lat_deg == (-85.0, 85.0, 60.0)
    assert study.output.rate_hz == "imu" and study.sweep.length_s == (15, 30, 60)


def test_a_preset_of_a_mission_may_be_changed_and_an_imu_s_may_not():
    assert parse_study({**AUV, "mission": {"preset": "demo", "dives": 3}}).mission.dives == 3
    found = faults_of({**AUV, "imu": {"preset": "3dm-gx3-25", "gyro_bias_deg_per_h": 1.0}})
    assert len(found) == 1 and "never both" in found[0] and "gyro_bias_deg_per_h" in found[0]


def test_a_study_cannot_be_changed_by_accident():
    study = parse_study(AUV)
    with pytest.raises(Exception, match="frozen"):
        study.noise.speed_mps = 3.0


# ---- how faults are said ----


@pytest.mark.parametrize(
    ("section", "keys", "said"),
    [
        ("noise", {"speed_mps": "0.05 kn"}, '[noise] speed_mps: expects a number in m/s; came "0.05 kn"'),
        ("noise", {"speed_mps": "0.05 kn"}, "type speed_mps = 0.0257222"),
        ("noise", {"speed_mps": "0.05 furlong"}, "type speed_mps = 0.05"),
        ("noise", {"speed_mps": "0.05 m/s"}, "type speed_mps = 0.05"),
        ("noise", {"speed_mps": "0.05 m"}, "type speed_mps = 0.05"),
        ("noise", {"speed_mps": True}, "came true"),
        ("noise", {"speed_mps": 0.0}, "[noise] speed_mps: must be more than 0 m/s; came 0.0"),
        ("noise", {"sped_mps": 0.1}, "[noise] sped_mps: no such key; did you mean speed_mps? type speed_mps = 0.1"),
        ("noise", {"gnss_m": [1.0, 2.0]}, "[noise] gnss_m: expects three numbers [x, y, z] in m; came [1.0, 2.0]"),
        ("noise", {"gnss_m": [1.0, 2.0, -1.0]}, "[noise] gnss_m: a sigma must be more than 0"),
        ("noise", {"dvl_mps": float("nan")}, "[noise] dvl_mps: expects a finite number in m/s; came nan"),
        ("noise", {"lat_deg": 3.0}, "[noise] lat_deg: no such key here; it belongs under [start]"),
        ("start", {"lat_deg": 91}, "[start] lat_deg: must be at most 90 deg; came 91"),
        ("mission", {"dives": 2.5}, "[mission] dives: expects a whole number; came 2.5"),
        ("mission", {"preset": "dmo"}, 'did you mean "demo"?'),
        ("mission", {"l_shape": "yes"}, "[mission] l_shape: expects true or false"),
        ("filter", {"estimate": ["gyro_bais"]}, 'did you mean "gyro_bias"?'),
        ("output", {"rate_hz": "10 Hz"}, "type rate_hz = 10"),
        ("imu", {"gyro_bias_deg_per_h": -1.0}, "[imu] gyro_bias_deg_per_h: a sigma must be at least 0"),
        ("outage", {"sensor": "gnss"}, "[[outage]]: came as one table [outage]; type it with two brackets"),
        ("outage", [{"sensor": "gps", "start_s": 1, "end_s": 2}], "[[outage]] 1 sensor: expects one of"),
        ("outage", [{"sensor": "gnss", "start_s": 9, "end_s": 2}], "[[outage]] 1: end_s = 2 is not after start_s = 9"),
        ("outage", [{"sensor": "gnss", "start_s": 9}], "[[outage]] 1 end_s: missing"),
        ("align", {"from_s": 9, "to_s": 2}, "[align]: to_s = 2 is not after from_s = 9"),
        ("platform", {"alignment": {"dampin": 1.0}}, "[platform.alignment] dampin: no such key; did you mean damping?"),
        ("nois", {"speed_mps": 1.0}, "[nois]: no such section; did you mean [noise]?"),
        ("outages", [{"sensor": "gnss"}], "did you mean [[outage]]?"),
        ("speed_mps", 1.0, "stands outside every section; it belongs under [noise]"),
        ("imu", "imu.csv", "[imu]: expects a section"),
    ],
)
def test_a_fault_says_place_what_came_and_what_to_type(section, keys, said):
    found = faults_of({**AUV, section: keys})
    assert len(found) == 1, found
    assert said in found[0]
    assert "\n" not in found[0]


def test_all_faults_come_together_each_once():
    raw = {
        "study": {"nam": "x", "kind": "auf"},
        "noise": {"speed_mps": "a", "depth_m": -1},
        "outage": [{"sensor": "gnss", "start_s": 5, "end_s": 1}],
        "filter": {"smoother": 1},
        "mission": {"dives": "two"},
    }
    found = faults_of(raw)
    assert len(found) == len(set(found)) == 7, found


@pytest.mark.parametrize(
    ("raw", "said"),
    [
        ({"study": {"name": "x", "kind": "auv"}}, "names no table and there is no [mission]"),
        ({**AUV, "input": {"gnss": "g.csv", "imu": "i.csv"}}, "[mission]: came beside [input] gnss, imu"),
        ({"study": AUV["study"], "input": {"gnss": "g.csv"}}, "needs an imu or an attitude table"),
        ({"study": AUV["study"], "input": {"imu": "i.csv"}}, "[input] gnss: missing, and [start] does not say where"),
        ({"study": {"name": "a/b", "kind": "auv"}, "mission": {}}, "no slash"),
        ({"study": {"name": "x", "kind": "ahrs"}, "filter": {"method": "paper"}}, 'belongs to kind "auv"'),
    ],
)
def test_faults_between_sections(raw, said):
    assert any(said in f for f in faults_of(raw))


def test_files_that_do_not_exist_are_named(tmp_path):
    path = tmp_path / "s.toml"
    path.write_text('[study]\nname="x"\nkind="auv"\n[input]\nimu="i.csv"\ngnss="g.csv"\n')
    (tmp_path / "i.csv").write_text("")
    with pytest.raises(StudyError) as caught:
        load_study(path)
    assert len(caught.value.faults) == 1
    assert f'{path}: [input] gnss: "g.csv" does not exist' in caught.value.faults[0]


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"[study\nname = 3", "is not valid TOML: Expected ']' at the end of a table declaration (at line 1"),
        (b"[study]\nname = 'x'\nname = 'y'\n", "at line 3"),
        (b"", "is empty"),
        (b"\xff\xfe\x00", "not text in UTF-8"),
        (b"# only a comment\n", "is empty"),
    ],
)
def test_a_file_that_is_no_study(tmp_path, content, said):
    path = tmp_path / "s.toml"
    path.write_bytes(content)
    with pytest.raises(StudyError) as caught:
        load_study(path)
    assert said in str(caught.value)


def test_no_file_at_all_and_a_folder(tmp_path):
    with pytest.raises(StudyError, match="does not exist"):
        load_study(tmp_path / "nope.toml")
    with pytest.raises(StudyError, match="is a folder"):
        load_study(tmp_path)


def test_the_hash_is_that_of_the_file(tmp_path):
    import hashlib

    path = tmp_path / "s.toml"
    text = '[study]\nname = "x"\nkind = "auv"\n[mission]\n'
    path.write_text(text)
    study = load_study(path)
    assert study.sha256 == hashlib.sha256(text.encode()).hexdigest()
    assert study.folder == tmp_path


# ---- the page and what the values become ----


def test_the_page_agrees_with_the_model():
    text = PAGE.read_text(encoding="utf-8")
    assert text == renewed(text), "renew it: python -m schuler.studies.describe docs/study-file.md"


def test_the_page_names_every_key():
    text = PAGE.read_text(encoding="utf-8")
    missing = [
        f"[{s}] {k}"
        for s, m in sections().items()
        for k in m.model_fields
        if f"`{k}`" not in text and f".{k}]" not in text
    ]
    assert missing == []


def test_defaults_of_the_file_are_the_filter_s_own():
    from schuler.aiding.auv_settings import AuvSettings
    from schuler.studies.auv_mapping import auv_settings

    ours, theirs = auv_settings(parse_study(AUV)), AuvSettings()
    for field in ("current_walk", "dvl_scale_std", "mag_std", "path_scale_std"):
        assert getattr(ours, field) == pytest.approx(getattr(theirs, field)), field
    same = {k: v for k, v in vars(ours).items() if not isinstance(v, float)}
    assert same == {k: vars(theirs)[k] for k in same}
    for k, v in vars(ours).items():
        if isinstance(v, float):
            assert v == pytest.approx(vars(theirs)[k]), k


def test_figures_become_si():
    from schuler.studies.auv_mapping import auv_settings

    raw = {
        **AUV,
        "imu": {"gyro_arw_deg_per_sqrt_h": 0.6, "gyro_bias_deg_per_h": [36.0, 72.0, 3.6], "accel_bias_ug": 1000},
        "noise": {"speed_scale_percent": 2.0, "current_walk_mps_per_sqrt_h": 0.6, "attitude_deg": [1, 2, 3]},
        "start": {"lat_deg": 45, "heading_deg": 90, "std_north_m": 5},
        "mounting": {"antenna_frd_m": [0, 0, -1]},
        "output": {"rate_hz": "imu"},
    }
    s = auv_settings(parse_study(raw))
    assert s.gyro_arw == pytest.approx(radians(0.6) / 60)
    assert s.gyro_bias_std == pytest.approx(radians(72) / 3600)
    assert s.accel_bias_std == pytest.approx(9.80665e-3)
    assert s.speed_scale_std == pytest.approx(0.02) and s.current_walk == pytest.approx(0.01)
    assert s.attitude_std == pytest.approx((radians(1), radians(2), radians(3)))
    assert s.start.lat == pytest.approx(radians(45)) and s.start.heading == pytest.approx(radians(90))
    assert s.start.std_pos == (5, None, None) and s.antenna == (0, 0, -1) and s.output_rate == float("inf")


def test_estimate_switches_states_off():
    from schuler.studies.auv_mapping import auv_settings, not_estimated

    study = parse_study({**AUV, "filter": {"estimate": ["gyro_bias", "current", "mounting"]}})
    s = auv_settings(study)
    assert s.current_std > 0 and s.gyro_bias_std > 0
    assert s.speed_scale_std == s.accel_bias_std == s.heading_offset_std == 0.0
    assert "mounting" in not_estimated(study)[0]


def test_the_noise_of_a_simulated_study_is_that_of_its_sensors():
    from schuler.studies.auv_mapping import suite_of

    base = suite_of(parse_study(AUV))
    assert base.magnetometer is None and base.dvl is None
    raw = {**AUV, "noise": {"speed_mps": 0.2, "mag_deg": 3.0, "heading_offset_deg": 4.0, "gnss_correlated_m": 0.0}}
    raw["mission"] = {"preset": "demo", "magnetometer": True, "dvl": True}
    suite = suite_of(parse_study(raw))
    assert suite.speed.noise == pytest.approx(0.2)
    assert (suite.magnetometer.noise_deg, suite.magnetometer.bias_deg) == (3.0, 4.0)
    assert suite.dvl is not None and suite.gnss.correlated_m == (0.0, 0.0, 0.0)
    off = {**raw, "mission": {"preset": "demo", "magnetometer": False}}
    assert suite_of(parse_study(off)).magnetometer is None


def test_unknown_presets_are_faults_of_the_study():
    from schuler.studies.auv_mapping import check_presets

    with pytest.raises(StudyError, match="3dm-gx3-25"):
        check_presets(parse_study({**AUV, "imu": {"preset": "3dm"}}))


def test_study_is_a_model_with_all_sections():
    assert list(Study.model_fields)[:3] == ["study", "input", "start"]
