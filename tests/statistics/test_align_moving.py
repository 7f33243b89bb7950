"""`schuler align` in motion: the attitude at to_s of simulated flights is as good as it says, from any quadrant."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

from schuler.cli.align import align
from schuler.ground.earth import wrap_pi
from schuler.ground.errors import InputError
from schuler.studies.align import align_study
from schuler.studies.model import load_study

D = math.pi / 180.0
STUDY = """
[study]
name = "flight"
kind = "aided"
[trajectory]
preset = "{preset}"
duration_s = 100.0
rate_hz = 50.0
[start]
lat_deg = 50.0
lon_deg = 30.0
height_m = 500.0
heading_deg = {heading}
[imu]
preset = "tactical"
[noise]
gnss_correlated_m = 0.0
[align]
method = "moving"
to_s = 90.0
"""


def study(folder: Path, heading: float = 0.0, preset: str = "flight", change: tuple[str, str] = ("", "")) -> Path:
    path = folder / f"study-{heading:g}.toml"
    path.write_text(STUDY.format(heading=heading, preset=preset).replace(*change))
    return path


@pytest.mark.slow
def test_any_quadrant(tmp_path: Path) -> None:
    from schuler.studies.kind_aided import simulate

    nees = []
    for seed, heading in enumerate((20.0, 110.0, 200.0, 290.0, 155.0, 65.0)):
        made = load_study(study(tmp_path, heading))
        found, told = align_study(made, seed=seed)
        truth = simulate(made, seed, lambda *_: None)[0].reference
        assert truth is not None
        i = int(np.argmin(np.abs(truth.time - told["to_s"])))
        assert abs(truth.time[i] - told["to_s"]) < 0.011 and told["method"] == "moving"
        e = wrap_pi(found.rpy - np.array([truth["roll"][i], truth["pitch"][i], truth["heading"][i]]))
        assert abs(e[2]) < 2.0 * D
        nees.append(e @ np.linalg.solve(found.cov, e) / 3.0)
        assert told["gyro_bias_deg_per_h"] is not None and told["to_s"] == pytest.approx(90.0, abs=0.03)
    assert 0.2 < np.mean(nees) < 2.5


@pytest.mark.slow
def test_as_typed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    align(study(tmp_path, 200.0), tmp_path / "out", 4)
    told = json.loads((tmp_path / "out" / "alignment.json").read_text())
    assert told["method"] == "moving" and told["heading_floor_deg"] is None
    assert np.array(told["covariance_deg2"]).shape == (3, 3)
    assert told["std_heading_deg"] == pytest.approx(math.sqrt(told["covariance_deg2"][2][2]))
    assert "base moving" in capsys.readouterr().out


def test_nothing_to_see_the_motion_by(tmp_path: Path) -> None:
    still = study(tmp_path, 0.0, "rest", ('preset = "tactical"', 'preset = "consumer"'))
    with pytest.raises(InputError, match="heading could not be found from the motion"):
        align_study(load_study(still), seed=1)
    late = study(tmp_path, 0.0, change=("to_s = 90.0", "from_s = 500.0\nto_s = 600.0"))
    with pytest.raises(InputError, match=r"from_s = 500 s lies after the imu's last row"):
        align_study(load_study(late), seed=1)
