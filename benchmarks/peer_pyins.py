"""python-ins (PyPI, module pyins) and schuler side by side: the same recordings, fixes, noise, start and outages.

    python benchmarks/peer_pyins.py [--only car-rtk-mems] [--out docs] [--cache FILE]

pyins runs its feedback (extended Kalman) filter with random-walk biases. It has no vehicle constraints, mounting angles,
time delay or smoother; it gets the fixes on the IMU's clock, with the delay that our filter finds, so that it is not
judged for what its user would have to do. Outages are those of one phase of [sweep]; judged at the last withheld fix.
Speed is IMU epochs a second of the filter alone, both in one process on one core, the machine otherwise as it is.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from recordings import ROOT, prepare_example

from schuler.ground.earth import LocalFrame
from schuler.ground.tables import Table
from schuler.ground.units import DEG

Array = NDArray[np.float64]
DATA = ROOT.parent / "shared" / "data"
RECORDINGS = {
    "car-rtk-mems": "car_rtk_mems",
    "comma2k19-aided": "car_comma2k19_wheel",
    "thor-uav": "uav_thor75",
    "car-phone": "car_phone_a",
}
START_SPEED = 5.0  # m/s: the course of the first faster fix is the first heading, for both
SIGMA_LEVEL, SIGMA_HEADING = 3.0, 9.0  # deg, of the start


@dataclass
class Drive:
    """What a filter is given. imu, gnss : body axes, one clock; p, v : 1 sigma of a fix; arm : IMU to antenna, FRD."""

    name: str
    imu: Table
    gnss: Table
    p: float
    v: float
    arm: Array
    noise: dict[str, float]
    settle: float
    lengths: tuple[float, ...]


@dataclass
class Row:
    """One recording and outage length (0: every fix kept): what is left at the fixes, or at the end of the outages."""

    recording: str
    length_s: float
    windows: int
    pyins_p50: float
    pyins_p95: float
    ours_p50: float = float("nan")
    ours_p95: float = float("nan")
    smoother_p50: float = float("nan")
    pyins_per_s: float = float("nan")
    ours_per_s: float = float("nan")
    note: str = ""


@dataclass
class Peer:
    """A finished run of pyins."""

    time: Array
    lat: Array
    lon: Array
    height: Array
    v_n: Array
    rph: Array
    seconds: float
    epochs: int
    notes: list[str] = field(default_factory=list)


def drive_of(folder: Path, delay: float) -> Drive:
    """The tables of a prepared study on the IMU's clock, delay : s, of the fixes beyond what the study types."""
    from schuler.studies.inputs import read_tables, to_body
    from schuler.studies.model import load_study
    from schuler.truth.keys import imu_from_keys

    study = load_study(folder / "study.toml")
    inputs = read_tables(study)
    to_body(study, inputs.tables)
    gnss, imu = inputs.tables["gnss"], inputs.tables["imu"]
    columns = {**gnss.columns, "time": gnss.time - study.input.gnss_delay_s - delay}
    gnss = Table("gnss", columns).where((columns["time"] > imu.time[0]) & (columns["time"] < imu.time[-1]))
    given = study.imu
    assert given is not None and study.sweep is not None
    model = imu_from_keys({k: v for k, v in given.model_dump(exclude_none=True).items() if k != "calibration"}, {})
    noise = {
        "arw": float(model.arw[0]),
        "vrw": float(model.vrw[0]),
        "gyro_walk": float(model.gyro_rrw[0]),
        "accel_walk": float(model.accel_rrw[0]),
        "gyro_bias": float(model.gyro_bias[0]),
        "accel_bias": float(model.accel_bias[0]),
    }

    def sigma(stem: str, typed: tuple[float, ...]) -> float:
        names = [f"std_{stem}{n}" for n in ("north", "east")]
        own = [gnss[n] for n in names if n in gnss]
        return float(np.nanmedian(own)) if own else float(np.mean(typed[:2]))

    return Drive(
        study.study.name,
        imu,
        gnss,
        float(np.hypot(sigma("", study.noise.gnss_m), study.noise.gnss_correlated_m)),
        sigma("v_", study.noise.gnss_mps),
        np.array(study.mounting.antenna_frd_m),
        noise,
        study.sweep.settle_s,
        study.sweep.length_s,
    )


