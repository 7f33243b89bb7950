"""The commands and their options, built when the program starts (`build`)."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from collections.abc import Callable

OutDir = Annotated[
    Path | None, typer.Option("--out", metavar="DIR", help="Result folder; an older one is replaced whole.")
]
JsonFile = Annotated[Path | None, typer.Option("--json", metavar="FILE", help="Also write the figures as JSON.")]
Seed = Annotated[int | None, typer.Option("--seed", metavar="N", min=0, help="Of all that is drawn in a simulation.")]


def build() -> Callable[..., int | None]:
    """The program, ready to be called with arguments."""
    app = typer.Typer(
        help="Design, run and judge inertial navigation.",
        add_completion=False,
        no_args_is_help=True,
        pretty_exceptions_enable=False,
        rich_markup_mode=None,
        context_settings={"help_option_names": ["-h", "--help"]},
    )
    app.callback()(_program)
    for command in (demo, run, check, compare, convert, align, calibrate, allan, published, bench, warmup):
        app.command()(command)
    return app


def _program(
    version: Annotated[bool, typer.Option("--version", help="Say the version and stop.")] = False,
    debug: Annotated[bool, typer.Option("--debug", help="Show the traceback of an error.")] = False,
) -> None:
    """Design, run and judge inertial navigation. Start with: schuler demo"""


def demo(out: OutDir = None, seed: Seed = None) -> None:
    """An AUV with low-cost sensors dives without GPS: simulated, navigated, judged. Needs no file and no network."""
    from schuler.cli.navigate import demo

    demo(out, seed)


def run(
    study: Annotated[Path, typer.Argument(metavar="STUDY.toml", help="Your study file.", show_default=False)],
    out: OutDir = None,
    seed: Seed = None,
) -> None:
    """Run a study file: a recording, or a simulated mission."""
    from schuler.cli.navigate import run

    run(study, out, seed)


def check(
    files: Annotated[list[Path], typer.Argument(metavar="FILE...", help="Recordings.", show_default=False)],
    json: JsonFile = None,
) -> None:
    """Look at a recording without any configuration: rate, gaps, units, gravity; and what to type next."""
    from schuler.cli.files import check

    check(files, json)


def compare(
    folders: Annotated[list[Path], typer.Argument(metavar="DIR...", help="Result folders.", show_default=False)],
    out: Annotated[
        Path | None,
        typer.Option("--out", metavar="FILE|DIR", help="The page; by default compare.html beside the first folder."),
    ] = None,
) -> None:
    """Result folders side by side: figures here, tracks, differences and sigmas on one page."""
    from schuler.cli.compare import compare

    compare(folders, out)


def convert(
    source: Annotated[Path, typer.Argument(metavar="IN", help="A file or folder of a recording.", show_default=False)],
    target: Annotated[Path, typer.Argument(metavar="OUT", help="A table, or a folder of them.", show_default=False)],
    gyro_unit: Annotated[str | None, typer.Option(metavar="U", help="Unit of the gyros, e.g. deg/s.")] = None,
    accel_unit: Annotated[str | None, typer.Option(metavar="U", help="Unit of the accelerometers, e.g. g.")] = None,
) -> None:
    """Any readable format to tables with the unit in the header."""
    from schuler.cli.files import convert

    convert(source, target, gyro_unit, accel_unit)


def align(
    study: Annotated[Path, typer.Argument(metavar="STUDY.toml", help="Your study file.", show_default=False)],
    out: OutDir = None,
    seed: Seed = None,
) -> None:
    """Initial attitude from a still or swaying recording, with its sigma and how long it should take."""
    from schuler.cli.align import align

    align(study, out, seed)


def calibrate(
    plan: Annotated[Path, typer.Argument(metavar="PLAN.toml", help="Your plan file.", show_default=False)],
    out: OutDir = None,
    design: Annotated[
        int | None, typer.Option("--design", metavar="K", help="Instead: the best K positions for the plan's table.")
    ] = None,
) -> None:
    """Lever arms, biases, scales and misalignments from turntable or multi-position recordings."""
    from schuler.cli.calibrate import calibrate

    calibrate(plan, out, design)


def allan(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A recording at rest.", show_default=False)],
    tau: Annotated[str | None, typer.Option("--tau", metavar="S,S,...", help="Averaging times, s.")] = None,
    out: OutDir = None,
    kind: Annotated[str, typer.Option("--kind", metavar="KIND", help="oadev, mdev or hdev.")] = "oadev",
    rate_hz: Annotated[
        float | None, typer.Option("--rate-hz", metavar="HZ", help="Of a recording without a time column.")
    ] = None,
) -> None:
    """Allan deviation with confidence, fitted noise, and an [imu] section of it."""
    from schuler.cli.calibrate import allan

    allan(file, tau, out, kind, rate_hz)


def published(
    source: Annotated[str | None, typer.Argument(metavar="SOURCE", help="One source; absent: all.")] = None,
    json: JsonFile = None,
) -> None:
    """Every published figure, ours beside it, the verdict and its reason."""
    from schuler.cli.others import published

    published(source, json)


def bench(json: JsonFile = None) -> None:
    """How fast each main task is on this machine."""
    from schuler.cli.others import bench

    bench(json)


def warmup() -> None:
    """Compile the kernels once, so that later commands start at once."""
    from schuler.cli.others import warmup

    warmup()
