"""The BROAD trials: reader, accuracy with the default settings, nothing moved, vqf beside it."""

import shutil

import numpy as np
import pytest
from replay import BROAD, BROAD_REPLAYED, broad_figures, golden_of, moved, read, run_broad

from schuler.ground.errors import InputError
from schuler.io.formats import broad

pytestmark = pytest.mark.data


@pytest.fixture(scope="module")
def results(data_folder, tmp_path_factory):
    return run_broad(data_folder / BROAD, tmp_path_factory.mktemp("broad"))


@pytest.mark.slow
def test_as_good_as_claimed(results):
    found = broad_figures(results)
    assert len(results) == 12 and len(found) == 6 and [f for f in found if not f.holds] == []


@pytest.mark.slow
def test_nothing_moved(results):
    """Beyond 2 % of a sigma: then  python tests/golden/replay.py --update  and commit with the reason."""
    for name in BROAD_REPLAYED:
        changes = moved(read(f"ahrs-broad-{name[:2]}"), golden_of(results[name, 9].navigation))
        assert len(changes) > 50
        assert {key: c for key, c in changes.items() if abs(c[0]) > 0.02 or abs(c[1] - 1.0) > 0.02} == {}


@pytest.mark.slow
def test_the_sigma_is_right_where_nothing_bends_the_field(results):
    for (name, axes), result in results.items():
        c = result.summary["consistency"]
        if "phone" not in name or axes == 6:  # the telephone bends the field from the first moment on
            assert c["inside_3_sigma"] > 0.97, name
            assert c["nees_attitude"] < 1.5, name
        if name.startswith("02") and axes == 9:
            assert result.summary["magnetometer"]["distrusted_share"] < 0.15
        if name.startswith("30") and axes == 9:
            assert result.summary["magnetometer"]["distrusted_share"] > 0.3


def test_reader(data_folder, tmp_path):
    trial = data_folder / BROAD / "02_undisturbed_slow_rotation_B.npz"
    assert broad.recognise(trial)
    tables = broad.convert(trial)
    imu, reference = tables["imu"], tables["reference"]
    still = imu.time < 3.0
    assert (
        -9.95 < imu["accel_z"][still].mean() < -9.7
        and 40e-6 < np.linalg.norm(imu.stack("mag_x", "mag_y", "mag_z")[0]) < 50e-6
    )
    assert len(reference) < len(imu) and np.isfinite(reference["heading"]).all()
    with np.load(trial) as file:
        held = {k: file[k] for k in file.files}
    damaged = tmp_path / "damaged.npz"
    np.savez(damaged, **{**held, "imu_acc": held["imu_acc"][:-5]})
    with pytest.raises(InputError, match="imu_acc has shape"):
        broad.convert(damaged)
    np.savez(damaged, **{k: v for k, v in held.items() if k != "opt_quat"})
    assert not broad.recognise(damaged)
    with pytest.raises(InputError, match="opt_quat missing"):
        broad.convert(damaged)
    lost = held["opt_quat"] * np.nan
    np.savez(damaged, **{**held, "opt_quat": lost})
    assert set(broad.convert(damaged)) == {"imu"}
    shutil.copyfile(trial, damaged)
    damaged.write_bytes(damaged.read_bytes()[:5000])
    assert not broad.recognise(damaged)
    with pytest.raises(InputError, match="cannot be read"):
        broad.convert(damaged)
