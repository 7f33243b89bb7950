"""The head of the page: what happened and how good it was, in words and in a few figures."""

from __future__ import annotations

import math
import re

import numpy as np

from schuler.judging.consistency import chi2_quantile
from schuler.judging.words import consistency_words
from schuler.report.parts import NONE, Opening, Tile, metres, number, plural, seconds
from schuler.report.sections.consistency import doubts, title_of
from schuler.report.view import Dive, View

_UNITS = r"(\d) (?=(?:%|m|km|s|min|h|days|deg|sigma)\b|%)"  # a figure and its unit stay on one line
_RARE = 0.01  # a verdict of "not consistent" is wrong once in a hundred honest filters


def aided(view: View) -> Opening:
    verdict, tone, tiles = _judged(view)
    wrong, doubted = _beware(view)
    verdict = " ".join([verdict, *wrong, *doubted])
    tone = "warn" if wrong else tone
    what = {"auv": "AUV", "aided": "aided inertial", "planar": "planar"}.get(view.kind, view.kind)
    parts = [f"{what} navigation" if what else "navigation"]
    if view.method:
        parts.append(f"method {view.method}")
    parts.append("simulated" if view.simulated else "recorded")
    if (seed := view.result.made_by.get("seed")) is not None and view.simulated:
        parts[-1] += f", seed {seed}"
    return Opening(view.name, " · ".join(parts), re.sub(_UNITS, "\\1\u00a0", verdict), tone, tiles)


def _beware(view: View) -> tuple[list[str], list[str]]:
    """Sentences on sigmas that are not true, and on sensors that were distrusted; the chapters say more."""
    said = [s.split(";")[0] for s in consistency_words(view.summary.get("consistency") or {})][:2]
    long: dict[str, float] = {}
    for entry in doubts(view):
        name = title_of(str(entry["sensor"]))
        long[name] = long.get(name, 0.0) + float(entry["end_s"]) - float(entry["start_s"])
    doubted = [f"{name} was distrusted for {seconds(time)}." for name, time in long.items() if time > 0.0]
    return [f"{s[0].upper()}{s[1:]}." for s in said], doubted


def _without(view: View) -> str:
    return "under water without GPS" if view.kind == "auv" else "without GNSS"


def _judged(view: View) -> tuple[str, str, list[Tile]]:
    if not len(view.filter.time):
        return "The track has no rows: nothing can be said.", "warn", []
    known = [d for d in view.dives if math.isfinite(d.of("horizontal_end_m"))]
    if known:
        return _against_truth(view, known)
    missed = [d for d in view.dives if d.surfacing is not None]
    if missed:
        return _against_fixes(view, missed)
    return _no_dive(view)


def _against_truth(view: View, dives: list[Dive]) -> tuple[str, str, list[Tile]]:
    error = np.array([d.of("horizontal_end_m") for d in dives])
    sigma = np.array([d.of("sigma_end_m") for d in dives])
    square = 2.0 * np.array([d.of("nees_half_end") for d in dives])
    length = np.array([d.of("distance_m") for d in dives])
    lasted = np.array([d.seconds for d in dives])
    share = 100.0 * float(error.sum() / length.sum()) if length.sum() > 0 else math.nan
    judged = np.isfinite(square)
    said = float(np.nanmean(sigma)) if np.isfinite(sigma).any() else None
    tone = ""
    if len(dives) == 1:
        verdict = f"After {seconds(float(lasted[0]))} {_without(view)} "
        verdict += f"the track ends {metres(float(error[0]))} from the truth"
        if math.isfinite(share):
            verdict += f", {number(share, 2)} % of the distance travelled"
        if judged[0]:
            good = bool(square[0] <= chi2_quantile(2, 1.0 - _RARE))
            tone = "good" if good else "warn"
            verdict += f"; the filter said {metres(said)} (1 sigma): " + _word(good)
        else:
            verdict += "; the filter gave no sigma."
    else:
        verdict = (
            f"At the end of {plural(len(dives), 'dive')} {_without(view)}, {seconds(float(np.median(lasted)))} each, "
            f"the track is {metres(float(error.mean()))} from the truth on average and "
            f"{metres(float(error.max()))} at worst"
        )
        if math.isfinite(share):
            verdict += f", {number(share, 2)} % of the distance travelled"
        if judged.any():
            inside = int((square[judged] <= chi2_quantile(2, 0.95)).sum())
            good = _plausible(inside, int(judged.sum()))
            tone = "good" if good else "warn"
            verdict += f"; {inside} of {int(judged.sum())} lie inside the filter's 95 % ellipse: " + _word(good)
        else:
            verdict += "."
    tiles = [
        Tile(
            "Error at the dive's end" if len(dives) == 1 else "Error at the ends, mean",
            *_split(metres(float(error.mean()))),
            note=f"filter's 1 sigma: {metres(said)}",
            tone=tone,
        ),
        Tile(
            "Of the distance",
            number(share, 2),
            "%",
            f"{metres(float(length.mean()))} {'travelled' if len(dives) == 1 else 'a dive'}",
        ),
    ]
    smoothed = [d.of("smoother_rms_m") for d in dives if math.isfinite(d.of("smoother_rms_m"))]
    tiles += _heading_tile(view, dives)
    if smoothed:
        rms = float(np.sqrt(np.mean(np.square(smoothed))))
        verdict += f" Smoothed with the fixes that came later, the track in between is {metres(rms)} (rms) off."
        tiles.append(Tile("Smoothed track, rms", *_split(metres(rms)), note="the same stretch, afterwards"))
    return verdict, tone, tiles + _nees_tile(view)


