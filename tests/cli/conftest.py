"""Running the program as a user does, and a small recording to run it on."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

from schuler.io.tables import write_table
from schuler.truth.recording import SUITES, simulate


@dataclass
class Done:
    status: int
    out: str
    err: str


def schuler(*arguments, cwd=None, inside=True):
    """The program's exit status and what it printed; inside: in this process, which is quicker."""
    if not inside:
        command = [sys.executable, "-c", "from schuler.cli import main; main()", *map(str, arguments)]
        done = subprocess.run(command, cwd=cwd, capture_output=True, text=True, timeout=300)
        return Done(done.returncode, done.stdout, done.stderr)
    import contextlib
    import io
    import os
    import warnings

    from schuler.cli import run

    out, err, before = io.StringIO(), io.StringIO(), os.getcwd()
    try:
        os.chdir(cwd or before)
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err), warnings.catch_warnings():
            status = run([str(a) for a in arguments])
    finally:
        os.chdir(before)
    return Done(status, out.getvalue(), err.getvalue())


@pytest.fixture(scope="session")
def recording():
    """A short dive, simulated: 60 s on the surface, 120 s under water, 30 s on the surface; 50 Hz."""
    from schuler.truth.keys import mission_from_keys

    keys = {"surface_s": 60.0, "dive_s": 120.0, "final_surface_s": 30.0, "depth_m": 8.0, "current_east_mps": 0.1}
    mission = mission_from_keys(keys)
    return simulate(mission, SUITES["demo"].with_changes(imu_rate_hz=50.0), seed=5)


@pytest.fixture(scope="session")
def _files(recording, tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("recording")
    for name, table in recording.tables.items():
        write_table(folder / f"{name}.csv", table)
    write_table(folder / "truth.csv", recording.truth)
    return folder


STUDY = """
[study]
name = "trial"
kind = "auv"

[input]
imu = "imu.csv"
gnss = "gnss.csv"
speed = "speed.csv"
depth = "depth.csv"
reference = "truth.csv"
"""


@pytest.fixture
def trial(_files, tmp_path) -> Path:
    """A folder of its own with the recording and study.toml; files may be changed."""
    import shutil

    for file in _files.iterdir():
        shutil.copy(file, tmp_path)
    (tmp_path / "study.toml").write_text(STUDY)
    return tmp_path


@pytest.fixture(scope="session")
def program():
    return schuler
