"""SeaExplorer navigation files to tables: attitude, depth and GPS fixes at the surface.

Reads the glider's own `*.gli.sub.N[.gz]` files (one, or a folder of them: semicolons, dates dd/mm/yyyy in UTC, Lat and
Lon as ddmm.mmm) and `nav.csv[.gz]`, one table of the same columns with `t_unix` beside them.

Fixes: the position column holds its last value through a dive, so a row is a fix only where the glider is at the
surface (NavState 116) and the position is not the one of the row before.

Heading: the files do not say whether `Heading` includes `Declination`. In the Sea035 mission M010 (60 dives, 17 deg),
dead reckoning from depth rate and pitch, fitted to the surface fixes together with a mean and the two main tidal
currents, asks for a rotation of +14.4 +- 2.3 deg: the declination is not in it. So it is added here, and said;
`heading_includes_declination=True` leaves the heading as it is.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from schuler.ground.errors import InputError
from schuler.ground.tables import Table
from schuler.ground.times import iso_from_unix
from schuler.ground.units import DEG
from schuler.io.formats.common import SEA_SURFACE_SIGMA, joined, numbered, wrapped
from schuler.io.sheets import Sheet, read_sheet

Array = NDArray[np.float64]

AT_SURFACE = 116  # NavState: transmitting, GPS on
FIX_SIGMA = 5.0  # m, north and east; the files hold none, and print positions to 1.9 m
_GLI = re.compile(r"\.gli\.sub\.\d+(\.gz)?$", re.IGNORECASE)
_NEEDED = ("NavState", "Heading", "Pitch", "Roll", "Depth", "Lat", "Lon")


def recognise(path: Path) -> bool:
    """Files named *.gli.sub.N, a folder with some, or a nav.csv (alone or in a folder) with NavState."""
    if path.is_dir():
        return any(_GLI.search(p.name) for p in path.iterdir()) or any(_is_nav(path / n) for n in _NAV)
    return bool(_GLI.search(path.name)) or _is_nav(path)


_NAV = ("nav.csv", "nav.csv.gz")


def _is_nav(path: Path) -> bool:
    if path.name.lower() not in _NAV or not path.is_file():
        return False
    try:
        headings = set(read_sheet(path).headings)
    except InputError:
        return False
    return headings.issuperset(_NEEDED)


def convert(path: Path, heading_includes_declination: bool = False) -> dict[str, Table]:
    """Tables attitude, depth and gnss. Raises InputError."""
    notes: list[str] = []
    if path.is_dir():
        files = sorted(p for p in path.iterdir() if _GLI.search(p.name)) or [
            path / n for n in _NAV if _is_nav(path / n)
        ]
    else:
        files = [path]
    parts = []
    for file in files:
        try:
            parts.append(_columns(read_sheet(file), file))
        except InputError as error:
            if len(files) == 1:
                raise
            notes.append(f"left out: {error}")
    if not parts:
        raise InputError(f"{path}: no readable SeaExplorer navigation file (*.gli.sub.N, nav.csv)")
    rows = joined(parts, "navigation files", notes)
    rows = _without_lost_clock(rows, notes)
    span = f"{iso_from_unix(rows['time'][0], 0)} to {iso_from_unix(rows['time'][-1], 0)}"
    notes.append(f"{len(parts)} file{'s' * (len(parts) > 1)}, {len(rows['time'])} rows, {span}; time is Unix time")

    good = np.all([np.isfinite(rows[n]) for n in ("heading", "pitch", "roll", "depth")], axis=0)
    if not good.any():
        raise InputError(f"{path}: no row has heading, pitch, roll and depth")
    if not good.all():
        notes.append(f"{int((~good).sum())} rows without heading, pitch, roll or depth left out of attitude and depth")
    heading, heading_name = rows["heading"], "heading"
    declination = rows["declination"]
    if heading_includes_declination:
        notes.append("heading is taken as true as it stands, as asked")
    elif np.isfinite(declination).any():
        heading = heading + np.nan_to_num(declination)
        said = ", ".join(f"{v:g}" for v in np.unique(np.round(declination[np.isfinite(declination)] / DEG, 2))[:5])
        notes.append(
            f"heading is true: the file's Heading plus its Declination of {said} deg; the file does not say whether "
            "Heading includes it; the track between fixes of one long mission said that it does not"
        )
    else:
        heading_name = "heading_mag"
        notes.append("the files hold no Declination: Heading is taken as magnetic and written as heading_mag")
    source = str(path)
    attitude = {n: rows[n][good] for n in ("time", "roll", "pitch")} | {heading_name: wrapped(heading[good])}
    tables = {
        "attitude": Table("attitude", attitude, source=source, notes=notes),
        "depth": Table("depth", {n: rows[n][good] for n in ("time", "depth")}, source=source, notes=notes),
    }
    tables["gnss"] = Table("gnss", _fixes(rows, notes), source=source, notes=notes)
    return tables


def _columns(sheet: Sheet, path: Path) -> dict[str, NDArray]:
    """time, heading, pitch, roll, declination, depth, lat, lon (SI), state of one file."""
    raw = numbered(sheet)
    absent = [n for n in _NEEDED if n not in raw]
    if absent:
        raise InputError(f"{path.name}: no SeaExplorer navigation file, column {absent[0]} is missing")
    words = [n for n in _NEEDED if raw[n].dtype.kind == "U"]
    if words:
        raise InputError(f"{path.name}: column {words[0]} holds text where numbers were expected")
    if "t_unix" in raw:
        time = raw["t_unix"]
    elif "Timestamp" in raw:
        time = np.array([_unix(str(s)) for s in raw["Timestamp"]])
    else:
        raise InputError(f"{path.name}: column Timestamp is missing")
    lat, lon = degrees(raw["Lat"]), degrees(raw["Lon"])
    declination = raw.get("Declination", np.full(len(sheet), np.nan))
    out = {
        "time": time,
        "state": raw["NavState"],
        "heading": raw["Heading"] * DEG,
        "pitch": raw["Pitch"] * DEG,
        "roll": raw["Roll"] * DEG,
        "declination": declination * DEG,
        "depth": raw["Depth"],
        "lat": lat * DEG,
        "lon": lon * DEG,
    }
    good = np.isfinite(time)
    if not good.any():
        raise InputError(f"{path.name}: no row has a time (dd/mm/yyyy hh:mm:ss expected in column Timestamp)")
    return {k: v[good] for k, v in out.items()}


def degrees(ddmm: Array) -> Array:
    """Degrees of numbers written ddmm.mmm: 5139.272 is 51 deg 39.272 min."""
    whole = np.trunc(ddmm / 100.0)
    return whole + (ddmm - 100.0 * whole) / 60.0


def _unix(text: str) -> float:
    """Unix seconds of "dd/mm/yyyy hh:mm:ss[.fff]" (UTC), NaN where it is none."""
    m = re.match(r"^(\d{1,2})/(\d{1,2})/(\d{4})[ T](\d{1,2}):(\d{2}):(\d{2}(?:\.\d+)?)$", text.strip())
    if not m:
        return float("nan")
    day, month, year, hour, minute = (int(g) for g in m.groups()[:5])
    try:
        date = np.datetime64(f"{year:04d}-{month:02d}-{day:02d}", "s")
    except ValueError:
        return float("nan")
    return float(date.astype(np.int64)) + 3600.0 * hour + 60.0 * minute + float(m[6])


def _without_lost_clock(rows: dict[str, NDArray], notes: list[str]) -> dict[str, NDArray]:
    """Rows stamped before the clock was set (months away from the others) left out."""
    time = rows["time"]
    far = np.abs(time - np.median(time)) > 200 * 86400.0
    if far.any():
        notes.append(
            f"{int(far.sum())} rows with a clock that was not set ({iso_from_unix(time[far][0], 0)}) were left out"
        )
        rows = {k: v[~far] for k, v in rows.items()}
    return rows


def _fixes(rows: dict[str, NDArray], notes: list[str]) -> dict[str, NDArray]:
    lat, lon = rows["lat"], rows["lon"]
    known = np.isfinite(lat) & np.isfinite(lon) & (np.abs(lat) <= np.pi / 2) & ~((lat == 0.0) & (lon == 0.0))
    changed = np.concatenate([[False], (np.diff(lat) != 0.0) | (np.diff(lon) != 0.0)])
    surface = rows["state"] == AT_SURFACE
    fix = known & changed & surface
    if not fix.any():
        raise InputError("no GPS fix: the position never changes while the glider is at the surface (NavState 116)")
    count = int(fix.sum())
    notes.append(
        f"gnss: {count} fixes, rows at the surface where the position is new; {int((surface & ~fix).sum())} rows at "
        "the "
        f"surface that hold an old position are none. Sigma {FIX_SIGMA:g} m (assumed); no height is recorded: 0 m "
        "with a "
        f"sigma of {SEA_SURFACE_SIGMA:g} m (the sea against the ellipsoid)"
    )
    return {
        "time": rows["time"][fix],
        "lat": lat[fix],
        "lon": lon[fix],
        "height": np.zeros(count),
        "std_north": np.full(count, FIX_SIGMA),
        "std_east": np.full(count, FIX_SIGMA),
        "std_down": np.full(count, SEA_SURFACE_SIGMA),
    }
