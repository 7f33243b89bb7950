"""Seaglider dives to one mission: attitude, depth, speed through water, and GPS fixes at the surface.

Reads what the basestation leaves: `p*.nc` files (one, or a folder of them), or a set of tables of the same content,
diveN_eng, diveN_flightmodel, diveN_gps, diveN_meta (.csv or .csv.gz). Consecutive dives become one mission, in order of
time whatever their numbers. Vehicle and contract agree on the signs: pitch nose up, roll starboard down.

`speed` is the flight model's speed along the glide path, through water. Body axis and glide path differ by the angle of
attack, a few degrees, so it stands for the axial speed to a part in a thousand. It is a model's output, not a log's.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from schuler.ground.errors import InputError
from schuler.ground.tables import Table
from schuler.ground.times import iso_from_unix
from schuler.ground.units import DEG
from schuler.io.formats.common import HDOP_SIGMA, SEA_SURFACE_SIGMA, joined, need, numbered, whole_rows, wrapped
from schuler.io.sheets import read_sheet

Array = NDArray[np.float64]

_SET = re.compile(r"^dive0*(\d+)_(eng|flightmodel|gps|meta)\.csv(\.gz)?$", re.IGNORECASE)
_NC = re.compile(r"^p\d{7}.*\.nc$", re.IGNORECASE)


@dataclass
class Dive:
    """One dive in the contract's units. eng: time, depth, roll, pitch, heading_mag; speed: time, speed; gps: time, lat,
    lon, hdop, hpe. variation: magnetic variation, rad, east positive."""

    number: int
    eng: dict[str, NDArray]
    gps: dict[str, NDArray]
    variation: float
    speed: dict[str, NDArray] | None = None


def recognise(path: Path) -> bool:
    """A p*.nc file (any file that is netCDF: nothing else is read from those), or a folder with dives."""
    if path.is_dir():
        return any(_NC.match(p.name) or ((m := _SET.match(p.name)) and m[2].lower() == "eng") for p in path.iterdir())
    return path.is_file() and (bool(_NC.match(path.name)) or _is_netcdf(path))


def _is_netcdf(path: Path) -> bool:
    try:
        with path.open("rb") as file:
            head = file.read(4)
    except OSError:
        return False
    return head == b"\x89HDF" and path.suffix.lower() in (".nc", ".nc4") or head[:3] == b"CDF"


def convert(path: Path) -> dict[str, Table]:
    """Tables attitude, depth, gnss, and speed where the flight model's is there. Raises InputError."""
    notes: list[str] = []
    dives = _dives(path, notes)
    if not dives:
        raise InputError(f"{path}: no Seaglider dive in it (p*.nc files, or diveN_eng.csv with diveN_gps.csv)")
    dives.sort(key=lambda d: d.eng["time"][0])
    numbers = [d.number for d in dives]
    span = f"{iso_from_unix(dives[0].eng['time'][0], 0)} to {iso_from_unix(dives[-1].eng['time'][-1], 0)}"
    notes.append(
        f"{len(dives)} dive{'s' * (len(dives) > 1)} ({_ranges(numbers)}) in one mission, {span}; time is Unix time"
    )
    source = str(path)

    name = _variations(dives, notes)
    eng = joined([d.eng | {"turn": np.full(len(d.eng["time"]), d.variation)} for d in dives], "attitude", notes)
    attitude = {n: eng[n] for n in ("time", "roll", "pitch")}
    attitude[name] = wrapped(eng["heading_mag"] + eng["turn"])
    tables = {
        "attitude": Table("attitude", whole_rows(attitude, "attitude", notes), source=source),
        "depth": Table("depth", whole_rows({n: eng[n] for n in ("time", "depth")}, "depth", notes), source=source),
    }
    speeds = [d.speed for d in dives if d.speed is not None]
    if speeds:
        speed = whole_rows(joined(speeds, "speed", notes), "speed (none at the surface)", notes)
        tables["speed"] = Table("speed", speed, source=source)
        notes.append(
            "speed is the flight model's speed along the glide path through water, not a log; depth rate and pitch "
            "are an "
            "independent check of its scale"
        )
    if len(speeds) < len(dives):
        notes.append(f"speed: {len(dives) - len(speeds)} dives have no flight model")
    tables["gnss"] = Table("gnss", _fixes(dives, notes), source=source)
    for table in tables.values():
        table.notes = notes
    return tables


