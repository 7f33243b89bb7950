"""Compiled kernels that no longer fit their sources are thrown away.

numba renews a function's cache when the function's own file changes, but not when a function that it calls changes in
another file: the caller keeps the old one inside. So whatever was compiled before the newest source that its module
imports, over any number of steps, is deleted; it is then compiled again when it is next called.
"""

from __future__ import annotations

import hashlib
import os
import re
from pathlib import Path

KERNELS = Path(__file__).resolve().parents[1] / "kernels"


def drop_stale(sources: Path = KERNELS, folder: Path | None = None) -> list[str]:
    """Deletes outdated files of numba's cache in `folder` (None: where numba keeps it) and returns their names.

    sources : folder of the modules that were compiled. Nothing is done where the cache may not be written.
    """
    folder = cache_folder(sources) if folder is None else folder
    if not folder.is_dir():
        return []
    changed = {p.stem: p.stat().st_mtime_ns for p in sources.glob("*.py")}
    imported = {name: _imported(sources / f"{name}.py") & set(changed) for name in changed}
    dropped = []
    for file in sorted([*folder.glob("*.nbi"), *folder.glob("*.nbc")]):
        module = file.name.partition(".")[0]
        try:
            if module in changed and file.stat().st_mtime_ns < max(changed[m] for m in _reached(module, imported)):
                file.unlink()
                dropped.append(file.name)
        except OSError:
            continue  # another process was faster, or the folder is not ours
    return dropped


def cache_folder(sources: Path = KERNELS) -> Path:
    """Where numba caches what is compiled from a folder: beside it, or under NUMBA_CACHE_DIR."""
    chosen = os.environ.get("NUMBA_CACHE_DIR")
    if not chosen:
        return sources / "__pycache__"
    return Path(chosen) / f"{sources.name}_{hashlib.sha1(str(sources).encode()).hexdigest()}"


def _imported(path: Path) -> set[str]:
    """Words on the lines that begin an import: among them the names of the modules beside it that a module imports."""
    lines = re.findall(r"^[ \t]*(?:from|import)[ \t].*", path.read_text(encoding="utf-8"), re.MULTILINE)
    return {word for line in lines for word in re.findall(r"\w+", line)}


def _reached(module: str, imported: dict[str, set[str]]) -> set[str]:
    """The module and all that it imports, over any number of steps."""
    reached: set[str] = set()
    open_ = {module}
    while open_:
        name = open_.pop()
        reached.add(name)
        open_ |= imported[name] - reached
    return reached
