"""Speed of the main tasks on this machine: medians, and their ratio to a reference loop timed in the same run.

A machine that is busy or slow changes all rates alike; the ratio to the loop (a chain of multiply-adds on one core)
changes less, so it is what two machines or two days should be compared by. A part adds its tasks to `TASKS`.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

Work = Callable[[], object]
LOOP_STEPS = 20_000_000


@dataclass(frozen=True)
class Task:
    """prepare() makes the work that is timed, once; count: how many `unit`s one call of it does."""

    name: str
    unit: str
    count: float
    prepare: Callable[[], Work]
    repeats: int = 7


@dataclass(frozen=True)
class Timing:
    """rate: median, units a second (or what `unit` says); spread: (75 % - 25 %) / median of the repeats;
    ratio: rate over that of the reference loop in steps a second, None for what is no rate."""

    task: str
    unit: str
    rate: float
    repeats: int
    spread: float
    ratio: float | None


TASKS: list[Task] = []


def task(name: str, unit: str, count: float, repeats: int = 7) -> Callable[[Callable[[], Work]], Callable[[], Work]]:
    """Decorator: the function prepares the work of a task of this name."""

    def put(prepare: Callable[[], Work]) -> Callable[[], Work]:
        TASKS.append(Task(name, unit, count, prepare, repeats))
        return prepare

    return put


@cache
def _loop() -> Callable[[int], float]:
    from numba import njit

    def chain(n: int) -> float:
        x = 0.5
        for _ in range(n):
            x = x * 0.999999 + 1e-7
        return x

    return njit(chain)


def loop_rate(repeats: int = 3) -> float:
    """Steps a second of the reference loop, best of some."""
    loop = _loop()
    loop(10)
    return LOOP_STEPS / min(_seconds(lambda: loop(LOOP_STEPS)) for _ in range(repeats))


def _seconds(work: Work) -> float:
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def run_tasks(progress: Callable[[str], None], only: str = "") -> list[Timing]:
    """Times every task whose name holds `only`, one after the other, warm."""
    rows = []
    for t in TASKS:
        if only not in t.name:
            continue
        progress(t.name)
        work = t.prepare()
        work()  # compiled and cached
        before = loop_rate()
        rates = t.count / np.array([_seconds(work) for _ in range(t.repeats)])
        reference = 0.5 * (before + loop_rate())
        median = float(np.median(rates))
        spread = float(np.subtract(*np.percentile(rates, [75, 25])) / median)
        rows.append(Timing(t.name, t.unit, median, t.repeats, spread, median / reference))
    if only in IMPORT:
        progress(IMPORT)
        rows.append(_import_cost())
    return rows


IMPORT = "import schuler"


def _import_cost(repeats: int = 7) -> Timing:
    def cost(code: str) -> float:
        return _seconds(lambda: subprocess.run([sys.executable, "-c", code], check=True))

    cost("import schuler, numpy")
    ratios = np.array([cost("import schuler") / cost("import numpy") for _ in range(repeats)])
    spread = float(np.subtract(*np.percentile(ratios, [75, 25])) / np.median(ratios))
    return Timing(IMPORT, "times import numpy", float(np.median(ratios)), repeats, spread, None)


def to_json(rows: list[Timing]) -> str:
    """A list of {"task", "unit", "rate", "repeats", "spread", "ratio"}."""
    return json.dumps([vars(r) for r in rows], indent=2) + "\n"


def table_lines(rows: list[Timing]) -> list[str]:
    """For a terminal."""
    width = max((len(r.task) for r in rows), default=0)
    lines = [f"{'task':{width}}  {'rate':>12}  {'unit':20} {'spread':>7}  steps of the reference loop each"]
    for r in rows:
        each = "" if not r.ratio else f"{1.0 / r.ratio:.3g}"
        lines.append(f"{r.task:{width}}  {_figure(r.rate):>12}  {r.unit:20} {100 * r.spread:6.1f}%  {each}")
    return lines


def _figure(rate: float) -> str:
    return f"{rate:,.0f}".replace(",", " ") if rate >= 1000 else f"{rate:.3g}"


# ---- the tasks, named as users would ----


@cache
def _recording() -> Any:
    from dataclasses import replace

    from schuler.truth.missions import PRESETS
    from schuler.truth.recording import simulate
    from schuler.truth.sensors import SUITES

    return simulate(replace(PRESETS["paper-test-1"], current_std=0.25), SUITES["demo"], seed=1)


@cache
def _navigation() -> Any:
    from schuler.aiding.auv import AuvSettings, navigate

    return navigate(_recording().tables, AuvSettings())


EPOCHS = 62_000  # 620 s at 100 Hz


@task("AUV mission simulated, 620 s at 100 Hz", "IMU epochs/s", EPOCHS)
def _simulate() -> Work:
    from schuler.truth.missions import PRESETS
    from schuler.truth.recording import simulate
    from schuler.truth.sensors import SUITES

    return lambda: simulate(PRESETS["paper-test-1"], SUITES["demo"], seed=1)


@task("vehicle simulated with all its sensors, 1800 s at 100 Hz", "IMU epochs/s", 180_000)
def _simulate_vehicle() -> Work:
    from schuler.studies.model import parse_study
    from schuler.studies.simulated import simulation

    sensors = {"speed_hz": 10.0, "dvl_hz": 5.0, "depth_hz": 1.0, "height_hz": 1.0, "ranges_hz": 1.0}
    study = parse_study(
        {
            "study": {"name": "bench", "kind": "aided"},
            "start": {"lat_deg": 50.0},
            "trajectory": {"preset": "flight", "duration_s": 1800.0},
            "imu": {"preset": "tactical"},
            "simulate": {**sensors, "magnetometer": True, "mounting_deg": 1.0, "gnss_delay_s": 0.1},
        }
    )
    made = simulation(study)
    return lambda: made.record(seed=1)


@task("AUV filter, 620 s at 100 Hz", "IMU epochs/s", EPOCHS)
def _filter() -> Work:
    from schuler.aiding.auv import AuvSettings, navigate

    tables, settings = _recording().tables, AuvSettings(smoother=False)
    return lambda: navigate(tables, settings)


@task("AUV filter and smoother, 620 s at 100 Hz", "IMU epochs/s", EPOCHS)
def _smoother() -> Work:
    from schuler.aiding.auv import AuvSettings, navigate

    tables = _recording().tables
    return lambda: navigate(tables, AuvSettings())


ATTITUDES = 57_000  # 200 s at 285 Hz


@cache
def _swung() -> tuple[Any, Any, Any, Any]:
    """time, rate, specific force and field of a body that is swung about all axes."""
    t = np.arange(1, ATTITUDES + 1) / 285.0
    rate = np.column_stack([np.sin(1.1 * t), 0.8 * np.sin(1.7 * t + 1.0), 0.6 * np.cos(0.9 * t)])
    roll, pitch = 0.9 * (1.0 - np.cos(1.1 * t)), 0.5 * np.cos(1.0 + 1.7 * t)
    up = np.column_stack([np.sin(pitch), -np.sin(roll) * np.cos(pitch), -np.cos(roll) * np.cos(pitch)])
    return t, rate, 9.81 * up, np.column_stack([20e-6 + 0.0 * t, 1e-6 * np.sin(t), 40e-6 + 0.0 * t])


@task("attitude filter, 6 axes", "updates/s", ATTITUDES)
def _attitude_6() -> Work:
    from schuler.aiding.ahrs import attitude

    return lambda: attitude(*_swung()[:3])


@task("attitude filter, 9 axes", "updates/s", ATTITUDES)
def _attitude_9() -> Work:
    from schuler.aiding.ahrs import attitude

    return lambda: attitude(*_swung())


@task("the paper's filter, 620 s at 100 Hz", "IMU epochs/s", EPOCHS)
def _paper() -> Work:
    from schuler.aiding.paper import PaperSettings, navigate_paper

    tables = _recording().tables
    return lambda: navigate_paper(tables, PaperSettings(rate=10.0))


ONLINE = 5000


@task("aided filter online, one predict from Python", "calls/s", ONLINE)
def _aided_online() -> Work:
    import numpy as np

    from schuler.aiding.aided_aids import aids_of
    from schuler.aiding.aided_online import AidedFilter
    from schuler.aiding.aided_rows import imu_rows
    from schuler.aiding.aided_settings import AidedSettings
    from schuler.truth import manoeuvres
    from schuler.truth.aided import AidedSuite, simulate
    from schuler.truth.catalogue import GRADES

    path = manoeuvres.car(0.9, 0.5, stand=0.0, duration=80.0)
    made = simulate(path, GRADES["mems-car"], AidedSuite(imu_kind="rates"), seed=1)
    nav = AidedFilter(AidedSettings(constraints=("nhc",)), sensors=("gnss",))
    rows, aids = imu_rows(made.tables["imu"]), aids_of(made.tables, nav.settings)
    i = 0
    while not nav.started:
        nav.predict(rows[i])
        while aids and aids[0].time <= rows[i, 0]:
            nav.update(aids.pop(0))
        i += 1
    dt = float(np.median(np.diff(rows[:, 0])))
    todo = iter(np.tile(rows[i : i + ONLINE], (40, 1)))
    time = nav.time

    def feed() -> None:
        nonlocal time
        for _ in range(ONLINE):
            row = next(todo)
            time += dt
            row[0] = time
            nav.predict(row)

    return feed


@task("AUV filter online, one predict from Python", "calls/s", ONLINE)
def _online() -> Work:
    from schuler.aiding.auv import AuvFilter, AuvSettings, input_rows, make_filter, measurements_of

    tables, settings = _recording().tables, AuvSettings(smoother=False)
    rows, compass, _ = input_rows(tables, settings)
    nav: AuvFilter = make_filter(tables, settings, rows, compass)
    pending = measurements_of(tables, settings)
    i = 0
    while not nav.started:
        while pending and pending[0].time <= rows[i, 0]:
            nav.update(pending.pop(0))
        nav.predict(rows[i])
        i += 1
    at = [i]

    def work() -> None:
        start = at[0] if at[0] + ONLINE < len(rows) else i
        for k in range(start, start + ONLINE):
            nav.predict(rows[k])
        at[0] = start + ONLINE

    return work


@task("IMU table read, 62 000 rows of CSV", "rows/s", EPOCHS, repeats=5)
def _read() -> Work:
    from schuler.io.tables import read_table, write_table

    folder = tempfile.TemporaryDirectory()
    path = Path(folder.name) / "imu.csv"
    write_table(path, _recording().tables["imu"])

    def work() -> object:
        assert folder  # kept until the work is forgotten
        return read_table(path, "imu")

    return work


@task("track written, 62 000 rows of CSV", "rows/s", EPOCHS, repeats=5)
def _write() -> Work:
    from dataclasses import fields

    from schuler.aiding.solution import Solution
    from schuler.io.results import write_track

    short = _navigation().filter
    rows = np.resize(np.arange(len(short)), EPOCHS)
    track = Solution(*(getattr(short, f.name)[rows] for f in fields(short)))
    folder = tempfile.TemporaryDirectory()
    return lambda: write_track(Path(folder.name) / "track.csv", track)


@task("run judged against its truth", "runs/s", 1, repeats=5)
def _judge() -> Work:
    from schuler.judging.consistency import consistency
    from schuler.judging.errors import error_series, summary

    navigation, truth = _navigation(), _recording().truth

    def work() -> object:
        series = error_series(navigation.filter, truth)
        return summary(series), consistency(series, navigation.innovations)

    return work


@task("demo, from study to page", "runs/s", 1, repeats=3)
def _demo() -> Work:
    from importlib.resources import as_file, files

    from schuler.report.page import page
    from schuler.studies.model import load_study
    from schuler.studies.run import run_study

    with as_file(files("schuler.studies") / "demo.toml") as path:
        study = load_study(path)
    return lambda: page(run_study(study))


@task("platform study, five algorithms, each drift alone and together, 2 h, with page", "runs/s", 1, repeats=5)
def _platform() -> Work:
    from schuler.report.page import page
    from schuler.studies.model import parse_study
    from schuler.studies.run import run_study

    flight = {"motion": "constant-rates", "lat_change_deg": -65.0, "lon_change_deg": 55.0}
    study = parse_study({"study": {"name": "bench", "kind": "platform"}, "platform": flight})
    return lambda: page(run_study(study))


@task("platform map, cases of 2 h", "cases/s", 60 * 72, repeats=3)
def _platform_map() -> Work:
    from schuler.inertial.platform import PlatformCase, error_map

    case = PlatformCase(lat=0.0, drift=(4.8e-8, 0.0, 4.8e-7))
    lat, heading = np.linspace(-1.48, 1.48, 60), np.linspace(0.0, 6.2, 72)
    return lambda: error_map(case, lat, heading, "position-independent")


from schuler.studies import bench_aided, bench_optics  # noqa: E402, F401  (their tasks register themselves)
