"""python-ins (PyPI, module pyins) and schuler side by side: the same recordings, fixes, noise, start and outages.

    python benchmarks/peer_pyins.py [--only car-rtk-mems] [--out docs] [--cache FILE]

pyins runs its feedback (extended Kalman) filter with random-walk biases. It has no vehicle constraints, mounting
angles, time delays or smoother; it gets the fixes on the IMU's clock, with the delays that our filter has found, so
that it is not judged for what its user would have to do beforehand. Outages are those of the first phase of [sweep]; an
error is that of the last withheld fix, without an outage what is left at the fixes that were used. "INS alone" is our
filter with the same aids as pyins: no constraints, no other sensor.

Speed is IMU epochs a second of processor time of the filter alone (no smoother, no reading), one after the other in one
process, pyins over SPEED_S. A whole run of pyins takes one to three minutes: --cache keeps its errors. The tables go to
docs/peers.md, all figures to peers.json.
"""

from __future__ import annotations

import argparse
import json
import platform
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from recordings import prepare_example
from targets_aided import DATA, arm_of, between, delay_of, say, variant, without

from schuler.aiding.solution import Solution
from schuler.ground.earth import LocalFrame
from schuler.ground.tables import Table
from schuler.ground.units import DEG

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Start = dict[str, float]
# example -> folder of the recording, what is taken out of the study for "INS alone"
RECORDINGS: dict[str, tuple[str, tuple[str, ...]]] = {
    "car-rtk-mems": ("car_rtk_mems", ()),
    "comma2k19-aided": ("car_comma2k19_wheel", ("input.speed",)),
    "thor-uav": ("uav_thor75", ("input.speed", "input.height", "filter.speed_is")),
    "car-phone": ("car_phone_a", ()),
}
NOT_PYINS = ("mounting", "speed_scale", "current", "height_bias", "gyro_scale")
START_SPEED = 5.0  # m/s: the course of the first faster fix is the first heading
SIGMA_LEVEL, SIGMA_HEADING, SIGMA_VELOCITY = 3.0, 9.0, 0.5  # deg, deg, m/s: of that start
SPEED_S = 20.0  # of a recording, to time pyins
SETTLED = 50  # fixes after the start that the errors at the fixes leave out


@dataclass
class Drive:
    """What pyins is given. imu, gnss : body axes; at, velocity_at : times of the fixes and of their velocities on the
    IMU's clock; p, v : 1 sigma; arm : IMU to antenna, FRD; noise : of the IMU, SI."""

    name: str
    imu: Table
    gnss: Table
    at: Array
    velocity_at: Array
    p: float
    v: float
    arm: Array
    noise: dict[str, float]


@dataclass
class Run:
    """A finished run: the IMU's track, seconds of the filter alone, IMU epochs."""

    track: Solution
    seconds: float
    epochs: int
    note: str = ""


# ------------------------------------------------------------------------------------------------------------ inputs


def drive_of(result: Any) -> Drive:
    """The tables of a finished study, the fixes on the IMU's clock by the delays that it has found."""
    from schuler.truth.keys import imu_from_keys

    study, states = result.study, result.navigation.states
    imu, gnss = result.tables["imu"], result.tables["gnss"]

    def delay(name: str) -> float:
        return float(np.median(states[name].value)) if name in states else study.input.gnss_delay_s

    at = gnss.time - delay("gnss_delay")
    inside = (at > imu.time[0]) & (at < imu.time[-1])
    gnss = gnss.where(inside)
    keys = study.imu.model_dump(exclude_none=True)
    model = imu_from_keys({k: v for k, v in keys.items() if k != "calibration"}, {})
    noise = {
        "arw": float(model.arw[0]),
        "vrw": float(model.vrw[0]),
        "gyro_walk": float(model.gyro_rrw[0]),
        "accel_walk": float(model.accel_rrw[0]),
        "gyro_bias": float(model.gyro_bias[0]),
        "accel_bias": float(model.accel_bias[0]),
    }

    def sigma(stem: str, typed: tuple[float, ...]) -> float:
        own = [gnss[n] for n in (f"std_{stem}north", f"std_{stem}east") if n in gnss]
        return float(np.nanmedian(own)) if own else float(np.mean(typed[:2]))

    p = float(np.hypot(sigma("", study.noise.gnss_m), study.noise.gnss_correlated_m))
    v = sigma("v_", study.noise.gnss_mps)
    velocity_at = gnss.time - delay("gnss_velocity_delay")
    return Drive(study.study.name, imu, gnss, at[inside], velocity_at, p, v, np.array(arm_of(result)), noise)


