"""A calibration as a file, and its use on an imu table."""

import json

import numpy as np
import pytest

from schuler.calibration.corrections import Calibration, Parameter, apply
from schuler.ground.errors import InputError
from schuler.ground.tables import Table
from schuler.truth.vibration import Vibration

LEVERS = np.array([[0.04, 0.02, -0.03], [-0.02, 0.05, 0.02], [0.03, -0.025, 0.035]])


def parameters():
    out = [
        Parameter(f"accel_{a}_lever_{b}_mm", LEVERS[i, j], 1e-4, True)
        for i, a in enumerate("xyz")
        for j, b in enumerate("xyz")
    ]
    out += [Parameter(f"accel_bias_{a}_mps2", v, 1e-3, True) for a, v in zip("xyz", (0.1, -0.2, 0.3), strict=True)]
    out += [
        Parameter(f"gyro_bias_{a}_deg_per_s", v, 1e-4, True) for a, v in zip("xyz", (0.01, 0.02, -0.01), strict=True)
    ]
    out += [Parameter("accel_scale_x_ppm", 2e-3, 1e-5, True), Parameter("gyro_scale_z_ppm", -3e-3, 1e-5, True)]
    out += [
        Parameter("accel_misalignment_xy_mrad", 4e-3, 1e-5, True),
        Parameter("gyro_misalignment_zx_mrad", 5e-3, 1e-5, True),
    ]
    out += [Parameter("gyro_g_sensitivity_xz_deg_per_s_per_g", 1e-5, 1e-6, True)]
    out += [Parameter("accel_misalignment_yz_mrad", np.nan, np.nan, False)]
    return out


def calibration():
    made = parameters()
    n = sum(p.observable for p in made)
    return Calibration("bench", made, np.eye(n) * 1e-8, 1e-3, 2e-3, 3.0)


def measured(kind, n=4000, rate=2000.0):
    """(table as measured, true force at the origin, true rate): means over the intervals, from a fine grid."""
    fine = 40
    v = Vibration.band(10.0, 80.0, 1e-3, tones=12, seed=2)
    t = (np.arange(n * fine) + 0.5) / (rate * fine)
    _, w, wd = v.motion(t)
    f = np.column_stack([np.sin(40 * t), 0.3 * np.cos(25 * t), -9.81 + 0 * t])
    inner = np.cross(wd[:, None, :], LEVERS) + np.cross(w[:, None, :], np.cross(w[:, None, :], LEVERS))
    felt = f + np.einsum("nii->ni", inner)
    K_a, K_g = np.eye(3), np.eye(3)
    K_a[0, 0], K_a[0, 1], K_g[2, 2], K_g[2, 0] = 1.002, 4e-3, 0.997, 5e-3
    G = np.zeros((3, 3))
    G[0, 2] = 1e-5
    a = felt @ K_a.T + [0.1, -0.2, 0.3]
    g = w @ K_g.T + [0.01, 0.02, -0.01] + felt @ G.T
    means = [x.reshape(n, fine, 3).mean(axis=1) for x in (a, g, f, w)]
    time = np.arange(1, n + 1) / rate
    size = 1.0 / rate if kind == "increments" else 1.0
    stems = ("dv", "dtheta") if kind == "increments" else ("accel", "gyro")
    columns = {"time": time}
    for stem, x in zip(stems, means[:2], strict=True):
        columns |= {f"{stem}_{b}": x[:, i] * size for i, b in enumerate("xyz")}
    return Table("imu", columns, kind), means[2], means[3]


@pytest.mark.parametrize("kind", ["rates", "increments"])
def test_a_measured_table_becomes_the_true_one(kind):
    table, f, w = measured(kind)
    out = apply(table, calibration())
    stems = ("dv", "dtheta") if kind == "increments" else ("accel", "gyro")
    size = 2000.0 if kind == "increments" else 1.0
    found_f = out.stack(*(f"{stems[0]}_{a}" for a in "xyz")) * size
    found_w = out.stack(*(f"{stems[1]}_{a}" for a in "xyz")) * size
    assert found_w == pytest.approx(w, abs=1e-9)
    raw = np.abs(table.stack(*(f"{stems[0]}_{a}" for a in "xyz")) * size - f).max()
    assert raw > 5.0
    assert np.abs(found_f - f)[3:-3].max() < 3e-3  # fourth-order differences at 80 Hz
    assert out.kind == kind and "bench" in out.notes[-1]
    assert np.array_equal(table["time"], out["time"])


def test_a_gap_ends_the_differences():
    table, f, _ = measured("rates")
    keep = np.ones(len(table), dtype=bool)
    keep[1500:1700] = False
    out = apply(table.where(keep), calibration())
    found = out.stack("accel_x", "accel_y", "accel_z")
    error = np.abs(found - f[keep])
    assert error[[5, 700, 1400, 1600, 3000]].max() < 3e-3
    assert error[1496:1504].max() < 2.0  # shorter differences at the edge, but none across it


def test_the_file_reads_back_what_was_written():
    made = calibration()
    told = json.loads(json.dumps(made.as_dict({"version": "x"}), default=lambda x: x.tolist()).replace("NaN", "null"))
    back = Calibration.from_dict(told)
    assert back.levers == pytest.approx(made.levers)
    for sensor in ("accel", "gyro"):
        assert back.triad(sensor)[0] == pytest.approx(made.triad(sensor)[0])
        assert back.triad(sensor)[1] == pytest.approx(made.triad(sensor)[1])
    assert back.g_sensitivity == pytest.approx(made.g_sensitivity)
    lever = next(p for p in told["parameters"] if p["name"] == "accel_x_lever_x_mm")
    assert lever == {
        "name": "accel_x_lever_x_mm",
        "unit": "mm",
        "value": 40.0,
        "std": pytest.approx(0.1),
        "observable": True,
    }
    blind = next(p for p in told["parameters"] if not p["observable"])
    assert blind["value"] is None and blind["std"] is None
    assert np.asarray(told["covariance"]).shape == (len(told["parameters"]) - 1,) * 2
    assert told["covariance"][0][0] == pytest.approx(1e-2)  # mm^2


def test_what_is_not_observable_counts_as_zero_and_is_told():
    made = calibration()
    assert made.value("accel_misalignment_yz_mrad") == 0.0
    assert "accel_misalignment_yz_mrad" in made.describe()


@pytest.mark.parametrize(
    ("content", "word"),
    [
        ({}, "not a calibration"),
        ({"parameters": [{"value": 1.0}]}, "no name"),
        ({"parameters": [{"name": "accel_bias_x_furlong", "value": 1.0}]}, "unit is not known"),
        ({"parameters": [{"name": "accel_bias_x_mps2", "value": "big", "std": 1.0}]}, "must be numbers"),
    ],
)
def test_files_that_are_none(content, word):
    with pytest.raises(InputError, match=word):
        Calibration.from_dict(content)
