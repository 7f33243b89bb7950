"""Pages of a calibration and of a turntable plan."""

from __future__ import annotations

from typing import Any

import numpy as np

from schuler.report.figures import FILTER, FIX, SERIES, SMOOTHED, Pool
from schuler.report.parts import NONE, Figure, Grid, Opening, Section, Tile, number
from schuler.report.sheet import chart, sheet

DEG = np.pi / 180.0
AXES = "xyz"


def calibration_page(plan: Any, told: dict[str, Any], result: Any) -> str:
    """Parameters with sigmas and observability, residuals and hold-out, what the plan sees."""
    pool = Pool()
    seen = [p for p in told["parameters"] if p["observable"]]
    hidden = [p for p in told["parameters"] if not p["observable"]]
    hold, fit = told["holdout_rms_mps2"], told["residual_rms_mps2"]
    verdict = f"{len(seen)} of {len(told['parameters'])} parameters are observable."
    if _finite(hold):
        verdict += f" What was left out of the fit is predicted to {number(1e3 * hold, 2)} mm/s² rms."
    else:
        verdict += (
            " There is not enough to leave anything out: the residual says how well the fit fits, not how good it is."
        )
    tiles = [Tile("residual of the fit", number(1e3 * fit, 3) if _finite(fit) else NONE, "mm/s²")]
    tiles.append(Tile("left out and predicted", number(1e3 * hold, 3) if _finite(hold) else NONE, "mm/s²"))
    tiles.append(Tile("condition", number(told["condition"], 3) if _finite(told["condition"]) else "singular"))
    if told.get("gyro_transfer_deg"):
        g = told["gyro_transfer_deg"]
        tiles.append(
            Tile(
                "gravity carried by the gyros",
                number(g["after_rms"], 2),
                "deg rms",
                f"{number(g['before_rms'], 2)} before",
            )
        )
    opening = Opening(told["plan"], f"calibration · {plan.plan.kind}", verdict, "warn" if hidden else "", tiles)
    sections = [_parameters(told)]
    sections.append(_turntable(told, result, pool) if plan.plan.kind == "turntable" else _rests(told, result, pool))
    if told["notes"]:
        sections.append(Section("notes", "What was found on the way", sentences=told["notes"]))
    use = Section(
        "use",
        "Using it",
        "Name the file in a study; the imu table is corrected before anything else is done with it.",
        code='[imu]\ncalibration = "calibration.json"',
    )
    return sheet(opening, [*sections, use], told["made_by"], pool)


def _finite(value: Any) -> bool:
    return value is not None and bool(np.isfinite(value))


def _parameters(told: dict[str, Any]) -> Section:
    rows, tones = [], []
    for p in told["parameters"]:
        ok = p["observable"]
        rows.append(
            [
                p["name"],
                p["unit"],
                number(p["value"], 6) if ok else NONE,
                number(p["std"], 2) if ok else "not observable",
            ]
        )
        tones.append("" if ok else "warn")
    grid = Grid(["parameter", "unit", "value", "1 σ"], rows, left=2, tones=tones)
    return Section(
        "parameters",
        "Parameters",
        "measured = (I + M) true + bias; levers run from the instrument's origin to each accelerometer.",
        grids=[grid],
    )


def _turntable(told: dict[str, Any], result: Any, pool: Pool) -> Section:
    traces = []
    for i, lever in enumerate(result.levers):
        for word, rows, symbol in (("residual", lever.residuals, "circle"), ("left out", lever.holdout, "x")):
            if rows:
                traces.append(
                    {
                        "type": "scatter",
                        "mode": "markers",
                        "name": f"{AXES[i] if i < 3 else i + 1}, {word}",
                        "x": [f"{p} {'+' if r > 0 else '−'}" for p, r, _ in rows],
                        "y": pool.add(np.array([1e3 * v for _, _, v in rows])),
                        "marker": {"color": SERIES[i % len(SERIES)], "symbol": symbol, "size": 7},
                        "hovertemplate": "%{x}: %{y:.3~g} mm/s²",
                    }
                )
    figure = chart(
        "fig-residuals",
        "Spin minus stops minus model",
        traces,
        {"title": "position and sense", "type": "category"},
        {"title": "mm/s²", "zeroline": True},
        caption="Crosses: with that position left out of the fit.",
    )
    rows = [
        [
            c["position"],
            number(c["rate_deg_per_s"], 4),
            number(c["turns"], 3),
            *(f"{m:.6f}" for m in c["mean_mps2"]),
            number(1e6 * max(c["std_mps2"]), 2),
        ]
        for c in told["constants"]
    ]
    heads = [f"mean {AXES[i] if i < 3 else i + 1}, m/s²" for i in range(len(result.levers))]
    constants = Grid(["position", "rate, deg/s", "turns", *heads, "1 σ, µm/s²"], rows)
    budget = [
        [source, *(number(1e3 * v, 2) for axis in shares for v in axis)] for source, shares in told["budget_mm"].items()
    ]
    names = [f"{AXES[i]}{AXES[j]}" for i in range(3) for j in range(3)]
    table = Grid(
        ["error of the table, µm", *names],
        budget,
        caption="xy: lever of accelerometer x along y. From [table], and not in the sigmas above, which the data gave.",
    )
    return Section(
        "fit",
        "The fit",
        "Constants of harmonic fits over whole turns and over the stops, all positions in one least squares.",
        figures=[figure] if traces else [],
        grids=[table] if told["budget_mm"] else [],
        folded=[("Constants of every stop group and spin", constants)],
    )


