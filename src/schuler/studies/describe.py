"""The tables of docs/study-file.md, made from the model.

python -m schuler.studies.describe docs/study-file.md     renews them between their markers
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any, Literal, get_args, get_origin

from schuler.studies.faults import _model_in, typed
from schuler.studies.model import Study
from schuler.studies.sections import Section, unit_of

BEGIN, END = "<!-- keys of {} -->", "<!-- end of {} -->"


def sections() -> dict[str, type[Section]]:
    """Every section by its name in the file, in order, those inside others too."""
    found: dict[str, type[Section]] = {}

    def walk(prefix: str, model: type[Section]) -> None:
        for name, field in model.model_fields.items():
            inner = _model_in(field.annotation)
            if inner is not None and inner not in found.values():  # one that is described already: the same keys
                found[prefix + name] = inner
                walk(prefix + name + ".", inner)

    walk("", Study)
    return found


def _words(annotation: Any) -> list[str]:
    """The words that a key may hold, found anywhere in its type."""
    if get_origin(annotation) is Literal:
        return [str(a) for a in get_args(annotation)]
    return [w for arg in get_args(annotation) if arg is not ... for w in _words(arg)]


def _limits(field: Any) -> str:
    bounds = {}
    for m in field.metadata:
        for name in ("gt", "ge", "lt", "le"):
            if getattr(m, name, None) is not None:
                bounds[name] = getattr(m, name)
    signs = (("gt", "more than"), ("ge", "at least"), ("lt", "less than"), ("le", "at most"))
    return ", ".join(f"{word} {bounds[name]:g}" for name, word in signs if name in bounds)


def _default(field: Any) -> str:
    if field.is_required():
        return "needed"
    return "-" if field.default is None else f"`{typed(field.default)}`"


def table(model: type[Section]) -> str:
    """The keys of one section as a Markdown table: key, unit, default, meaning with its words and limits."""
    lines = ["| key | unit | default | meaning |", "|---|---|---|---|"]
    for name, field in model.model_fields.items():
        if _model_in(field.annotation) is not None:
            continue
        meaning = field.description or ""
        words = _words(field.annotation)
        if words:
            meaning += ": " + ", ".join(f'`"{w}"`' for w in words)
        limits = _limits(field)
        if limits:
            meaning += f" ({limits})"
        lines.append(f"| `{name}` | {unit_of(field)} | {_default(field)} | {meaning} |")
    return "\n".join(lines)


def renewed(text: str) -> str:
    """The page with every table made anew; the prose around them is kept."""
    for name, model in sections().items():
        begin, end = BEGIN.format(name), END.format(name)
        start = text.find(begin)
        stop = text.find(end, start)
        if start < 0 or stop < 0:
            raise ValueError(f"the page has no place for [{name}]: {begin} ... {end}")
        text = text[:start] + f"{begin}\n{table(model)}\n" + text[stop:]
    return text


if __name__ == "__main__":
    page = Path(sys.argv[1])
    page.write_text(renewed(page.read_text(encoding="utf-8")), encoding="utf-8")
