"""Result folders read back: summary.json, solution.csv and smoothed.csv, whatever they hold, within bounds."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from schuler.ground.errors import InputError
from schuler.judging.side_by_side import Stored, Track, name_results, printable

Array = NDArray[np.float64]
SUMMARY_BYTES = 32 << 20
TRACK_BYTES = 512 << 20  # of one file: about 40 h at 10 Hz
ROWS = 3_000_000  # of all tracks together; more are thinned out evenly
_FILES = {"filter": "solution.csv", "smoother": "smoothed.csv"}
_OTHER = {
    "calibration.json": "a calibration",
    "allan.json": "an Allan deviation",
    "alignment.json": "an alignment",
    "design.csv": "the design of a calibration",
}


def read_results(folders: Sequence[str | Path]) -> list[Stored]:
    """Every folder as a `Stored` with a label of its own. InputError holds one sentence a folder that is no result.

    A folder given twice is read once. A track that cannot be read is left out, with a note.
    """
    places: dict[Path, Path] = {}
    twice = []
    for folder in map(Path, folders):
        if places.setdefault(folder.resolve(), folder) is not folder:
            twice.append(folder)
    results, faults = [], []
    for folder in places.values():
        try:
            results.append(Stored(folder, read_summary(folder)))
        except InputError as error:
            faults.append(str(error))
    if faults:
        raise InputError("\n".join(faults))
    if not results:
        raise InputError(
            "no result folder was given; type the folders that schuler run wrote, e.g. one-result two-result"
        )
    name_results(results)
    for folder in twice:
        results[0].notes.append(f"{printable(str(folder))} was given twice; it is shown once")
    for result in results:
        for who, name in _FILES.items():
            _add_track(result, who, result.folder / name, ROWS // (2 * len(results)))
    return results


def read_summary(folder: Path) -> dict[str, Any]:
    """The content of a folder's summary.json; InputError where the folder is no result of a study."""
    if not folder.exists():
        raise InputError(f"{folder}: there is no such folder")
    if not folder.is_dir():
        beside = f"; type {folder.parent}" if (folder.parent / "summary.json").is_file() else ""
        raise InputError(f"{folder} is a file, where a result folder was expected{beside}")
    file = folder / "summary.json"
    if not file.is_file():
        raise InputError(f"{folder} is not a result folder: {_instead(folder)}")
    try:
        with file.open("rb") as stream:
            data = stream.read(SUMMARY_BYTES + 1)
    except OSError as error:
        raise InputError(f"{file} cannot be read: {error.strerror or error}") from None
    if len(data) > SUMMARY_BYTES:
        raise InputError(f"{file} is larger than {SUMMARY_BYTES >> 20} MiB, which no summary of schuler is")
    try:
        content = json.loads(data.decode("utf-8"))
    except (ValueError, RecursionError):
        raise InputError(f"{file} is damaged: it is not valid JSON; run the study again") from None
    if not isinstance(content, dict) or not any(isinstance(content.get(k), dict) for k in ("study", "made_by")):
        raise InputError(f"{folder} is not a result folder: its summary.json was not written by schuler run")
    return content


def _instead(folder: Path) -> str:
    """What a folder without a summary.json is."""
    for name, what in _OTHER.items():
        if (folder / name).is_file():
            return f"it holds {what} ({name}), not a track; compare takes what schuler run and schuler demo write"
    try:
        inside = sorted(p for p in folder.iterdir() if p.is_dir() and (p / "summary.json").is_file())
    except OSError:
        inside = []
    if inside:
        return f"it holds {len(inside)} of them; type  schuler compare {folder}/*  or their names, e.g. {inside[0]}"
    return "there is no summary.json in it; schuler run STUDY.toml writes one"


def _add_track(result: Stored, who: str, path: Path, rows: int) -> None:
    if not path.is_file():
        if who == "filter":
            result.notes.append(f"{result.label}: there is no solution.csv; only its figures are shown")
        return
    try:
        size = path.stat().st_size
        if size > TRACK_BYTES:
            raise InputError(f"{path.name}: {size >> 20} MiB, more than {TRACK_BYTES >> 20}")
        track = read_track(path)
    except InputError as error:
        result.notes.append(f"{result.label}: {printable(str(error), 300)}: its track is left out")
        return
    if len(track) > rows:
        step = -(-len(track) // rows)
        keep = np.unique(np.append(np.arange(0, len(track), step), len(track) - 1))
        track = track.rows(keep)
        result.notes.append(f"{result.label}: of {path.name} every row of {step} is drawn and compared")
    result.tracks[who] = track


def read_track(path: Path) -> Track:
    """solution.csv or smoothed.csv, with what columns it has. Rows without a time, or out of order, are left out."""
    from schuler.ground.units import split_header, to_si
    from schuler.io.sheets import read_sheet

    sheet = read_sheet(path)
    columns: dict[str, Array] = {}
    for heading, values in zip(sheet.headings, sheet.columns, strict=True):
        if values.dtype.kind not in "fiu":
            continue
        try:
            name, unit = split_header(heading)
            columns[name] = to_si(values, unit) if unit else values.astype(float)
        except InputError:  # a unit of another program: not a column that is compared
            continue
    if "time" not in columns:
        raise InputError(f"{path.name} has no column time[s]")
    n = len(columns["time"])
    unknown = np.full(n, np.nan)

    def get(*names: str) -> Array:
        return np.column_stack([columns.get(name, unknown) for name in names])

    lat, lon, height = get("lat", "lon", "height").T
    local = "lat" not in columns and "north" in columns and "east" in columns
    if local:
        from schuler.ground.earth import WGS84

        zero = np.zeros(n)
        lat, lon, _ = WGS84.displace(zero, zero, zero, np.column_stack([columns["north"], columns["east"], zero]))
    track = Track(
        columns["time"], lat, lon, height, get("v_north", "v_east", "v_down"), get("roll", "pitch", "heading"),
        get("std_north", "std_east", "std_down"), get("std_roll", "std_pitch", "std_heading"), local,
    )  # fmt: skip
    good = np.isfinite(track.time)
    good[good] = np.diff(np.maximum.accumulate(track.time[good]), prepend=-np.inf) > 0.0
    if not good.any():
        raise InputError(f"{path.name} has no row with a time")
    return track if good.all() else track.rows(good)