def start_of(drive: Drive) -> tuple[int, dict[str, float]]:
    """Row of the first fix faster than START_SPEED, and position, velocity and attitude (deg) there."""
    g = drive.gnss
    i = int(np.argmax(np.hypot(g["v_north"], g["v_east"]) > START_SPEED))
    before = drive.imu.time <= g.time[i]
    f = np.median(drive.imu.stack("accel_x", "accel_y", "accel_z")[before][-3000:], axis=0)
    heading = float(np.degrees(np.arctan2(g["v_east"][i], g["v_north"][i])))
    start = {"lat": g["lat"][i] / DEG, "lon": g["lon"][i] / DEG, "alt": g["height"][i]}
    start |= {"VN": g["v_north"][i], "VE": g["v_east"][i], "VD": g["v_down"][i] if "v_down" in g else 0.0}
    start |= {"roll": float(np.degrees(np.arctan2(-f[1], -f[2])))}
    start |= {"pitch": float(np.degrees(np.arctan2(f[0], np.hypot(f[1], f[2])))), "heading": heading}
    return i, {k: float(v) for k, v in start.items()}


def run_pyins(drive: Drive, gone: NDArray[np.bool_]) -> Peer:
    """pyins' feedback filter over a drive, the fixes marked `gone` withheld."""
    import pandas as pd
    from pyins import filters, inertial_sensor, measurements, strapdown

    class HorizontalVelocity(measurements.NedVelocity):  # type: ignore[misc]
        """Speed and course of a receiver that tells nothing of the vertical."""

        def compute_matrices(self, time: float, pva: Any, error_model: Any) -> Any:
            found = super().compute_matrices(time, pva, error_model)
            return None if found is None else (found[0][:2], found[1][:2], found[2][:2, :2])

    first, start = start_of(drive)
    g, n = drive.gnss, drive.noise
    imu = pd.DataFrame(
        {c: drive.imu[c] for c in ("gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z")},
        index=pd.Index(drive.imu.time),
    )
    began = g.time[first]
    imu = imu[imu.index >= began]
    increments = strapdown.compute_increments_from_imu(imu, "rate")
    pva = pd.Series(start, name=float(imu.index[0]))
    keep = ~gone & (np.arange(len(g)) > first)
    index = pd.Index(g.time[keep])
    lla = pd.DataFrame(
        {"lat": g["lat"][keep] / DEG, "lon": g["lon"][keep] / DEG, "alt": g["height"][keep]}, index=index
    )
    down = g["v_down"][keep] if "v_down" in g else np.zeros(int(keep.sum()))
    velocity = pd.DataFrame({"VN": g["v_north"][keep], "VE": g["v_east"][keep], "VD": down}, index=index)
    kind = measurements.NedVelocity if "v_down" in g else HorizontalVelocity
    gyro = inertial_sensor.EstimationModel(n["gyro_bias"], n["arw"], n["gyro_walk"])
    accel = inertial_sensor.EstimationModel(n["accel_bias"], n["vrw"], n["accel_walk"])
    clock = time.perf_counter()
    found = filters.run_feedback_filter(
        pva, drive.p, 0.5, SIGMA_LEVEL, SIGMA_HEADING, increments, gyro, accel,
        [measurements.Position(lla, drive.p, drive.arm), kind(velocity, drive.v, drive.arm)],
    )  # fmt: skip
    took = time.perf_counter() - clock
    t = found.trajectory
    return Peer(
        t.index.to_numpy(float),
        *(t[c].to_numpy(float) * s for c, s in (("lat", DEG), ("lon", DEG), ("alt", 1.0))),
        t[["VN", "VE", "VD"]].to_numpy(float),
        t[["roll", "pitch", "heading"]].to_numpy(float) * DEG,
        took,
        len(increments),
    )