def start_of(drive: Drive) -> tuple[int, Start]:
    """Row of the first fix faster than START_SPEED, and position (deg, m), velocity and attitude (deg) there."""
    g = drive.gnss
    i = int(np.argmax(np.hypot(g["v_north"], g["v_east"]) > START_SPEED))
    before = drive.imu.time <= drive.at[i]
    f = np.median(drive.imu.stack("accel_x", "accel_y", "accel_z")[before][-3000:], axis=0)
    heading = np.degrees(np.arctan2(g["v_east"][i], g["v_north"][i]))
    start = {"lat": g["lat"][i] / DEG, "lon": g["lon"][i] / DEG, "alt": g["height"][i]}
    start |= {"VN": g["v_north"][i], "VE": g["v_east"][i], "VD": g["v_down"][i] if "v_down" in g else 0.0}
    start |= {"roll": np.degrees(np.arctan2(-f[1], -f[2]))}
    start |= {"pitch": np.degrees(np.arctan2(f[0], np.hypot(f[1], f[2]))), "heading": heading}
    return i, {k: float(v) for k, v in start.items()}


# ------------------------------------------------------------------------------------------------------------- pyins


def run_pyins(drive: Drive, gone: Mask, wider: float = 1.0) -> Run:
    """pyins' feedback filter over a drive, the fixes marked `gone` withheld; wider : times the sigma of a fix."""
    import pandas as pd
    from pyins import filters, inertial_sensor, measurements, strapdown

    class HorizontalVelocity(measurements.NedVelocity):  # type: ignore[misc]
        """Speed and course of a receiver that tells nothing of the vertical."""

        def compute_matrices(self, time: float, pva: Any, error_model: Any) -> Any:
            found = super().compute_matrices(time, pva, error_model)
            return None if found is None else (found[0][:2], found[1][:2], found[2][:2, :2])

    first, start = start_of(drive)
    g, n = drive.gnss, drive.noise
    columns = [f"{stem}_{axis}" for stem in ("gyro", "accel") for axis in "xyz"]
    imu = pd.DataFrame({c: drive.imu[c] for c in columns}, index=pd.Index(drive.imu.time))
    imu = imu[imu.index >= drive.at[first]]
    increments = strapdown.compute_increments_from_imu(imu, "rate")
    pva = pd.Series(start, name=float(imu.index[0]))
    keep = ~gone & (np.arange(len(g)) > first)
    place = {"lat": g["lat"][keep] / DEG, "lon": g["lon"][keep] / DEG, "alt": g["height"][keep]}
    down = g["v_down"][keep] if "v_down" in g else np.zeros(int(keep.sum()))
    velocity = {"VN": g["v_north"][keep], "VE": g["v_east"][keep], "VD": down}
    kind = measurements.NedVelocity if "v_down" in g else HorizontalVelocity
    used = [
        measurements.Position(pd.DataFrame(place, index=pd.Index(drive.at[keep])), drive.p * wider, drive.arm),
        kind(pd.DataFrame(velocity, index=pd.Index(drive.velocity_at[keep])), drive.v, drive.arm),
    ]
    gyro = inertial_sensor.EstimationModel(n["gyro_bias"], n["arw"], n["gyro_walk"])
    accel = inertial_sensor.EstimationModel(n["accel_bias"], n["vrw"], n["accel_walk"])
    clock = time.process_time()
    try:
        found = filters.run_feedback_filter(
            pva, drive.p, SIGMA_VELOCITY, SIGMA_LEVEL, SIGMA_HEADING, increments, gyro, accel, used
        )
    except np.linalg.LinAlgError:
        if wider > 8.0:
            raise
        say(f"pyins {drive.name}: its covariance lost definiteness; again with sigmas of the fixes x {2.0 * wider:g}")
        return run_pyins(drive, gone, 2.0 * wider)
    seconds = time.process_time() - clock
    t = found.trajectory
    nothing = np.full((len(t), 3, 3), np.nan)
    rpy = t[["roll", "pitch", "heading"]].to_numpy(float) * DEG
    track = Solution(
        t.index.to_numpy(float), t["lat"].to_numpy(float) * DEG, t["lon"].to_numpy(float) * DEG,
        t["alt"].to_numpy(float), t[["VN", "VE", "VD"]].to_numpy(float), rpy, nothing, nothing, nothing,
    )  # fmt: skip
    note = "" if wider == 1.0 else f"sigma of the fixes x {wider:g}, else its covariance loses definiteness"
    return Run(track, seconds, len(increments), note)


# ----------------------------------------------------------------------------------------------------------- judging


