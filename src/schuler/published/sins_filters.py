"""Chapter 5.3 and listings A.2, A.3 of the thesis: the flights, the filters as printed and put right, each fault alone.

The figures are means over many simulated flights, kept in `sins_filters_kept`; benchmarks/oeson.py makes them anew.
"""

from __future__ import annotations

from schuler.published.ledger import CORRECTED, REPRODUCED, Row, Verdict
from schuler.published.sins_filters_kept import KEPT

SOURCE = "sins"
WITHIN = 0.15
SIX = 0.29  # relative standard error of an rms over six runs of one drawn number
FIGURES = ("horizontal position", "horizontal velocity", "tilt", "yaw")
UNITS = ("m", "m/s", "arcmin", "arcmin")
Four = tuple[float, float, float, float]

# case: (straight, with turns): rms of position m, velocity m/s, tilt and yaw arcmin, by an independent recomputation
TABLE: dict[str, tuple[Four, Four]] = {
    "unaided": ((1786.0, 2.582, 0.948, 2.79), (1714.0, 2.454, 0.926, 2.78)),
    "landmarks-1px-6": ((0.066, 0.0007, 0.214, 0.054), (0.019, 0.0007, 0.0068, 0.026)),
    "landmarks-5px-6": ((0.126, 0.0016, 0.365, 0.241), (0.072, 0.0019, 0.0109, 0.090)),
    "landmarks-5px-1": ((0.179, 0.0025, 0.365, 0.512), (0.151, 0.0031, 0.0151, 0.112)),
    "a2-consistent": ((0.643, 0.0097, 0.366, 4.07), (0.739, 0.0140, 0.073, 0.380)),
    "a2-zeroed": ((9.71, 0.351, 0.876, 7.80), (0.783, 0.0163, 0.076, 0.425)),
    "a2-printed": ((1.395, 0.0787, 1.396, 272.5), (1.427, 0.0883, 1.154, 4.98)),
    "a3-unaided": ((11679.0, 33.4, 21.8, 27.0), (11439.0, 32.5, 21.0, 28.9)),
    "a3-consistent": ((0.262, 0.0242, 0.754, 33.0), (0.267, 0.0253, 0.656, 1.49)),
    "a3-printed": ((3.038, 0.1275, 1.259, 33.6), (2.728, 0.1284, 1.963, 5.67)),
    "a3-correlated-15": ((3.053, 0.1332, 1.722, 44.0), (3.062, 0.1351, 1.864, 6.84)),
    "a3-correlated-18": ((2.878, 0.0909, 1.052, 33.7), (2.903, 0.0934, 1.099, 3.61)),
}
TITLES = {
    "unaided": "chapter 5.3, unaided",
    "landmarks-1px-6": "chapter 5.3, 6 landmarks/s, 1 px",
    "landmarks-5px-6": "chapter 5.3, 6 landmarks/s, 5 px",
    "landmarks-5px-1": "chapter 5.3, 1 landmark/s, 5 px",
    "a2-consistent": "listing A.2, consistent tuning",
    "a2-zeroed": "listing A.2, vertical zeroed in x only",
    "a2-printed": "listing A.2 as printed",
    "a3-unaided": "listing A.3's flight, unaided",
    "a3-consistent": "listing A.3, consistent tuning",
    "a3-printed": "listing A.3 as printed",
    "a3-correlated-15": "listing A.3, correlated fixes, 15 states or 18 not wired",
    "a3-correlated-18": "listing A.3, correlated fixes, 18 states wired",
}
BETTER = {name for name in TABLE if name.startswith("landmarks") or "consistent" in name or name.endswith("18")}
# fault: (its key in KEPT, the consistent case it was put on, what is wrong)
FAULTS: dict[str, tuple[str, str, str]] = {
    "vertical zeroed in x only": (
        "a2-zeroed", "a2-consistent",
        "X_est(3) and X_est(6) are set to zero, and P keeps an unstable vertical channel; take both states out",
    ),
    "gyro P0 (0.05)^2": (
        "a2 gyro P0 0.05 rad/s", "a2-consistent", "0.05 deg/h was meant; as printed it is 0.05 rad/s, 10313 deg/h",
    ),
    "sigma_gyr = 1e-6": (
        "a2 sigma_gyr 1e-6", "a2-consistent", "with tau 1e4 s a gyro that wanders by 14.6 deg/h; 0.005 deg/h is meant",
    ),
    "tau_accel = 100 s": (
        "a2 tau_accel 100 s", "a2-consistent",
        "with this q the model holds a bias of 2.1 ug and forgets one of 100 ug; q = 2 sigma^2/tau",
    ),
    "P0 of velocity and tilt, A.2": (
        "a2 P0 2 m/s, 1 mrad", "a2-consistent", "2 m/s and 1 mrad against 0.1 m/s and 0.1 mrad: a slower start only",
    ),
    "no angle random walk in Q": (
        "a3 no angle random walk in Q", "a3-consistent", "the gyros have 0.04 to 0.09 deg/sqrt(h)",
    ),
    "gyro P0 0.05 deg/h": ("a3 gyro P0 0.05 deg/h", "a3-consistent", "the true biases are 1 to 2 deg/h"),
    "accelerometer P0 100 ug": ("a3 accelerometer P0 100 ug", "a3-consistent", "the true biases are 100 to 200 ug"),
    "P0 of velocity and tilt, A.3": (
        "a3 P0 2 m/s, 0.1 mrad", "a3-consistent", "2 m/s and 0.1 mrad, yaw too, against 0.1 m/s, 0.2 and 1 mrad",
    ),
    "states 16 to 18 not wired": (
        "a3-correlated-15", "a3-correlated-18",
        "no dynamics, no noise, no column in H: 18 states do what 15 do, and fixes that err for 60 s are believed",
    ),
}  # fmt: skip