def _variations(dives: list[Dive], notes: list[str]) -> str:
    """Fills in the variation of dives that have none; returns which heading the compass then gives."""
    known = [d.variation for d in dives if np.isfinite(d.variation)]
    for dive in dives:
        if not np.isfinite(dive.variation):
            dive.variation = float(np.median(known)) if known else 0.0
    if not known:
        notes.append("no magnetic variation in the files: heading is magnetic and written as heading_mag")
        return "heading_mag"
    said = ", ".join(f"{v:g}" for v in sorted({round(v / DEG, 3) for v in known}))
    missing = len(dives) - len(known)
    notes.append(
        f"heading is true: the compass heading plus the file's magnetic variation of {said} deg (east positive)"
        + (f"; {missing} of {len(dives)} dives do not say theirs and take that of the others" if missing else "")
    )
    return "heading"


def _dives(path: Path, notes: list[str]) -> list[Dive]:
    """All dives of a file or folder; a dive that is there twice is read from its tables."""
    if path.is_file():
        return [_read_nc(path)]
    sets: dict[int, dict[str, Path]] = {}
    ncs: list[Path] = []
    for p in sorted(path.iterdir()):
        if m := _SET.match(p.name):
            sets.setdefault(int(m[1]), {})[m[2].lower()] = p
        elif _NC.match(p.name):
            ncs.append(p)
    dives: dict[int, Dive] = {}
    for number, files in sets.items():
        absent = [k for k in ("eng", "gps") if k not in files]
        if absent:
            notes.append(f"dive {number} left out: no dive{number}_{absent[0]}.csv")
            continue
        dives[number] = _read_set(number, files)
    for p in ncs:
        dive = _read_nc(p)
        if dive.number in dives:
            notes.append(f"{p.name}: dive {dive.number} is there as tables already; left out")
        else:
            dives[dive.number] = dive
    return list(dives.values())


def _read_set(number: int, files: dict[str, Path]) -> Dive:
    eng = numbered(read_sheet(files["eng"]))
    need(eng, "t_unix depth_m heading_mag_deg pitch_deg roll_deg", files["eng"])
    gps = numbered(read_sheet(files["gps"]))
    need(gps, "t_unix lat_deg lon_deg", files["gps"])
    count = len(gps["t_unix"])
    variation = np.nan
    if "meta" in files:
        meta = numbered(read_sheet(files["meta"]))
        need(meta, "magnetic_variation_deg", files["meta"])
        variation = float(meta["magnetic_variation_deg"][0])
    dive = Dive(
        number,
        {
            "time": eng["t_unix"],
            "depth": eng["depth_m"],
            "roll": eng["roll_deg"] * DEG,
            "pitch": eng["pitch_deg"] * DEG,
            "heading_mag": eng["heading_mag_deg"] * DEG,
        },
        {
            "time": gps["t_unix"],
            "lat": gps["lat_deg"] * DEG,
            "lon": gps["lon_deg"] * DEG,
            "hdop": gps.get("hdop", np.full(count, np.nan)),
            "hpe": gps.get("hpe_m", np.full(count, np.nan)),
        },
        variation * DEG,
    )
    if "flightmodel" in files:
        model = numbered(read_sheet(files["flightmodel"]))
        need(model, "t_unix speed_mps", files["flightmodel"])
        dive.speed = {"time": model["t_unix"], "speed": model["speed_mps"]}
    return dive


def _read_nc(path: Path) -> Dive:
    """One basestation file, netCDF-4 (h5netcdf) or netCDF-3 (scipy)."""
    variables, attributes = open_netcdf(path)

    def get(*names: str, scale: float = 1.0) -> Array:
        for name in names:
            if name in variables:
                return np.atleast_1d(np.asarray(variables[name], dtype=np.float64)) * scale
        raise InputError(f"{path.name}: variable {names[0]} is missing, so this is no Seaglider dive of a basestation")

    time = get("time")
    depth = get("depth") if "depth" in variables else get("eng_depth", scale=0.01)
    count = len(get("log_gps_time"))
    variation = np.nan
    for name in ("magnetic_variation", "log_gps_magvar"):
        if name in variables and not np.isfinite(variation):
            values = get(name)
            variation = float(values[np.isfinite(values)][-1]) if np.isfinite(values).any() else np.nan
    number = int(get("log_dive", "log_DIVE")[0]) if {"log_dive", "log_DIVE"} & variables.keys() else 0
    number = number or int(attributes.get("dive_number", 0)) or int(re.sub(r"\D", "", path.name)[-4:] or 0)
    gps = {
        "time": get("log_gps_time"),
        "lat": get("log_gps_lat", scale=DEG),
        "lon": get("log_gps_lon", scale=DEG),
        "hdop": get("log_gps_hdop") if "log_gps_hdop" in variables else np.full(count, np.nan),
        "hpe": get("log_gps_hpe") if "log_gps_hpe" in variables else np.full(count, np.nan),
    }
    if "log_gps_qc" in variables:
        flags = np.asarray(variables["log_gps_qc"]).astype("S1").astype("U1")
        bad = np.isin(flags, ["3", "4", "9"])  # probably bad, bad, missing
        gps["lat"] = np.where(bad, np.nan, gps["lat"])
    dive = Dive(
        number,
        {
            "time": time,
            "depth": depth,
            "roll": get("eng_rollAng", scale=DEG),
            "pitch": get("eng_pitchAng", scale=DEG),
            "heading_mag": get("eng_head", scale=DEG),
        },
        gps,
        variation * DEG,
    )
    if len({len(v) for v in dive.eng.values()}) > 1:
        raise InputError(
            f"{path.name}: time, depth, heading, pitch and roll have different lengths; the file is damaged"
        )
    for name in ("speed", "speed_gsm"):
        if name in variables and "ctd_time" in variables and dive.speed is None:
            dive.speed = {"time": get("ctd_time"), "speed": get(name, scale=0.01)}  # cm/s
    return dive