def misses(track: Solution, drive: Drive, rows: NDArray[np.int64], used: bool) -> Array:
    """(n,) m, horizontal distance of the antenna from the fixes `rows`: the last row before, moved on; of fixes that
    were used the first row from then on, moved back (pyins corrects the row before a fix by it)."""
    from schuler.ground.frames import dcm_from_euler

    t = drive.at[rows]
    k = np.searchsorted(track.time, t, side="left") - (0 if used else 1)
    k = np.clip(k, 0, len(track) - 1)
    arms = np.einsum("nij,j->ni", dcm_from_euler(*track.rpy[k].T), drive.arm)
    ahead = track.v_n[k] * (t - track.time[k])[:, None] + arms
    out = np.empty(len(rows))
    for i, (r, j) in enumerate(zip(rows, k, strict=True)):
        north, east, _ = LocalFrame(float(track.lat[j]), float(track.lon[j])).ned(
            float(drive.gnss["lat"][r]), float(drive.gnss["lon"][r]), float(track.height[j])
        )
        out[i] = np.hypot(north - ahead[i, 0], east - ahead[i, 1])
    return out


def spans_of(result: Any, length: float) -> list[tuple[float, float]]:
    """Outages of the first phase of the study's sweep, on the stamps of the fixes."""
    from schuler.studies.sweep import windows

    t = result.tables["gnss"].time
    spans = windows(float(t[0]), float(t[-1]), length, result.study.sweep.settle_s, 0)
    return [(a, b) for a, b in spans if ((t >= a) & (t <= b)).any()]


def told(errors: Array, run: Run | None = None) -> dict[str, Any]:
    out: dict[str, Any] = {"p50": float(np.median(errors)), "p95": float(np.percentile(errors, 95))}
    if run is not None:
        out |= {"seconds": run.seconds, "epochs": run.epochs, "note": run.note}
    return out


def peer_rows(result: Any, lengths: tuple[float, ...] = ()) -> list[dict[str, Any]]:
    """pyins with every fix (length 0: at the fixes that it used) and on each outage length."""
    drive = drive_of(result)
    stamps, rows = drive.gnss.time, []
    for length in lengths or (0.0, *result.study.sweep.length_s):
        spans = spans_of(result, length) if length else []
        gone = np.zeros(len(stamps), dtype=bool)
        for a, b in spans:
            gone |= (stamps >= a) & (stamps <= b)
        judged = np.arange(start_of(drive)[0] + SETTLED, len(stamps))
        if length:
            judged = np.array([np.flatnonzero((stamps >= a) & (stamps <= b))[-1] for a, b in spans], dtype=np.int64)
        if not len(judged):
            continue
        run = run_pyins(drive, gone)
        rows.append(
            {"length_s": length, "windows": len(judged), **told(misses(run.track, drive, judged, not length), run)}
        )
        say(f"pyins {drive.name}, outages of {length:g} s: median {rows[-1]['p50']:.3g} m, {run.seconds:.0f} s")
    return rows


def our_rows(
    folder: Path, result: Any, lengths: list[float], change: Callable[[dict[str, Any]], None] | None
) -> list[dict[str, Any]]:
    """Ours on the same outages (0: at the fixes used), through the study's own machinery; change : of the study."""
    rows = []
    for length in lengths:
        spans = spans_of(result, length) if length else []
        if length and not spans:
            continue

        def withheld(raw: dict[str, Any], spans: list[tuple[float, float]] = spans) -> None:
            if change is not None:
                change(raw)
            raw.pop("sweep", None)
            raw.get("input", {}).pop("reference", None)  # both are judged by the withheld fixes
            raw["output"] = {"rate_hz": "imu"}
            raw["outage"] = [{"sensor": "gnss", "start_s": a, "end_s": b} for a, b in spans]

        found = variant(folder, withheld)
        if length:
            entries = found.summary["outages"]
            row = told(np.array([e["horizontal_end_m"] for e in entries], dtype=float))
            smooth = [e["smoother_horizontal_max_m"] for e in entries if e["smoother_horizontal_max_m"] is not None]
            row["smoother"] = float(np.median(smooth)) if smooth else None
            row["windows"] = len(entries)
        else:
            drive = drive_of(found)
            delay = delay_of(found.navigation, found.study.input.gnss_delay_s, drive.gnss.time, False)
            drive.at = drive.gnss.time - delay
            judged = np.arange(start_of(drive)[0] + SETTLED, len(drive.at))
            row = told(misses(found.navigation.filter, drive, judged, True))
            row["windows"] = len(judged)
        rows.append({"length_s": length, **row})
    return rows


def alone(name: str) -> Callable[[dict[str, Any]], None]:
    """Takes out of a study what pyins does not have."""

    def change(raw: dict[str, Any]) -> None:
        without("filter.constraints", "filter.nhc_frd_m", *RECORDINGS[name][1])(raw)
        estimate = raw["filter"].get("estimate")
        if estimate is not None:
            raw["filter"]["estimate"] = [e for e in estimate if e not in NOT_PYINS]

    return change