def rows() -> list[Row]:
    """The table of the flights and filters, the faults of the listings one by one."""
    return [*_table(), *_faults()]


def _table() -> list[Row]:
    from schuler.published.sins_optics import AGAIN

    made = []
    for case, both in TABLE.items():
        for path, published in zip(("straight", "turns"), both, strict=True):
            kept = KEPT[f"{case} {path}"]
            where = f"{AGAIN}{TITLES[case]}, {'straight' if path == 'straight' else 'with turns'}"
            dishonest = f"error / sigma {kept.ratio_low:.3g} to {kept.ratio_high:.3g}"
            for what, unit, old, ours in zip(FIGURES, UNITS, published, kept.figures, strict=True):
                verdict, reason = _verdict(case in BETTER, old, ours)
                made.append(
                    Row(SOURCE, where, f"rms {what}", unit, old, ours, verdict,
                        f"{reason}{kept.runs} runs, the figure beside it from 6; {dishonest}")
                )  # fmt: skip
    return made


def _verdict(better: bool, old: float, ours: float) -> tuple[Verdict, str]:
    if abs(ours - old) <= WITHIN * old:
        return REPRODUCED, ""
    if better and ours < old:
        return REPRODUCED, "beaten: "
    if abs(ours - old) <= 2.0 * SIX * old:
        return CORRECTED, "within the sampling error of six runs: "
    return CORRECTED, "beyond the sampling error of six runs: "


def _faults() -> list[Row]:
    made = []
    for name, (key, base, wrong) in FAULTS.items():
        listing = "listing A.2" if key.startswith("a2") else "listing A.3"
        for path in ("straight", "turns"):
            bad, good = KEPT[f"{key} {path}"], KEPT[f"{base} {path}"]
            cost = ", ".join(
                f"{what.split()[-1]} {b:.3g} for {g:.3g} {unit}"
                for what, unit, b, g in zip(FIGURES, UNITS, bad.figures, good.figures, strict=True)
            )
            made.append(
                Row(SOURCE, f"{listing}, one fault at a time", f"position with {name}, {path}", "m", None,
                    bad.figures[0], CORRECTED,
                    f"{wrong}; {cost}; error / sigma up to {bad.ratio_high:.3g} for {good.ratio_high:.3g}")
            )  # fmt: skip
    early = 0.0178 * 2.0 * 0.1 * 3437.75  # the fastest turn, two steps of 0.1 s, arcmin
    made.append(
        Row(SOURCE, "listing A.3, one fault at a time", "yaw at the start of a flight that begins in a turn", "arcmin",
            None, early, CORRECTED,
            "tru_pitch(2) and tru_yaw(3) are the time samples 2 and 3, not angles 2 and 3; nothing in straight flight")
    )  # fmt: skip
    return made


def table_lines(faults: bool = False) -> list[str]:
    """The kept figures as a Markdown table: of the flights and filters, or of the faults beside what they spoil."""
    head = ["case", "path", "position m", "velocity m/s", "tilt arcmin", "yaw arcmin", "error / sigma"]
    names = {name: key for name, (key, _, _) in FAULTS.items()} if faults else {t: c for c, t in TITLES.items()}
    lines = [f"| {' | '.join(head)} |", "|" + "---|" * len(head)]
    for title, case in names.items():
        published = None if faults else TABLE[case]
        for k, path in enumerate(("straight", "turns")):
            kept = KEPT[f"{case} {path}"]
            told = [_short(x) + (f" ({published[k][i]:g})" if published else "") for i, x in enumerate(kept.figures)]
            lines.append(
                f"| {title} | {path} | {' | '.join(told)} | {kept.ratio_low:.2f} to {_short(kept.ratio_high)} |"
            )
    return lines


def _short(x: float) -> str:
    return f"{x:.0f}" if x >= 100.0 else f"{x:.3g}"