def _against_fixes(view: View, dives: list[Dive]) -> tuple[str, str, list[Tile]]:
    ends = [d.surfacing for d in dives if d.surfacing is not None]
    miss = np.array([s["miss_m"] for s in ends], dtype=float)
    sigma = np.array([s["sigma_major_m"] for s in ends], dtype=float)
    length = np.array([d.of("distance_m") for d in dives])
    share = 100.0 * float(miss.sum() / np.nansum(length)) if np.nansum(length) > 0 else math.nan
    inside = sum(bool(s["inside_95"]) for s in ends)
    lasted = seconds(float(np.median([d.seconds for d in dives])))
    if len(dives) == 1:
        verdict = (
            f"After {lasted} {_without(view)} the first fix lies {metres(float(miss[0]))} from where it was expected"
        )
    else:
        verdict = (
            f"At the end of {plural(len(dives), 'dive')} {_without(view)}, {lasted} each, the first fix lies "
            f"{metres(float(miss.mean()))} from where it was expected on average, {metres(float(np.median(miss)))} in "
            f"the median and {metres(float(miss.max()))} at worst"
        )
    if math.isfinite(share):
        verdict += f", {number(share, 2)} % of the distance travelled"
    good = _plausible(inside, len(ends))
    verdict += (
        f"; {inside} of {plural(len(ends), 'fix', 'fixes')} inside the 95 % ellipse of prediction and fix: "
        + _word(good)
    )
    tone = "good" if good else "warn"
    tiles = [
        Tile(
            "Miss at surfacing, mean",
            *_split(metres(float(miss.mean()))),
            note=f"median {metres(float(np.median(miss)))}",
            tone=tone,
        ),
        Tile("Of the distance", number(share, 2), "%", f"{metres(float(np.nanmean(length)))} a dive"),
        Tile(
            "Predicted 1 sigma, median",
            *_split(metres(float(np.median(sigma)))),
            note="largest axis, with the fix's own",
        ),
        Tile("Inside the 95 % ellipse", f"{inside} of {len(ends)}", "", "19 of 20 expected"),
    ]
    return verdict, tone, tiles + _nis_tile(view)


def _word(good: bool) -> str:
    return "consistent." if good else "not consistent, the sigma is too small."


def _no_dive(view: View) -> tuple[str, str, list[Tile]]:
    lasted, length = seconds(view.span[1] - view.span[0]), metres(view.length)
    tiles = [Tile("Duration", *_split(lasted)), Tile("Distance", *_split(length))]
    row = len(view.filter.time) - 1
    cov = view.filter.solution.cov_pos[row, :2, :2]
    sigma = float(np.sqrt(max(np.linalg.eigvalsh(cov)[-1], 0.0))) if np.isfinite(cov).all() else None
    table = (view.summary.get("errors") or {}).get("filter") or {}
    flat = table.get("horizontal_m") or {}
    if flat.get("rms") is not None:
        verdict = (
            f"Over {lasted} and {length} the track is {metres(flat['rms'])} (rms) from the truth, at worst "
            f"{metres(flat.get('max'))}; at the end {metres(flat.get('end'))}, where the filter says {metres(sigma)} "
            "(1 sigma)."
        )
        tiles.insert(
            0, Tile("Horizontal error, rms", *_split(metres(flat["rms"])), note=f"at worst {metres(flat.get('max'))}")
        )
    else:
        verdict = (
            f"{lasted} and {length} navigated, with nothing to judge the track against; the filter's own sigma of the "
            f"position at the end is {metres(sigma)}."
        )
        tiles.append(Tile("1 sigma at the end", *_split(metres(sigma)), note="the filter's own word"))
    return verdict, "", tiles + _nees_tile(view) + _nis_tile(view)


def _heading_tile(view: View, dives: list[Dive]) -> list[Tile]:
    error = np.array([d.of("heading_end_deg") for d in dives])
    sigma = np.array([d.of("heading_sigma_deg") for d in dives])
    error, sigma = error[np.isfinite(error)], sigma[np.isfinite(sigma)]
    if not len(error):
        return []
    name = "Heading error at its end" if len(dives) == 1 else "Heading error at the ends, rms"
    note = f"filter's 1 sigma: {number(float(sigma.mean()), 2)} deg" if len(sigma) else ""
    return [Tile(name, number(float(np.sqrt(np.mean(error**2))), 2), "deg", note)]


def _nees_tile(view: View) -> list[Tile]:
    c = view.summary.get("consistency") or {}
    inside = c.get("inside_3_sigma")
    if inside is None:
        return []
    note = (
        f"position NEES {number(c.get('nees_position'), 2)}, 1 is ideal" if c.get("nees_position") is not None else ""
    )
    return [Tile("Errors inside 3 sigma", number(100.0 * inside, 3), "%", note)]


def _nis_tile(view: View) -> list[Tile]:
    nis = ((view.summary.get("consistency") or {}).get("nis") or {}).get("gnss_position")
    if not nis or nis.get("mean") is None:
        return []
    note = (
        f"99 % bounds {number(nis.get('low'), 2)} to {number(nis.get('high'), 2)}" if nis.get("low") is not None else ""
    )
    tone = "warn" if nis.get("high") is not None and nis["mean"] > nis["high"] else ""
    return [Tile("NIS of the fixes", number(nis["mean"], 2), "", note, tone)]


def _plausible(inside: int, count: int) -> bool:
    """Would an honest filter have so few of its errors inside the 95 % ellipse more than once in a hundred?"""
    if not count:
        return True
    few = sum(math.comb(count, k) * 0.95**k * 0.05 ** (count - k) for k in range(inside + 1))
    return few >= _RARE


def _split(text: str) -> tuple[str, str]:
    """'23 m' -> ('23', 'm')."""
    value, _, unit = text.partition(" ")
    return (value, unit) if text != NONE else (NONE, "")
