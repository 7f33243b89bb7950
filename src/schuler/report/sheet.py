"""A page that is not of a study: the opening and sections given, the same templates and figures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from markupsafe import Markup

from schuler.report import page as base
from schuler.report.figures import Pool
from schuler.report.parts import Figure, Opening, Section


@dataclass(frozen=True)
class _Pooled:
    pool: Pool


def sheet(opening: Opening, sections: Sequence[Section], made_by: Mapping[str, Any], pool: Pool) -> str:
    """The text of a self-contained page."""
    shown = [f for s in sections for f in s.figures]
    return str(
        base._environment()
        .get_template("page.html")
        .render(
            opening=opening,
            sections=sections,
            made_by=made_by,
            data=base._data(shown, _Pooled(pool)),  # type: ignore[arg-type]
            plotly=base._plotly() if shown else Markup(""),
        )
    )


def chart(
    id: str, title: str, traces: Sequence[dict[str, Any]], x: Mapping[str, Any], y: Mapping[str, Any], *,
    caption: str = "", height: int = 380, half: bool = False, shapes: Sequence[dict[str, Any]] = (),
) -> Figure:  # fmt: skip
    """A figure with two plain axes. x, y: plotly axis settings, with "title" as text."""

    def axis(given: Mapping[str, Any]) -> dict[str, Any]:
        out = dict(given)
        out["title"] = {"text": given["title"], "standoff": 8}
        out.setdefault("zeroline", False)
        return out

    layout = {
        "height": height,
        "margin": {"l": 84, "r": 14, "t": 34, "b": 50},
        "hovermode": "closest",
        "xaxis": axis(x),
        "yaxis": axis(y),
        "shapes": list(shapes),
    }
    return Figure(id, title, {"data": list(traces), "layout": layout}, height, caption, half=half)
