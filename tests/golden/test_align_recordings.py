"""Alignment in motion on real recordings, with nothing told of the heading."""

import re

import numpy as np
import pytest
from replay import AIDED, prepare_example

from schuler.ground.earth import wrap_pi
from schuler.io.tables import read_table
from schuler.studies.align import align_study
from schuler.studies.model import load_study

pytestmark = [pytest.mark.data, pytest.mark.slow]
D = np.pi / 180.0


@pytest.fixture
def align(data_folder, tmp_path):
    def found(name, start, to, constraints=""):
        out = tmp_path / name
        if not out.exists():
            prepare_example(name, data_folder / AIDED[name][0], out)
        text = (out / "study.toml").read_text()
        text = re.sub(r"^(roll|pitch|heading|v_north|v_east|v_down|std_).*$", "", text, flags=re.M)
        text = re.sub(r"^constraints.*$", constraints, text, flags=re.M)
        path = out / "align.toml"
        path.write_text(text + f'\n[align]\nmethod = "moving"\nfrom_s = {start}\nto_s = {to}\n')
        return out, align_study(load_study(path))[0]

    return found


def off(found, reference):
    """(3,) rad: roll, pitch, heading against the reference's row at the end."""
    i = int(np.argmin(np.abs(reference.time - found.to)))
    return wrap_pi(found.rpy - np.array([reference[c][i] for c in ("roll", "pitch", "heading")]))


@pytest.mark.parametrize("start", [293.0, 386.0, 480.0])
def test_an_aeroplane(align, start):
    """Against the on-board filter, which is good to about a degree in level and two in heading."""
    out, found = align("thor-uav", start, start + 60.0)
    e = off(found, read_table(out / "reference-onboard.csv", "reference"))
    assert np.abs(e[:2]).max() < 2.0 * D and abs(e[2]) < 4.0 * D
    assert found.std[2] < 2.0 * D


def test_a_quadrotor_by_positions_alone(align):
    out, found = align("quad-4imu", 0.7, 19.0)
    e = off(found, read_table(out / "reference.csv", "reference"))
    assert abs(e[2]) < max(8.0 * D, 3.0 * found.std[2]) and np.abs(e[:2]).max() < 5.0 * D


def test_a_telephone_with_and_without_following_its_nose(align):
    """Course and competing headings meet within the telephone's mounting."""
    _, free = align("car-phone", 284.0, 344.0)
    _, nose = align("car-phone", 284.0, 344.0, 'constraints = ["nhc"]')
    apart = wrap_pi(free.rpy - nose.rpy)
    assert abs(apart[2]) < 3.0 * np.hypot(free.std[2], nose.std[2]) and np.abs(apart[:2]).max() < 3.0 * D