def open_netcdf(path: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    """Variables and global attributes of a netCDF file, read whole."""
    try:
        magic = path.read_bytes()[:4]
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror or error}") from None
    if magic[:3] == b"CDF":
        from scipy.io import netcdf_file

        try:
            with netcdf_file(str(path), "r", mmap=False) as f:
                return {k: v.data.copy() for k, v in f.variables.items()}, {}
        except (OSError, ValueError, TypeError, IndexError, KeyError):
            raise InputError(f"{path.name}: the netCDF file is damaged or cut off; fetch it again") from None
    if magic != b"\x89HDF":
        raise InputError(f"{path.name} is not a netCDF file, though its name ends in .nc")
    try:
        import h5netcdf
    except ImportError:
        raise InputError(f'{path.name}: reading netCDF needs h5netcdf; type: pip install "schuler[io]"') from None
    try:
        with h5netcdf.File(path, "r", decode_vlen_strings=True) as f:
            wanted = [k for k in f.variables if k.startswith(("log_gps", "eng_", "log_d", "log_D")) or k in _WANTED]
            return {k: f.variables[k][...] for k in wanted}, dict(f.attrs)
    except (OSError, ValueError, KeyError, RuntimeError, AttributeError):
        raise InputError(f"{path.name}: the netCDF file is damaged or cut off; fetch it again") from None


_WANTED = {"time", "depth", "speed", "speed_gsm", "ctd_time", "magnetic_variation"}


def _fixes(dives: list[Dive], notes: list[str]) -> dict[str, NDArray]:
    """GPS rows of all dives; the fix that ends a dive and opens the next is one row.

    Sigma of one axis: hpe where it is known (it is -1 where not), else 5 m times HDOP, at least 5 m.
    """
    gps = joined([d.gps for d in dives], "gnss (the last fix of a dive is the first of the next)", notes)
    at_zero = (gps["lat"] == 0.0) & (gps["lon"] == 0.0)
    good = (
        np.isfinite(gps["time"]) & np.isfinite(gps["lat"]) & np.isfinite(gps["lon"]) & ~at_zero & ~(gps["hdop"] >= 90)
    )
    if not good.all():
        notes.append(f"gnss: {int((~good).sum())} of {len(good)} fixes are not valid and were left out")
        gps = {n: v[good] for n, v in gps.items()}
    if not len(gps["time"]):
        raise InputError("none of the dives has a valid GPS fix, so there is no place to start from")
    from_hdop = HDOP_SIGMA * np.maximum(1.0, np.nan_to_num(gps["hdop"], nan=1.0))
    known = gps["hpe"] > 0.0
    sigma = np.where(known, gps["hpe"], from_hdop)
    notes.append(
        f"gnss: sigma of north and east is hpe in {int(known.sum())} fixes, else {HDOP_SIGMA:g} m times HDOP (at least "
        f"{HDOP_SIGMA:g} m); no height is recorded: 0 m with a sigma of {SEA_SURFACE_SIGMA:g} m (the sea against the "
        "ellipsoid)"
    )
    count = len(sigma)
    return {
        "time": gps["time"],
        "lat": gps["lat"],
        "lon": gps["lon"],
        "height": np.zeros(count),
        "std_north": sigma,
        "std_east": sigma.copy(),
        "std_down": np.full(count, SEA_SURFACE_SIGMA),
    }


def _ranges(numbers: list[int]) -> str:
    """100, 101, 102, 105 -> "100-102, 105"."""
    out: list[list[int]] = []
    for n in sorted(numbers):
        if out and n == out[-1][-1] + 1:
            out[-1].append(n)
        else:
            out.append([n])
    return ", ".join(f"{run[0]}-{run[-1]}" if len(run) > 1 else str(run[0]) for run in out)
