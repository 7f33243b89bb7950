"""Running a study: finds what runs its kind, and writes what came out. Each kind is one file, `kind_NAME.py`.

A kind registers itself with `@register("NAME")`; nothing else has to change when one is added.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from schuler import __version__
from schuler.ground.errors import StudyError
from schuler.judging.result import Result

if TYPE_CHECKING:
    from schuler.studies.model import Study

Progress = Callable[[str], None]
DEFAULT_SEED = 1


class Runner(Protocol):
    """Runs one kind of study. seed: of what is drawn; None: the default. progress: told each step by name."""

    def __call__(self, study: Study, *, seed: int | None, progress: Progress) -> Result: ...


KINDS: dict[str, Runner] = {}


def register(kind: str) -> Callable[[Runner], Runner]:
    """Decorator: this function runs studies of that kind."""

    def put(runner: Runner) -> Runner:
        KINDS[kind] = runner
        return runner

    return put


def runner_of(kind: str) -> Runner:
    """What runs a kind; StudyError where this version cannot."""
    if kind not in KINDS and find_spec(f"schuler.studies.kind_{kind}") is not None:
        import_module(f"schuler.studies.kind_{kind}")
    if kind not in KINDS:
        raise StudyError(
            f'[study] kind: "{kind}" is not built yet in schuler {__version__}; built: {", ".join(built_kinds())}'
        )
    return KINDS[kind]


def built_kinds() -> list[str]:
    """Names of the kinds that this version can run."""
    folder = Path(__file__).parent
    return sorted({p.stem.removeprefix("kind_") for p in folder.glob("kind_*.py")} | set(KINDS))


def made_by(study: Study, seed: int | None) -> dict[str, Any]:
    """How a result came about. seed: None where nothing was drawn."""
    return {"version": __version__, "seed": seed, "study_sha256": study.sha256}


def silent(step: str) -> None:
    """Progress that nobody watches."""


class StudyResult(Result):
    """A finished study that can write itself."""

    def write(self, out: str | Path | None = None, progress: Progress = silent) -> Path:
        """Writes the result folder (complete or not at all) and returns it; by default NAME-result beside the study."""
        from schuler.io.results import check_target, write_results
        from schuler.report.page import page

        target = check_target(out if out is not None else default_out(self.study))
        progress("drawing the page")
        text = page(self)
        progress(f"writing {target}")
        gnss = self.tables.get("gnss")
        places = []
        for number, surfacing in enumerate(self.summary.get("surfacings") or [], 1):
            if gnss is not None:
                fix = min(int(gnss.time.searchsorted(surfacing["time_s"])), len(gnss) - 1)
                label = f"surfacing {number}: predicted {surfacing['miss_m']:.0f} m away"
                places.append((label, float(gnss["lat"][fix]), float(gnss["lon"][fix])))
        return write_results(
            target, self.navigation, self.summary, page=text, name=self.study.study.name, places=places
        )


def default_out(study: Study) -> Path:
    """NAME-result beside the study file."""
    return study.folder / f"{study.study.name}-result"


def run_study(study: Study, *, seed: int | None = None, progress: Progress | None = None) -> StudyResult:
    """Runs a study of any kind. The same study and seed give the same numbers; nothing is written."""
    result = runner_of(study.study.kind)(study, seed=seed, progress=progress or silent)
    return StudyResult(**vars(result))