def misses(track: Peer, gnss: Table, arm: Array, rows: NDArray[np.int64], after: bool) -> Array:
    """(n,) m: horizontal distance of the antenna from the fixes `rows`; `after`: as the track stands once it has seen
    the fix (the first row at or after it), else as it was predicted (the last row before it), moved with its velocity."""
    from schuler.ground.frames import dcm_from_euler

    t = gnss.time[rows]
    k = np.searchsorted(track.time, t, side="left") - (0 if after else 1)
    k = np.clip(k, 0, len(track.time) - 1)
    arms = np.einsum("nij,j->ni", dcm_from_euler(*track.rph[k].T), arm)
    ahead = track.v_n[k] * (t - track.time[k])[:, None] + arms
    out = np.empty(len(rows))
    for i, (r, j) in enumerate(zip(rows, k, strict=True)):
        north, east, _ = LocalFrame(float(track.lat[j]), float(track.lon[j])).ned(
            float(gnss["lat"][r]), float(gnss["lon"][r]), float(track.height[j])
        )
        out[i] = np.hypot(north - ahead[i, 0], east - ahead[i, 1])
    return out


def outage_rows(drive: Drive, length: float) -> tuple[list[tuple[float, float]], NDArray[np.bool_], NDArray[np.int64]]:
    """Windows of the first phase, which fixes they withhold, and the last fix of each."""
    from schuler.studies.sweep import windows

    t = drive.gnss.time
    spans = windows(float(t[0]), float(t[-1]), length, drive.settle, 0)
    spans = [(a, b) for a, b in spans if ((t >= a) & (t <= b)).any()]
    gone = np.zeros(len(t), dtype=bool)
    for a, b in spans:
        gone |= (t >= a) & (t <= b)
    last = np.array([np.flatnonzero((t >= a) & (t <= b))[-1] for a, b in spans])
    return spans, gone, last


def peer_rows(drive: Drive, say: Any) -> list[dict[str, Any]]:
    """pyins on every outage length and on all fixes: {"length_s", "windows", "errors_m", "seconds", "epochs"}."""
    told = []
    for length in (0.0, *drive.lengths):
        if length:
            _, gone, rows = outage_rows(drive, length)
            if not len(rows):
                continue
        else:
            gone, rows = np.zeros(len(drive.gnss), dtype=bool), np.arange(start_of(drive)[0] + 50, len(drive.gnss))
        found = run_pyins(drive, gone)
        errors = misses(found, drive.gnss, drive.arm, rows, after=not length)
        say(f"pyins {drive.name}, outages of {length:g} s: median {np.median(errors):.3g} m, {found.seconds:.0f} s")
        told.append(
            {
                "length_s": length,
                "windows": len(rows),
                "errors_m": [float(e) for e in errors] if length else [],
                "p50": float(np.percentile(errors, 50)),
                "p95": float(np.percentile(errors, 95)),
                "rms": float(np.sqrt(np.mean(errors**2))),
                "seconds": found.seconds,
                "epochs": found.epochs,
            }
        )
    return told


def say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


def cached(file: Path | None) -> dict[str, Any]:
    return json.loads(file.read_text()) if file is not None and file.is_file() else {}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", choices=RECORDINGS, help="one recording")
    parser.add_argument("--cache", type=Path, help="keep pyins' results in this file and take them from it")
    given = parser.parse_args()
    told = cached(given.cache)
    for example, folder in RECORDINGS.items():
        if given.only not in (None, example) or not (DATA / folder).is_dir():
            continue
        with tempfile.TemporaryDirectory() as out:
            prepare_example(example, DATA / folder, Path(out) / "tables")
            drive = drive_of(Path(out) / "tables", 0.0)
            if example not in told:
                told[example] = peer_rows(drive, say)
        if given.cache is not None:
            given.cache.write_text(json.dumps(told, indent=1))
    print(json.dumps(told, indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