def _rests(told: dict[str, Any], result: Any, pool: Pool) -> Section:
    a = result.accel
    n = np.arange(1, len(result.rests) + 1)
    traces = []
    for word, values, color, symbol in (
        ("residual", a.residuals, FILTER, "circle"),
        ("left out", a.holdout, SMOOTHED, "x"),
    ):
        traces.append(
            {
                "type": "scatter",
                "mode": "markers",
                "name": word,
                "x": pool.add(n, exact=True),
                "y": pool.add(1e3 * values),
                "marker": {"color": color, "symbol": symbol, "size": 7},
                "hovertemplate": "rest %{x}: %{y:.3~g} mm/s²",
            }
        )
    figures: list[Figure] = [
        chart(
            "fig-rests",
            "|f| − g at the rests",
            traces,
            {"title": "rest"},
            {"title": "mm/s²", "zeroline": True},
            half=True,
            caption=f"Before calibration: {number(told['before_rms_mps2'], 3)} m/s² rms.",
        )
    ]
    if result.gyro is not None and len(result.gyro.residuals):
        k = np.arange(1, len(result.gyro.residuals) + 1)
        bars = []
        for word, values, color in (
            ("before", result.gyro.before, FIX),
            ("after", result.gyro.residuals, FILTER),
            ("left out", result.gyro.holdout, SMOOTHED),
        ):
            bars.append(
                {
                    "type": "scatter",
                    "mode": "lines+markers",
                    "name": word,
                    "x": pool.add(k, exact=True),
                    "y": pool.add(values / DEG),
                    "line": {"color": color, "width": 1},
                    "hovertemplate": "turn %{x}: %{y:.3f} deg",
                }
            )
        figures.append(
            chart("fig-turns", "Gravity carried by the gyros", bars, {"title": "turn"}, {"title": "deg"}, half=True)
        )
    rows = [
        [str(i), f"{r['start_s']:.1f}", f"{r['end_s']:.1f}", *(f"{f:.4f}" for f in r["force_mps2"])]
        for i, r in enumerate(told["rests"], 1)
    ]
    grid = Grid(["rest", "from, s", "to, s", "x, m/s²", "y, m/s²", "z, m/s²"], rows)
    return Section(
        "fit",
        "The fit",
        f"{len(result.rests)} rests, {len(result.turns)} turns between them.",
        figures=figures,
        folded=[("The rests", grid)],
    )


def design_page(d: Any) -> str:
    """A plan's positions, what it gives, what more would give."""
    pool = Pool()
    told = d.told()
    curve = d.curve
    time = [t / 60.0 for _, _, t in curve]
    traces = [
        {
            "type": "scatter",
            "mode": "lines+markers+text",
            "name": "best plans",
            "x": time,
            "y": [1e3 * s for _, s, _ in curve],
            "text": [str(k) for k, _, _ in curve],
            "textposition": "top center",
            "line": {"color": FILTER},
        },
        {
            "type": "scatter",
            "mode": "markers",
            "name": "the thesis's five",
            "x": [d.thesis.time / 60.0],
            "y": [1e3 * d.thesis.score],
            "marker": {"color": SMOOTHED, "size": 9, "symbol": "x"},
        },
    ]
    finite = [t for t in traces if all(np.isfinite(v) for v in t["y"])]
    figure = chart(
        "fig-gain",
        "Sigma of a component against table time",
        finite,
        {"title": "table time, min"},
        {"title": "mm rms", "rangemode": "tozero"},
        half=True,
    )
    u = np.array([[np.cos(g) * np.sin(b), np.cos(b), np.sin(g) * np.sin(b)] for g, b in d.design.settings])
    where = chart(
        "fig-where",
        "Where the spin axis points",
        [
            {
                "type": "scatter",
                "mode": "markers+text",
                "name": "spin axis",
                "x": u[:, 0].tolist(),
                "y": u[:, 2].tolist(),
                "text": [str(k) for k in range(1, len(u) + 1)],
                "textposition": "top center",
                "marker": {
                    "color": u[:, 1].tolist(),
                    "colorscale": "Viridis",
                    "showscale": True,
                    "size": 10,
                    "colorbar": {"title": {"text": "along y"}},
                },
            }
        ],
        {"title": "along x", "range": [-1.15, 1.15]},
        {"title": "along z", "range": [-1.15, 1.15], "scaleanchor": "x"},
        half=True,
    )
    rows = [[str(k), f"{g / DEG:.1f}", f"{b / DEG:.1f}"] for k, (g, b) in enumerate(d.design.settings, 1)]
    std = [
        [f"accelerometer {AXES[i]}", *(number(1e3 * v, 3) if np.isfinite(v) else "not seen" for v in row)]
        for i, row in enumerate(d.design.std)
    ]
    same = d.design.score * np.sqrt(d.design.time / d.thesis.time)
    gives = number(1e3 * d.design.score, 3)
    verdict = f"{len(d.design.settings)} positions, {d.design.time / 60:.0f} min: {gives} mm rms of a component."
    if np.isfinite(same):
        verdict += f" In the thesis's table time {number(1e3 * same, 3)} mm; its five positions give "
        verdict += f"{number(1e3 * d.thesis.score, 3)} mm."
    opening = Opening(told["plan"], "turntable plan", verdict, "" if np.isfinite(d.design.score) else "warn")
    sections = [
        Section(
            "positions",
            "The positions",
            "design.csv holds every stop and spin with its times; the laboratory follows it.",
            figures=[figure, where],
            grids=[
                Grid(["position", "gamma, deg", "beta, deg"], rows),
                Grid(["sigma from noise, mm", "along x", "along y", "along z"], std),
            ],
        )
    ]
    return sheet(opening, sections, told["made_by"], pool)
