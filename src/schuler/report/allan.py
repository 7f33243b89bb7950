"""Page of an Allan analysis: deviations with their intervals, the fitted terms and their slopes."""

from __future__ import annotations

from typing import Any

import numpy as np

from schuler.report.figures import BOUND, SERIES, Pool, shade
from schuler.report.parts import Figure, Grid, Opening, Section, Tile, number, seconds
from schuler.report.sheet import chart, sheet

DEG_PER_H = np.pi / 180.0 / 3600.0
UG = 9.80665e-6


def _figure(result: Any, kind: str, pool: Pool) -> Figure | None:
    from schuler.calibration.allan_fit import TERMS, columns, gauss_markov_column

    factor, unit = (DEG_PER_H, "deg/h") if kind == "gyro" else (UG, "µg")
    traces: list[dict[str, Any]] = []
    for i, (sensor, (dev, fit)) in enumerate((s, v) for s, v in result.sensors.items() if s.startswith(kind)):
        color = SERIES[i]
        x = pool.add(dev.tau, exact=True)
        traces.append(
            {
                "type": "scatter",
                "mode": "lines+markers",
                "name": sensor,
                "x": x,
                "y": pool.add(dev.dev / factor, exact=True),
                "line": {"color": color},
                "marker": {"size": 4},
                "hovertemplate": "%{x:.3~g} s: %{y:.4~g} " + unit,
            }
        )
        for edge in (dev.low, dev.high):
            traces.append(
                {
                    "type": "scatter",
                    "mode": "lines",
                    "name": f"{sensor}, 68 %",
                    "x": x,
                    "y": pool.add(edge / factor, exact=True),
                    "line": {"color": shade(color, 0.35), "width": 0.8},
                    "showlegend": False,
                    "hoverinfo": "skip",
                    "legendgroup": f"{sensor} 68",
                }
            )
        H = columns(dev.tau)
        total = sum(fit.terms[t].value ** 2 * H[:, TERMS.index(t)] for t in fit.terms)
        if fit.correlated is not None:
            total = total + fit.correlated.value**2 * gauss_markov_column(dev.tau, fit.correlated_tau.value)
        if np.ndim(total) and dev.kind == "oadev":
            traces.append(
                {
                    "type": "scatter",
                    "mode": "lines",
                    "name": f"{sensor}, fit",
                    "x": x,
                    "y": pool.add(np.sqrt(total) / factor, exact=True),
                    "line": {"color": color, "dash": "dash", "width": 1},
                    "hoverinfo": "skip",
                }
            )
    if not traces:
        return None
    first = next(v for s, v in result.sensors.items() if s.startswith(kind))
    tau = first[0].tau
    for term, word in (("random_walk", "slope −½"), ("rate_walk", "slope +½")):
        found = [f.terms[term].value for s, (_, f) in result.sensors.items() if s.startswith(kind) and term in f.terms]
        if found:
            level = float(np.median(found)) / factor
            y = level / np.sqrt(tau) if term == "random_walk" else level * np.sqrt(tau / 3.0)
            traces.append(
                {
                    "type": "scatter",
                    "mode": "lines",
                    "name": word,
                    "x": pool.add(tau, exact=True),
                    "y": pool.add(y, exact=True),
                    "line": {"color": BOUND, "width": 1, "dash": "dot"},
                    "hoverinfo": "skip",
                }
            )
    word = {"oadev": "overlapping Allan", "mdev": "modified Allan", "hdev": "Hadamard"}[result.told["kind"]]
    all_dev = np.concatenate([v[0].dev for s, v in result.sensors.items() if s.startswith(kind)]) / factor
    positive = all_dev[all_dev > 0]
    span = (
        [float(np.log10(positive.min() / 3.0)), float(np.log10(positive.max() * 2.0))] if positive.size else [0.0, 1.0]
    )
    return chart(
        f"fig-{kind}",
        f"{'Gyros' if kind == 'gyro' else 'Accelerometers'}: {word} deviation",
        traces,
        {"title": "averaging time, s", "type": "log", "dtick": 1},
        {"title": unit, "type": "log", "range": span, "dtick": 1},
        height=460,
        caption="Thin lines: 68 %. Dashed: the fit to the overlapping Allan deviation. Dotted: random walks.",
    )


def allan_page(result: Any) -> str:
    """The text of report.html."""
    pool = Pool()
    sections = []
    tiles = []
    for kind, word, walk, walk_unit, bias, unit in (
        ("gyro", "Gyros", "arw_deg_per_sqrt_h", "deg/√h", "bias_instability_deg_per_h", "deg/h"),
        ("accel", "Accelerometers", "vrw_mps_per_sqrt_h", "m/s/√h", "bias_instability_ug", "µg"),
    ):
        told = {s: v for s, v in result.told["sensors"].items() if s.startswith(kind)}
        if not told:
            continue
        figure = _figure(result, kind, pool)
        keys = [
            k
            for k in next(iter(told.values()))["fit"]
            if not k.endswith(("_low", "_high")) and k not in ("quantisation", "ramp", "correlated")
        ]
        rows = []
        for key in keys:
            cells = []
            for v in told.values():
                f = v["fit"]
                cells.append(
                    "not seen"
                    if f[key] is None
                    else f"{number(f[key], 3)} ({number(f[key + '_low'], 3)} to {number(f[key + '_high'], 3)})"
                )
            rows.append([key, *cells])
        for label, name in (("correlated, sigma", "sigma"), ("correlated, time constant, s", "tau_s")):
            rows.append(
                [
                    label,
                    *(
                        "not seen" if v["fit"]["correlated"] is None else number(v["fit"]["correlated"][name], 3)
                        for v in told.values()
                    ),
                ]
            )
        grid = Grid(
            ["term (68 %)", *told],
            rows,
            caption="Bias instability: floor of the deviation over 0.664; flicker: the coefficient B of the fit.",
        )
        sections.append(Section(kind, word, figures=[figure] if figure else [], grids=[grid]))
        values = [v["fit"][walk] for v in told.values() if v["fit"][walk] is not None]
        if values:
            tiles.append(
                Tile(f"{word}: random walk", number(float(np.median(values)), 3), walk_unit, "median of the axes")
            )
        values = [v["fit"][bias] for v in told.values() if v["fit"][bias] is not None]
        if values:
            tiles.append(
                Tile(f"{word}: bias instability", number(float(np.median(values)), 2), unit, "floor over 0.664")
            )
    if result.notes:
        sections.append(Section("notes", "What was found on the way", sentences=result.notes))
    sections.append(Section("use", "In a study", "imu.toml, for a filter or a simulation.", code=result.imu))
    verdict = f"{seconds(result.seconds)} at {number(result.rate_hz, 4)} Hz."
    if result.seconds < 3600.0:
        verdict += " Less than an hour: bias instability and rate random walk want more."
    opening = Opening(result.name, "Allan deviation", verdict, "", tuple(tiles))
    return sheet(opening, sections, result.told["made_by"], pool)
