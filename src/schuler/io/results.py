"""The result folder: written beside its place under another name and renamed, so it appears complete or not at all."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from xml.sax.saxutils import escape

import numpy as np
from numpy.typing import NDArray

from schuler.aiding.planar_settings import Metres
from schuler.aiding.solution import Navigation, Solution
from schuler.ground.errors import InputError

Array = NDArray[np.float64]
DEG = np.pi / 180.0
RESULT_FILES = ("summary.json", "calibration.json", "allan.json")
KML_POINTS = 5000  # a viewer draws more than that slowly, and nobody sees the difference
_ROWS_AT_ONCE = 2000


# ---- complete or not at all ----


def is_result_folder(path: Path) -> bool:
    """Whether a folder is one that this program wrote: it holds a summary.json, or one of the names beside it, with
    "made_by"."""
    for name in RESULT_FILES:
        try:
            content = json.loads((path / name).read_text(encoding="utf-8"))
        except (OSError, ValueError):
            continue
        if isinstance(content, dict) and "made_by" in content:
            return True
    return False


def check_target(out: str | Path) -> Path:
    """The place of a result folder if it may be written there, else InputError. An empty folder may be filled."""
    out = Path(out)
    if out.is_symlink() or (out.exists() and not out.is_dir()):
        raise InputError(f"{out} exists and is not a folder; type another --out")
    if out.is_dir() and any(out.iterdir()) and not is_result_folder(out):
        raise InputError(
            f"{out} exists and is not a result folder of schuler (no summary.json made by it); "
            "it is left as it is; type another --out"
        )
    parent = out.resolve().parent
    nearest = next(p for p in (parent, *parent.parents) if p.exists())
    if not nearest.is_dir() or not os.access(nearest, os.W_OK | os.X_OK):
        raise InputError(
            f"{out} cannot be written: {nearest} is not a folder that you may write to; type another --out"
        )
    return out


@contextmanager
def result_folder(out: str | Path) -> Iterator[Path]:
    """A temporary folder beside `out` that takes its place when the block ends well, and vanishes when it does not."""
    out = check_target(out)
    place = out.resolve()
    mark = f".{place.name}.{os.getpid()}"
    partial, older = place.with_name(mark + ".partial"), place.with_name(mark + ".older")
    try:
        place.parent.mkdir(parents=True, exist_ok=True)
        partial.mkdir()
    except OSError as error:
        raise InputError(f"{out} cannot be written: {error.strerror}; type another --out") from None
    try:
        yield partial
        moved = False
        if place.exists():
            place.rename(older)
            moved = True
        try:
            partial.rename(place)
        except OSError:
            if moved:
                older.rename(place)
            raise
    except OSError as error:
        raise InputError(f"{out} cannot be written: {error.strerror}") from error
    finally:
        shutil.rmtree(partial, ignore_errors=True)
        shutil.rmtree(older, ignore_errors=True)


# ---- the files ----


def track_columns(solution: Solution, metres: Metres | None = None) -> dict[str, Array]:
    """Columns of solution.csv in its units and order; those that are not known anywhere are left out.

    metres : the plane of a study whose tables are in metres: north and east are told too, and instead of latitude and
    longitude where nobody said where on the Earth the plane lies.
    """

    def root(cov: Array, k: int) -> Array:
        return np.sqrt(np.maximum(cov[:, k, k], 0.0))

    longitude = np.mod(solution.lon + np.pi, 2.0 * np.pi) - np.pi
    columns = {
        "time[s]": solution.time,
        "lat[deg]": solution.lat / DEG,
        "lon[deg]": longitude / DEG,
        "height[m]": solution.height,
        "v_north[m/s]": solution.v_n[:, 0],
        "v_east[m/s]": solution.v_n[:, 1],
        "v_down[m/s]": solution.v_n[:, 2],
        "roll[deg]": solution.rpy[:, 0] / DEG,
        "pitch[deg]": solution.rpy[:, 1] / DEG,
        "heading[deg]": np.mod(solution.rpy[:, 2], 2.0 * np.pi) / DEG,
    }
    if metres is not None:
        north, east = metres.north_east(solution.lat, solution.lon)
        placed = ("lat[deg]", "lon[deg]") if metres.placed else ()
        told = {k: columns[k] for k in ("time[s]", *placed)} | {"north[m]": north, "east[m]": east}
        columns = told | {k: v for k, v in columns.items() if k not in ("lat[deg]", "lon[deg]")}
    for k, axis in enumerate(("north", "east", "down")):
        columns[f"std_{axis}[m]"] = root(solution.cov_pos, k)
    for k, axis in enumerate(("north", "east", "down")):
        columns[f"std_v_{axis}[m/s]"] = root(solution.cov_vel, k)
    for k, axis in enumerate(("roll", "pitch", "heading")):
        columns[f"std_{axis}[deg]"] = root(solution.cov_rpy, k) / DEG
    return {name: values for name, values in columns.items() if name == "time[s]" or np.isfinite(values).any()}


def write_columns(path: str | Path, columns: Mapping[str, Array], digits: Mapping[str, int] | None = None) -> None:
    """A CSV file with the unit in the header: fixed point, 6 digits unless said otherwise; the same bytes each time."""
    digits = digits or {}
    row = ",".join(f"%.{digits.get(name, 6)}f" for name in columns) + "\n"
    values = np.column_stack([np.asarray(v, dtype=np.float64) for v in columns.values()])
    with open(path, "w", encoding="utf-8", newline="\n") as file:
        file.write(",".join(columns) + "\n")
        for start in range(0, len(values), _ROWS_AT_ONCE):
            part = values[start : start + _ROWS_AT_ONCE]
            file.write((row * len(part)) % tuple(part.ravel().tolist()))


def write_track(path: str | Path, solution: Solution, metres: Metres | None = None) -> None:
    """solution.csv or smoothed.csv: latitude and longitude with 12 digits after the point."""
    write_columns(path, track_columns(solution, metres), {"lat[deg]": 12, "lon[deg]": 12})


def plain(value: Any) -> Any:
    """What JSON can hold: numpy to numbers, NaN and infinity to null, tuples to lists."""
    if isinstance(value, Mapping):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, list | tuple):
        return [plain(v) for v in value]
    if isinstance(value, bool | np.bool_):
        return bool(value)
    if isinstance(value, int | np.integer):
        return int(value)
    if isinstance(value, float | np.floating):
        return float(value) if np.isfinite(value) else None
    if value is None or isinstance(value, str):
        return value
    return str(value)


def json_text(value: Any) -> str:
    """Valid JSON (RFC 8259: no NaN) with a line end."""
    return json.dumps(plain(value), indent=2, allow_nan=False, ensure_ascii=False) + "\n"


def kml_text(name: str, navigation: Navigation, places: Sequence[tuple[str, float, float]] = ()) -> str:
    """A map viewer's file: the filter's track, the smoothed one, start, end, named places (name, lat, lon in rad)."""
    parts = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        '<kml xmlns="http://www.opengis.net/kml/2.2">',
        "<Document>",
        f"<name>{_xml(name)}</name>",
        _kml_style("filter", "ff3c82e6"),
        _kml_style("smoothed", "ffb4781e"),
    ]
    metres = navigation.extras.get("metres")
    if metres is not None and not metres.placed:
        where = "This track is in metres; type lat_deg and lon_deg of their origin under [start] to see it on a map."
        return "\n".join([*parts, f"<description>{where}</description>", "</Document>", "</kml>", ""])
    parts.append(_kml_line("filter", navigation.filter))
    if navigation.smoother is not None:
        parts.append(_kml_line("smoothed", navigation.smoother))
    known = np.flatnonzero(np.isfinite(navigation.filter.lat) & np.isfinite(navigation.filter.lon))
    marks = list(places)
    if len(known):
        f = navigation.filter
        marks = [("start", f.lat[known[0]], f.lon[known[0]]), *marks, ("end", f.lat[known[-1]], f.lon[known[-1]])]
    for label, lat, lon in marks:
        parts.append(
            f"<Placemark><name>{_xml(label)}</name><Point><coordinates>{_degrees(lon)},{_degrees(lat)},0</coordinates>"
            "</Point></Placemark>"
        )
    return "\n".join([*parts, "</Document>", "</kml>", ""])


def _xml(text: str) -> str:
    """Escaped, and without the control characters that XML 1.0 cannot hold at all."""
    return escape("".join(c for c in text if c in "\t\n\r" or ord(c) >= 32 and ord(c) not in (0xFFFE, 0xFFFF)))


def _degrees(angle: float) -> str:
    return f"{(float(angle) + np.pi) % (2 * np.pi) / DEG - 180.0:.8f}"


def _kml_style(name: str, colour: str) -> str:
    return f'<Style id="{name}"><LineStyle><color>{colour}</color><width>2</width></LineStyle></Style>'


def _kml_line(name: str, solution: Solution) -> str:
    known = np.flatnonzero(np.isfinite(solution.lat) & np.isfinite(solution.lon))
    if len(known) == 0:
        return ""  # an attitude has no place
    if len(known) > KML_POINTS:
        known = known[np.unique(np.linspace(0, len(known) - 1, KML_POINTS).astype(int))]
    lat = solution.lat[known] / DEG
    lon = (np.mod(solution.lon[known] + np.pi, 2 * np.pi) - np.pi) / DEG
    jumps = np.flatnonzero(np.abs(np.diff(lon)) > 180.0) + 1  # a line across the antimeridian would go round the Earth
    lines = []
    for part in np.split(np.arange(len(known)), jumps):
        pairs = np.column_stack([lon[part], lat[part]]).ravel().tolist()
        text = ("%.8f,%.8f,0 " * len(part)) % tuple(pairs)
        lines.append(f"<LineString><tessellate>1</tessellate><coordinates>{text.rstrip()}</coordinates></LineString>")
    return (
        f"<Placemark><name>{_xml(name)}</name><styleUrl>#{name}</styleUrl>"
        f"<MultiGeometry>{''.join(lines)}</MultiGeometry></Placemark>"
    )


def write_results(
    out: str | Path,
    navigation: Navigation,
    summary: Mapping[str, Any],
    *,
    page: str,
    name: str = "track",
    places: Sequence[tuple[str, float, float]] = (),
) -> Path:
    """Writes a result folder and returns it. page: the text of report.html; places: marks for the map (rad)."""
    with result_folder(out) as folder:
        metres = navigation.extras.get("metres")
        write_track(folder / "solution.csv", navigation.filter, metres)
        if navigation.smoother is not None:
            write_track(folder / "smoothed.csv", navigation.smoother, metres)
        (folder / "track.kml").write_text(kml_text(name, navigation, places), encoding="utf-8", newline="\n")
        (folder / "report.html").write_text(page, encoding="utf-8", newline="\n")
        (folder / "summary.json").write_text(json_text(summary), encoding="utf-8", newline="\n")
    return Path(out)
