"""`schuler calibrate`: a plan file and its recordings in, calibration.json, the page and the terminal's lines out."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from schuler import __version__
from schuler.ground.errors import InputError, StudyError
from schuler.ground.tables import Table
from schuler.ground.units import ARCMIN, DEG, MPS_PER_SQRT_H, PPM
from schuler.studies.run import Progress, silent

if TYPE_CHECKING:
    from schuler.calibration.corrections import Calibration
    from schuler.calibration.gyros import MultipositionResult
    from schuler.calibration.plan_design import TableModel
    from schuler.calibration.turntable import TurntableResult
    from schuler.studies.calibration_plan import Plan

Array = NDArray[np.float64]
AXES = "xyz"


@dataclass
class Calibrated:
    """A finished calibration. told: the content of calibration.json; result: what the page draws."""

    plan: Plan
    calibration: Calibration
    result: TurntableResult | MultipositionResult
    told: dict[str, Any]
    notes: list[str] = field(default_factory=list)

    def write(self, out: Path, progress: Progress = silent) -> Path:
        """calibration.json and report.html in a folder that appears complete or not at all."""
        from schuler.io.results import json_text, result_folder
        from schuler.report.calibration import calibration_page

        progress("drawing the page")
        page = calibration_page(self.plan, self.told, self.result)
        with result_folder(out) as folder:
            (folder / "calibration.json").write_text(json_text(self.told), encoding="utf-8", newline="\n")
            (folder / "report.html").write_text(page, encoding="utf-8", newline="\n")
        return out


def made_by(plan: Plan) -> dict[str, Any]:
    return {"version": __version__, "seed": None, "study_sha256": plan.sha256}


def read_inputs(plan: Plan, progress: Progress = silent) -> tuple[Table, Table | None]:
    """The imu table and, where the plan names one, the positions table."""
    from schuler.io.tables import read_table

    given = plan.input
    if given.imu is None:
        raise StudyError('[input] imu is absent: name the recording, imu = "imu.csv"')
    path = plan.folder / given.imu
    if not path.is_file():
        raise StudyError(f'[input] imu: "{given.imu}" does not exist (looked in {plan.folder})')
    progress(f"reading {path.name}")
    imu = read_table(
        path,
        "imu",
        gyro_unit=given.gyro_unit,
        accel_unit=given.accel_unit,
        trust_units=given.trust_units,
        rate_hz=given.rate_hz,
        scale_gyro_deg_per_s=given.scale_gyro_deg_per_s,
        scale_accel_g=given.scale_accel_g,
    )
    positions = None
    if given.positions is not None:
        place = plan.folder / given.positions
        if not place.is_file():
            raise StudyError(f'[input] positions: "{given.positions}" does not exist (looked in {plan.folder})')
        positions = read_table(place, "positions")
    return imu, positions


def calibrate(plan: Plan, progress: Progress = silent) -> Calibrated:
    """Runs a plan. InputError and StudyError say what to type."""
    if plan.plan.kind == "turntable" and plan.input.positions is None:
        raise StudyError("[input] positions is absent: a turntable plan needs the table of stops and spins")
    imu, positions = read_inputs(plan, progress)
    progress("calibrating")
    done = _turntable(plan, imu, positions) if plan.plan.kind == "turntable" else _multiposition(plan, imu, positions)
    return done


def _turntable(plan: Plan, imu: Table, positions: Table | None) -> Calibrated:
    from schuler.calibration import turntable
    from schuler.calibration.corrections import Calibration, Parameter

    assert positions is not None
    p = plan.plan
    directions = np.array([p.accel_x_direction, p.accel_y_direction, p.accel_z_direction])
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    settings = turntable.TurntableSettings(
        directions=directions,
        origin=(1e-3 * p.origin_mm[0], 1e-3 * p.origin_mm[1], 1e-3 * p.origin_mm[2]),
        gravity=plan.gravity,
        latitude=None if p.lat_deg is None else p.lat_deg * DEG,
        check=p.check,
    )
    result = turntable.calibrate(imu, positions, settings)
    parameters, blocks = [], []
    for i, lever in enumerate(result.levers):
        for j in range(3):
            seen = bool(lever.observable[j])
            parameters.append(
                Parameter(f"accel_{AXES[i]}_lever_{AXES[j]}_mm", float(lever.rho[j]), float(lever.std[j]), seen)
            )
        blocks.append(lever.covariance[np.ix_(lever.observable, lever.observable)])
    residuals = np.array([r for lever in result.levers for _, _, r in lever.residuals])
    left = np.array([r for lever in result.levers for _, _, r in lever.holdout])
    notes = [*imu.notes, *result.notes, *blind_sentences(result, positions, directions, plan)]
    from schuler.calibration.multiposition import rms

    calibration = Calibration(
        p.name,
        parameters,
        _block_diagonal(blocks),
        rms(residuals),
        rms(left),
        max(lever.condition for lever in result.levers),
        more={
            "conditions": [lever.condition for lever in result.levers],
            "noise_mps_per_sqrt_h": (result.noise / MPS_PER_SQRT_H).tolist(),
            "table_tilt_arcmin": {k: v / ARCMIN for k, v in result.tilt.items()},
            "constants": [
                {
                    "position": c.position,
                    "rate_deg_per_s": c.rate / DEG,
                    "turns": c.turns,
                    "mean_mps2": c.value.tolist(),
                    "std_mps2": np.sqrt(c.variance).tolist(),
                }
                for c in result.constants
            ],
            "budget_mm": _budget(plan, result, positions),
        },
        notes=notes,
    )
    return Calibrated(plan, calibration, result, calibration.as_dict(made_by(plan)), notes)


def _block_diagonal(blocks: list[Array]) -> Array:
    n = sum(len(b) for b in blocks)
    out = np.zeros((n, n))
    at = 0
    for b in blocks:
        out[at : at + len(b), at : at + len(b)] = b
        at += len(b)
    return out


def settings_of(positions: Table) -> Array:
    """(k, 2) gamma, beta of the positions that hold spins, rad."""
    seen: dict[str, tuple[float, float]] = {}
    for row in range(len(positions)):
        if str(positions["kind"][row]) == "spin":
            seen.setdefault(
                str(positions["position"][row]), (float(positions["gamma"][row]), float(positions["beta"][row]))
            )
    return np.array(list(seen.values()))


def blind_sentences(result: TurntableResult, positions: Table, directions: Array, plan: Plan) -> list[str]:
    """Which components the plan cannot see, and which position would show them."""
    from schuler.calibration.plan_design import would_show

    table = table_model(plan)
    settings = settings_of(positions)
    out = []
    for i, lever in enumerate(result.levers):
        hidden = [j for j in range(3) if not lever.observable[j]]
        if not hidden:
            continue
        names = ", ".join(f"accel_{AXES[i]}_lever_{AXES[j]}" for j in hidden)
        found: list[str] = []
        have = settings
        for j in hidden:
            more = would_show(have, directions[i], j, table)
            while more is None and len(found) < 3:
                step = _widest(have, directions[i], table)
                have = np.vstack([have, step])
                found.append(f"gamma {step[0] / DEG:.0f}, beta {step[1] / DEG:.0f} deg")
                more = would_show(have, directions[i], j, table)
            if more is not None and not _sees(have, directions[i], j):
                have = np.vstack([have, more])
                found.append(f"gamma {more[0] / DEG:.0f}, beta {more[1] / DEG:.0f} deg")
        out.append(f"{names}: not observable with these positions; add {' and '.join(found)}")
    return out


def _rows(settings: Array, e: Array) -> Array:
    from schuler.calibration.turntable import design_row
    from schuler.truth.turntable import spin_axis

    return design_row(spin_axis(settings[:, 0], settings[:, 1]), e)


def _sees(settings: Array, e: Array, component: int) -> bool:
    _, s, Vt = np.linalg.svd(_rows(settings, e), full_matrices=True)
    full = np.zeros(3)
    full[: s.size] = s
    return bool(np.linalg.norm(Vt[full < 1e-6 * max(float(full[0]), 1e-300), component]) < 1e-3)


def _widest(settings: Array, e: Array, table: TableModel) -> Array:
    """The setting that adds most where nothing was seen yet."""
    points = table.candidates()
    _, s, Vt = np.linalg.svd(_rows(settings, e), full_matrices=True)
    full = np.zeros(3)
    full[: s.size] = s
    blind = Vt[full < 1e-6 * max(float(full[0]), 1e-300)]
    return np.asarray(points[int(np.argmax(np.linalg.norm(_rows(points, e) @ blind.T, axis=1)))])


def table_model(plan: Plan) -> TableModel:
    """The table of [table], in SI."""
    from schuler.calibration.plan_design import TableModel

    t, p = plan.table, plan.plan
    default = TableModel()
    directions = np.array([p.accel_x_direction, p.accel_y_direction, p.accel_z_direction])
    return TableModel(
        rate=t.rate_deg_per_s * DEG,
        gammas=default.gammas if t.gammas_deg is None else tuple(g * DEG for g in t.gammas_deg),
        betas=default.betas if t.betas_deg is None else tuple(b * DEG for b in t.betas_deg),
        still=t.still_s,
        stops=t.stops,
        spin=t.spin_s,
        both_ways=t.both_ways,
        move=t.move_s,
        noise=t.accel_vrw_mps_per_sqrt_h * MPS_PER_SQRT_H,
        directions=directions / np.linalg.norm(directions, axis=1)[:, None],
        angle_error=t.angle_error_arcmin * ARCMIN,
        rate_error=t.rate_error_ppm * PPM,
        stop_error=t.stop_error_arcmin * ARCMIN,
        tilt=t.tilt_arcmin * ARCMIN,
        latitude=None if p.lat_deg is None else p.lat_deg * DEG,
    )


def _budget(plan: Plan, result: TurntableResult, positions: Table) -> dict[str, Any]:
    from schuler.calibration.plan_design import budget

    rho = np.array([np.where(lever.observable, lever.rho, 0.0) for lever in result.levers])
    settings = settings_of(positions)
    shares = budget(settings, table_model(plan), rho - 1e-3 * np.array(plan.plan.origin_mm), plan.gravity)
    out: dict[str, Any] = {s.source: (1e3 * s.std).tolist() for s in shares if s.source not in ("all",)}
    out.pop("noise of the accelerometers")  # the data themselves say it
    return out


def _multiposition(plan: Plan, imu: Table, positions: Table | None) -> Calibrated:
    from schuler.calibration import multiposition as mp
    from schuler.calibration.corrections import Calibration, Parameter, of_triad
    from schuler.calibration.turntable_checks import temperature as warming

    p = plan.plan
    result, reference_temperature = run_multiposition(imu, positions, plan)
    accel, gyro = result.accel, result.gyro
    parameters = of_triad("accel", accel.names, accel.values, accel.std, accel.observable)
    blocks = [accel.covariance[np.ix_(accel.observable, accel.observable)]]
    parameters += [
        Parameter(f"gyro_bias_{a}_deg_per_s", float(result.gyro_bias[i]), float(result.gyro_bias_std[i]), True)
        for i, a in enumerate(AXES)
    ]
    blocks.append(np.diag(result.gyro_bias_std**2))
    more: dict[str, Any] = {
        "rests": [{"start_s": r.start, "end_s": r.end, "force_mps2": r.force.tolist()} for r in result.rests],
        "gravity_mps2": plan.gravity,
        "before_rms_mps2": mp.rms(accel.before),
        "rest_residuals_mps2": accel.residuals.tolist(),
        "rest_holdout_mps2": accel.holdout.tolist(),
    }
    if gyro is not None:
        parameters += of_triad("gyro", gyro.names, gyro.values, gyro.std, gyro.observable)
        blocks.append(gyro.covariance[np.ix_(gyro.observable, gyro.observable)])
        more["gyro_transfer_deg"] = {
            "turns": len(result.turns),
            "before_rms": mp.rms(gyro.before) / DEG,
            "after_rms": mp.rms(gyro.residuals) / DEG,
            "holdout_rms": mp.rms(gyro.holdout) / DEG,
        }
        more["known_turns_deg"] = [
            {"axis": (t.axis / np.linalg.norm(t.axis)).tolist(), "angle": t.angle / DEG, "after": (got / DEG).tolist()}
            for t, got in result.known
            if t.axis is not None
        ]
    notes = [*imu.notes, *result.notes]
    if "temperature" in imu and not p.temperature:
        notes += warming(imu.time, imu["temperature"])
    if p.gravity_mps2 is None and p.lat_deg is None:
        notes.append(
            "gravity taken as the standard 9.80665 m/s^2: give gravity_mps2 or lat_deg, it may be 0.3 % off elsewhere"
        )
    hidden = [q.name for q in parameters if not q.observable]
    if hidden:
        notes.append(
            f"not observable with these rests, taken as zero: {', '.join(hidden)}; add rests with the axes "
            f"oblique to gravity" + (" and turns about each axis" if any(h.startswith("gyro") for h in hidden) else "")
        )
    calibration = Calibration(
        p.name,
        parameters,
        _block_diagonal(blocks),
        mp.rms(accel.residuals),
        mp.rms(accel.holdout),
        accel.condition,
        temperature=reference_temperature,
        more=more,
        notes=notes,
    )
    return Calibrated(plan, calibration, result, calibration.as_dict(made_by(plan)), notes)


def run_multiposition(imu: Table, positions: Table | None, plan: Plan) -> tuple[MultipositionResult, float | None]:
    """Rests found or given, then accelerometers, then gyros. Also the temperature that biases refer to."""
    from schuler.calibration import gyros
    from schuler.calibration import multiposition as mp
    from schuler.calibration.rests import find_rests, rest_of
    from schuler.calibration.stretches import stretches_of

    p = plan.plan
    time = imu.time
    if imu.kind == "increments" or "dv_x" in imu:
        dt = np.diff(time, prepend=time[0] - float(np.median(np.diff(time))))[:, None]
        force, gyro = imu.stack("dv_x", "dv_y", "dv_z") / dt, imu.stack("dtheta_x", "dtheta_y", "dtheta_z") / dt
    else:
        force, gyro = imu.stack("accel_x", "accel_y", "accel_z"), imu.stack("gyro_x", "gyro_y", "gyro_z")
    warm = imu["temperature"] if "temperature" in imu else None
    notes: list[str] = []
    found = find_rests(time, force, gyro, warm)
    known: list[gyros.Turn] = []
    up = None
    if positions is not None:
        rows = stretches_of(positions, "multiposition")
        cut: dict[str, tuple[int, int]] = {}
        for s in rows:
            first, last = np.searchsorted(time, [s.start, s.end])
            cut[s.name] = (int(first), int(last))
        for s in rows:
            if cut[s.name][1] - cut[s.name][0] < 10:
                raise InputError(
                    f"the {s.name} holds {cut[s.name][1] - cut[s.name][0]} rows of the recording, which runs "
                    f"from {time[0]:.1f} "
                    f"to {time[-1]:.1f} s; correct start[s] and end[s]"
                )
        known = [gyros.Turn(*cut[s.name], 0, 0, s.axis, s.angle) for s in rows if s.kind == "turn"]
        stills = [s for s in rows if s.kind == "still"]
        if stills:
            found_outside = (
                [r for r in found if all(r.end < s.start or r.start > s.end for s in stills)]
                if p.form != "full"
                else []
            )
            given = [rest_of(time, force, gyro, *cut[s.name], warm) for s in stills]
            _check_given(given, stills)
            found = sorted([*given, *found_outside], key=lambda r: r.start)
            if found_outside:
                notes.append(f"{len(found_outside)} rests more than the positions table names were found and used")
            if p.form == "full":
                if not all(np.all(np.isfinite(s.u)) for s in stills):
                    raise InputError(
                        'form = "full" needs gamma[deg] and beta[deg] for every still row of the positions table'
                    )
                order = np.argsort([s.start for s in stills])
                up = np.array([stills[i].u for i in order])
    if len(found) < 4:
        raise InputError(
            f"{len(found)} still stretches of a second or more were found, too few for a calibration; rest the "
            f"instrument for "
            "a few seconds in at least six positions, better twelve or more, each axis up, down and oblique"
        )
    _saturated(found, time, force, gyro)
    sizes = np.array([np.linalg.norm(r.force) for r in found])
    if abs(float(np.median(sizes)) / plan.gravity - 1.0) > 0.2:
        raise InputError(
            f"at rest the accelerometers show {np.median(sizes):.3g} m/s^2 where gravity is "
            f"{plan.gravity:.4g}: give their unit, "
            'accel_unit = "g" or "m/s^2" in [input]'
        )
    accel = mp.fit_accelerometers(found, plan.gravity, form=p.form, temperature=p.temperature, up=up)
    bias, bias_std = gyros.gyro_bias(found)
    turns = _explained(time, gyro, force, found, gyros.turns_between(found), accel, notes) if p.gyros else []
    fitted: mp.SensorFit | None = None
    told: list[tuple[gyros.Turn, Array]] = []
    if p.gyros and len(turns) + len(known) >= 3:
        fitted, told = gyros.fit_gyros(
            time, gyro, force, found, turns, accel, known=known, g_sensitivity=p.g_sensitivity
        )
    elif p.gyros:
        notes.append("too few turns between rests: the gyros' scale and misalignment were not fitted")
    reference = float(np.mean([r.temperature for r in found])) if p.temperature else None
    result = gyros.MultipositionResult(found, accel, fitted, bias, bias_std, turns, told, notes)
    return result, reference


def _check_given(rests: list[Any], stills: list[Any]) -> None:
    """InputError for a row "still" that was not."""
    usual = np.median([np.linalg.norm(r.scatter) for r in rests])
    rate = np.median([r.rate for r in rests], axis=0)
    for r, s in zip(rests, stills, strict=True):
        if np.linalg.norm(r.scatter) > 8.0 * usual + 0.05 or np.max(np.abs(r.rate - rate)) > 0.05:
            raise InputError(
                f"the {s.name} was not still: the accelerometers scatter by {np.linalg.norm(r.scatter):.2g} "
                f"m/s^2 (usual "
                f"{usual:.2g}), the gyros turn by {np.max(np.abs(r.rate - rate)) / DEG:.2g} deg/s; correct "
                f"start[s] and end[s]"
            )


def _saturated(rests: list[Any], time: Array, force: Array, gyro: Array) -> None:
    for values, word, unit in ((force, "accelerometer", "m/s^2"), (gyro, "gyro", "rad/s")):
        for i, a in enumerate(AXES):
            y = values[:, i]
            for edge in (y.max(), y.min()):
                at = np.concatenate([[False], y == edge, [False]])
                runs = np.diff(np.flatnonzero(np.diff(at.astype(int))))[::2]
                if (
                    np.ptp(y) > 0.0
                    and runs.size
                    and runs.max() >= max(5, 0.05 / np.median(np.diff(time)))
                    and len(np.unique(y)) > 100
                ):
                    raise InputError(
                        f"{word} {a} stays at its {'largest' if edge == y.max() else 'smallest'} value, "
                        f"{edge:.4g} {unit}, for "
                        f"{int(runs.max())} rows on end: it is saturated; turn slower or use a wider range"
                    )


def _explained(
    time: Array, gyro: Array, force: Array, rests: list[Any], turns: list[Any], accel: Any, notes: list[str]
) -> list[Any]:
    """The turns that the gyros, as they are, explain to 15 deg. InputError where another order of axes explains all."""
    import itertools

    from schuler.calibration import gyros
    from schuler.calibration.multiposition import rms

    if not turns:
        return turns
    limit = 15.0 * DEG
    good = gyros.transfer_angles(time, gyro, force, rests, turns, accel) < limit
    if good.all():
        return turns
    for order in itertools.permutations(range(3)):
        for signs in itertools.product((1.0, -1.0), repeat=3):
            turned = np.ascontiguousarray(gyro[:, list(order)] * np.array(signs))
            moved = [gyros.rest_like(r, r.rate[list(order)] * np.array(signs)) for r in rests]
            angles = gyros.transfer_angles(time, turned, force, moved, turns, accel)
            if np.all(angles < limit):
                word = ", ".join(("-" if s < 0 else "") + AXES[o] for o, s in zip(order, signs, strict=True))
                raise InputError(
                    "the gyros do not turn gravity as the accelerometers saw it: axes swapped or flipped; with "
                    "the gyros "
                    f"taken as ({word}) the difference falls to {rms(angles) / DEG:.2g} deg: reorder the columns and "
                    "calibrate again"
                )
    notes.append(
        f"{int((~good).sum())} of {len(turns)} turns between rests are not what the gyros measured (not "
        f"recorded, or a gyro "
        "at its range); they are left out"
    )
    return [t for t, ok in zip(turns, good, strict=True) if ok]


# ---- the terminal ----


def lines(done: Calibrated) -> list[str]:
    """What the terminal says."""
    t = done.told
    out = [f"{t['plan']}: {done.plan.plan.kind}, {len(t['parameters'])} parameters"]
    for p in t["parameters"]:
        if p["observable"]:
            out.append(f"  {p['name']:34s} {p['value']:12.4f}  1 sigma {p['std']:.2g}")
        else:
            out.append(f"  {p['name']:34s}  not observable")

    def said(value: Any) -> str:
        return "not possible" if value is None or not np.isfinite(value) else f"{value:.3g} m/s^2"

    out.append(f"  residual {said(t['residual_rms_mps2'])}, left out and predicted {said(t['holdout_rms_mps2'])} (rms)")
    gyro = t.get("gyro_transfer_deg")
    if gyro:
        out.append(
            f"  gravity carried by the gyros from rest to rest: {gyro['before_rms']:.2f} deg before, "
            f"{gyro['after_rms']:.3f} after (rms)"
        )
    return out