def peer_speed(result: Any) -> float:
    """IMU epochs a second of processor time of pyins over SPEED_S of a recording; beside `our_speed`."""
    drive = drive_of(result)
    first = start_of(drive)[0]
    keep = drive.at <= drive.at[first] + SPEED_S
    imu = drive.imu.where(drive.imu.time <= drive.at[first] + SPEED_S)
    short = replace(drive, imu=imu, gnss=drive.gnss.where(keep), at=drive.at[keep], velocity_at=drive.velocity_at[keep])
    run = run_pyins(short, np.zeros(int(keep.sum()), dtype=bool))
    return run.epochs / run.seconds


def our_speed(folder: Path, name: str) -> tuple[float, int]:
    """IMU epochs a second of our filter alone, and the number of its states: median of five runs."""
    from schuler.aiding.aided import navigate, settled
    from schuler.aiding.aided_settings import layout_of
    from schuler.studies.aided_mapping import aided_settings

    result = variant(folder, lambda raw: (alone(name)(raw), raw.pop("sweep", None))[0])
    settings, _ = settled(result.tables, replace(aided_settings(result.study), smoother=False))
    seconds = []
    for _ in range(5):
        clock = time.process_time()
        navigate(result.tables, settings)
        seconds.append(time.process_time() - clock)
    states = layout_of(settings, tuple(settings.estimate or ())).n
    return len(result.tables["imu"]) / float(np.median(seconds)), states


# ----------------------------------------------------------------------------------------------------------- writing


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", choices=RECORDINGS, help="one recording")
    parser.add_argument("--cache", type=Path, help="keep pyins' results in this file and take them from it")
    parser.add_argument("--out", type=Path, help="write peers.json and the table of peers.md into this folder")
    given = parser.parse_args()
    cache: dict[str, Any] = json.loads(given.cache.read_text()) if given.cache and given.cache.is_file() else {}
    found: dict[str, Any] = {}
    for name, (folder, _) in RECORDINGS.items():
        if given.only not in (None, name) or not (DATA / folder).is_dir():
            continue
        with tempfile.TemporaryDirectory() as out:
            tables = Path(out) / "tables"
            prepare_example(name, DATA / folder, tables)
            result = variant(tables)
            if name not in cache:
                cache[name] = peer_rows(result)
                if given.cache is not None:
                    given.cache.write_text(json.dumps(cache, indent=1) + "\n")
            lengths = [r["length_s"] for r in cache[name]]
            found[name] = {
                "pyins": cache[name],
                "ours": our_rows(tables, result, lengths, None),
                "alone": our_rows(tables, result, lengths, alone(name)),
            }
            found[name]["ours_per_s"], found[name]["states"] = our_speed(tables, name)
            found[name]["pyins_per_s"] = peer_speed(result)
    text = markdown(found)
    print(text)
    if given.out is not None:
        machine = f"{platform.machine()}, Python {platform.python_version()}, numpy {np.__version__}"
        (given.out / "peers.json").write_text(json.dumps({"machine": machine, "recordings": found}, indent=1) + "\n")
        between(given.out / "peers.md", BEGIN, END, text)
    return 0


BEGIN, END = "<!-- peers: python benchmarks/peer_pyins.py --out docs -->", "<!-- end of peers -->"


def markdown(found: dict[str, Any]) -> str:
    """The tables of docs/peers.md."""
    lines = [
        "| recording | without fixes | outages | pyins | INS alone | as the study | smoother, largest | |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for name, told in found.items():
        for peer, ours, bare in zip(told["pyins"], told["ours"], told["alone"], strict=True):
            length = peer["length_s"]
            label = f"{length:g} s" if length else "at the fixes used"
            smooth = ours.get("smoother")
            cells = [name, label, str(peer["windows"]) if length else "", both(peer), both(bare), both(ours)]
            cells += ["" if smooth is None else f"{smooth:.2g}", peer.get("note", "")]
            lines.append(f"| {' | '.join(cells)} |")
    lines += ["", "| recording | pyins, epochs/s | INS alone, epochs/s (states) | ratio |", "|---|---|---|---|"]
    for name, told in found.items():
        a, b = told["pyins_per_s"], told["ours_per_s"]
        lines.append(f"| {name} | {a:.0f} | {b:,.0f} ({told['states']}) | {b / a:,.0f} |".replace(",", " "))
    return "\n".join(lines) + "\n"


def both(row: dict[str, Any]) -> str:
    return f"{row['p50']:.3g} / {row['p95']:.3g}"


if __name__ == "__main__":
    sys.exit(main())
