"""One self-contained HTML page of a result: it opens offline and asks nothing of any network."""

from __future__ import annotations

import json
from functools import cache
from typing import Any

from markupsafe import Markup

from schuler.judging.result import Result
from schuler.report.parts import Figure
from schuler.report.sections import chapters, opening_of
from schuler.report.view import View


def page(result: Result) -> str:
    """The text of report.html. The same result gives the same text, byte for byte.

    Everything that came from files or from the study is escaped. Figures whose data are not there are left out.
    """
    view = View(result)
    opening = opening_of(view.kind)(view)
    sections = [s for s in (chapter(view) for chapter in chapters(view.kind)) if s is not None]
    shown = [f for s in sections for f in s.figures]
    return (
        _environment()
        .get_template("page.html")
        .render(
            opening=opening,
            sections=sections,
            made_by=result.made_by,
            data=_data(shown, view),
            plotly=_plotly() if shown else Markup(""),
        )
    )


def _data(shown: list[Figure], view: View) -> Markup:
    """Figures and their arrays as JSON that may stand inside a script element."""
    content: dict[str, Any] = {
        "pool": view.pool.entries,
        "figures": [{"id": f.id, "time": f.follows_time, "title": f.title, **f.spec} for f in shown],
    }
    text = json.dumps(content, separators=(",", ":"), allow_nan=False, ensure_ascii=True)
    return Markup(text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026"))


@cache
def _plotly() -> Markup:
    """plotly.js for inlining, without the addresses of map servers and examples that it carries.

    None of our figures has a map, and the page's own policy forbids every request; with the addresses gone nothing in
    the page even names a server. Namespaces (www.w3.org) are names, not addresses, and stay.
    """
    from plotly.offline import get_plotlyjs

    text = get_plotlyjs()
    for scheme in ("https://", "http://"):
        text = text.replace(scheme, "offline:")
    return Markup(text.replace("offline:www.w3.org/", "http://www.w3.org/").replace("</script", "<\\/script"))


@cache
def _environment() -> Any:
    from jinja2 import Environment, PackageLoader, StrictUndefined

    return Environment(
        loader=PackageLoader("schuler.report", "templates"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
