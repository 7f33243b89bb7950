"""The free-running numerical floor of each scheme against rate: the figure docs/strapdown-floor.svg and its numbers.

    python benchmarks/floor_strapdown.py docs/strapdown-floor.svg

Flight: ten minutes of manoeuvres up to 3 g, roll rate to 60 deg/s, nothing above 0.2 Hz; perfect increments.
"""

from __future__ import annotations

import math
import sys
from pathlib import Path

import numpy as np

D = math.pi / 180.0
RATES = (12.5, 25.0, 50.0, 100.0, 200.0, 400.0)
SCHEMES = ("none", "one", "two", "pair", "three")
COLOURS = {"none": "#8a94a3", "one": "#009e73", "two": "#0072b2", "pair": "#7b5ea7", "three": "#d55e00"}


def floors() -> dict[str, list[float]]:
    """Largest position error, m, of each scheme at each rate."""
    from schuler.inertial.strapdown import Start, Strapdown, Track
    from schuler.truth import trajectories

    flight = trajectories.legs(50.0 * D, 30.0 * D, 3000.0, speed=180.0, heading=40.0 * D, duration=600.0).with_waves(
        ("course", 0.62, 0.04, 0.3), ("climb", 12.0, 0.08, 1.0), ("speed", 8.0, 0.1, 0.0), ("pitch", 0.1, 0.2, 0.5),
        ("roll", 0.55, 0.17, 0.5),
    )  # fmt: skip
    found: dict[str, list[float]] = {s: [] for s in SCHEMES}
    for rate in RATES:
        every = round(2.0 * rate) // 2 * 2
        ideal = flight.ideal(rate, every=every)
        n = len(ideal.truth) * every
        for scheme in SCHEMES:
            ins = Strapdown(Start.of(ideal.start), coning=scheme)  # type: ignore[arg-type]
            step = every // 2 if scheme == "pair" else every
            t = ins.feed(ideal.dtheta[:n], ideal.dv[:n], ideal.dt, every=step)
            track = Track(ideal.truth.time, t.lat, t.lon, t.height, t.v_n, t.q_nb)
            found[scheme].append(float(np.linalg.norm(track.minus(ideal.truth).position, axis=1).max()))
    return found


def drawing(found: dict[str, list[float]]) -> str:
    """A log-log plot as SVG text."""
    width, height, left, right, top, bottom = 640, 400, 70, 90, 20, 50
    x0, x1 = math.log10(RATES[0]), math.log10(RATES[-1])
    values = [v for row in found.values() for v in row]
    y0, y1 = math.floor(math.log10(min(values))), math.ceil(math.log10(max(values)))

    def at(rate: float, value: float) -> tuple[float, float]:
        x = left + (math.log10(rate) - x0) / (x1 - x0) * (width - left - right)
        y = top + (y1 - math.log10(value)) / (y1 - y0) * (height - top - bottom)
        return round(x, 1), round(y, 1)

    out = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" '
        'font-family="sans-serif" font-size="12">',
        f'<rect width="{width}" height="{height}" fill="white"/>',
    ]
    for k in range(y0, y1 + 1):
        _, y = at(RATES[0], 10.0**k)
        out.append(f'<line x1="{left}" x2="{width - right}" y1="{y}" y2="{y}" stroke="#e3e7ec"/>')
        out.append(f'<text x="{left - 8}" y="{y + 4}" text-anchor="end">1e{k}</text>')
    for rate in RATES:
        x, _ = at(rate, 1.0)
        out.append(f'<text x="{x}" y="{height - bottom + 18}" text-anchor="middle">{rate:g}</text>')
    for scheme, row in found.items():
        points = [at(r, v) for r, v in zip(RATES, row, strict=True)]
        line = " ".join(f"{x},{y}" for x, y in points)
        out.append(f'<polyline points="{line}" fill="none" stroke="{COLOURS[scheme]}" stroke-width="2"/>')
        x, y = points[-1]
        out.append(f'<text x="{x + 8}" y="{y + 4}" fill="{COLOURS[scheme]}">{scheme}</text>')
    out.append(f'<text x="{(left + width - right) / 2}" y="{height - 10}" text-anchor="middle">IMU rate, Hz</text>')
    middle = (top + height - bottom) / 2
    out.append(
        f'<text transform="translate(16,{middle}) rotate(-90)" text-anchor="middle">position error, m</text></svg>'
    )
    return "\n".join(out) + "\n"


def main() -> int:
    found = floors()
    print("| scheme | " + " | ".join(f"{r:g} Hz" for r in RATES) + " |")
    for scheme, row in found.items():
        print(f"| {scheme} | " + " | ".join(f"{v:.1e}" for v in row) + " |")
    if len(sys.argv) > 1:
        Path(sys.argv[1]).write_text(drawing(found), encoding="utf-8", newline="\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
