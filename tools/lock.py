"""Writes requirements.lock: what is installed now of all that pyproject.toml asks for, pinned.

Run it in an environment where the project is installed with its extra "io" and its group "dev" (`make lock`).
"""

from __future__ import annotations

import re
import tomllib
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

from packaging.requirements import Requirement

ROOT = Path(__file__).resolve().parents[1]
BUILD = ["hatchling", "editables"]  # an editable install is built with these, offline and pinned too


def name_of(text: str) -> str:
    return re.sub(r"[-_.]+", "-", text).lower()


def main() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    wanted = [*project["project"]["dependencies"], *project["dependency-groups"]["dev"], *BUILD]
    for extra in project["project"]["optional-dependencies"].values():
        wanted += extra
    pinned: dict[str, str] = {}
    todo = [Requirement(w) for w in wanted]
    while todo:
        requirement = todo.pop()
        name = name_of(requirement.name)
        if name in pinned:
            continue
        try:
            found = distribution(requirement.name)
        except PackageNotFoundError:
            raise SystemExit(f"{requirement} is not installed here") from None
        if not requirement.specifier.contains(found.version, prereleases=True):
            raise SystemExit(f"{requirement}, but {found.version} is installed")
        pinned[name] = found.version
        for text in found.requires or []:
            more = Requirement(text)
            extras = requirement.extras or {""}
            if more.marker is None or any(more.marker.evaluate({"extra": e}) for e in extras):
                todo.append(more)
    lines = [
        "# Exact versions that `make` installs: run time, extra [io] and tests. Reasons: docs/dependencies.md.",
        "# Renew with `make lock`.",
        *(f"{name}=={version}" for name, version in sorted(pinned.items())),
    ]
    (ROOT / "requirements.lock").write_text("\n".join(lines) + "\n", encoding="utf-8")
    print(f"requirements.lock: {len(pinned)} packages")


if __name__ == "__main__":
    main()
