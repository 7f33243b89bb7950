"""The page: self-contained, harmless whatever the names in it, whole whatever is missing."""

from __future__ import annotations

import base64
import json
import re
import warnings
from html.parser import HTMLParser

import numpy as np
import pytest

from fake_result import fake
from schuler.aiding.solution import Navigation
from schuler.report import decimate, figures
from schuler.report.page import page
from schuler.report.parts import metres, number, seconds
from schuler.report.view import View

FETCHING = {"src", "href", "srcset", "data", "action", "poster", "background", "xlink:href", "formaction", "manifest"}
SECTIONS = {
    "track", "surfacings", "position", "attitude", "velocity", "depth", "gyro-bias", "learnt", "innovations",
    "consistency", "figures", "assumed", "made", "cite",
}  # fmt: skip


class Reader(HTMLParser):
    """What a browser would take from the page: elements with their attributes, text, scripts, styles."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.open: list[str] = []
        self.text: list[str] = []
        self.scripts: list[str] = []
        self.styles: list[str] = []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))
        if tag == "script":
            self.scripts.append("")
        if tag not in ("meta", "br", "link", "img"):
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag, f"</{tag}> closes something else"

    def handle_data(self, data: str) -> None:
        inside = self.open[-1] if self.open else ""
        if inside == "script":
            self.scripts[-1] += data
        else:
            (self.styles if inside == "style" else self.text).append(data)

    def ids(self) -> list[str]:
        return [a["id"] for _, a in self.elements if a.get("id")]

    def data(self) -> dict:
        return json.loads(self.scripts[0])


@pytest.fixture(scope="module")
def demo() -> str:
    return page(fake())


def values(entry: dict) -> np.ndarray:
    """An array of the pool as page.js reads it."""
    raw = base64.b64decode(entry["d"])
    if entry["k"] == "f4":
        return np.frombuffer(raw, "<f4").astype(float)
    steps = np.frombuffer(raw, "<i2")
    return np.where(steps == -32768, np.nan, entry["o"] + entry["s"] * steps.astype(float))


def test_nothing_is_fetched_from_outside(demo: str) -> None:
    reader = Reader(demo)
    for tag, attributes in reader.elements:
        assert tag not in ("link", "img", "iframe", "object", "embed", "audio", "video", "source", "base", "form")
        for name in FETCHING & set(attributes):
            assert (attributes[name] or "").startswith("#"), f"<{tag} {name}={attributes[name]!r}>"
        assert "url(" not in (attributes.get("style") or "")
    for style in reader.styles:
        assert "@import" not in style and "url(" not in style
    # plotly.js itself carries addresses of map servers; none may be left, namespaces apart.
    assert set(re.findall(r"https?://[^/\s\"'`)]*", demo)) <= {"http://www.w3.org"}
    policy = [a["content"] for t, a in reader.elements if t == "meta" and a.get("http-equiv")]
    assert policy and "default-src 'none'" in policy[0]


def test_size_and_sections(demo: str) -> None:
    reader = Reader(demo)
    ids = reader.ids()
    assert len(demo.encode()) < 5.6e6
    assert SECTIONS <= set(ids)
    assert len(ids) == len(set(ids))
    links = [a["href"] for t, a in reader.elements if t == "a"]
    assert {f"#{s}" for s in SECTIONS} == set(links)
    drawn = [f["id"] for f in reader.data()["figures"]]
    assert drawn and set(drawn) <= set(ids)


def test_the_verdict_is_in_words() -> None:
    result = fake(seed=11)
    text = " ".join(Reader(page(result)).text)
    assert re.search(r"After 5\d\d\ss under water without GPS the track ends [\d.]+\sm from the truth", text)
    assert "consistent" in text


def test_an_overconfident_filter_is_called_so() -> None:
    result = fake(seed=11)
    result.navigation.filter.cov_pos[:] *= 1e-4
    assert "not consistent, the sigma is too small" in page(result)


@pytest.mark.parametrize(
    "bad", ["<script>alert(1)</script>", '"><img src=x onerror=alert(1)>', "</script><b>", "a & b"]
)
def test_names_from_files_do_no_harm(bad: str) -> None:
    result = fake(name=bad, notes=(bad,))
    result.tables["gnss"].source = bad
    history = result.navigation.states["speed_scale"]
    history.name = history.unit = bad
    result.navigation.states = {bad: history}
    kind = result.navigation.innovations["speed"]
    kind.kind = kind.unit = bad
    kind.components = (bad, bad)[:1]
    result.made_by["version"] = bad
    reader = Reader(page(result))
    assert len([t for t, _ in reader.elements if t == "script"]) == 3
    assert not [t for t, _ in reader.elements if t in ("img", "b")]
    assert bad in "".join(reader.text)  # shown as typed
    for figure in reader.data()["figures"]:  # plotly reads some HTML in labels
        texts = [a["text"] for a in figure["layout"].get("annotations", [])] + [t["name"] for t in figure["data"]]
        assert not [t for t in texts if "<script" in t or "<img" in t or "<b>" in t]


CASES = {
    "nothing known": {"reference": False, "smoother": False, "imu": False, "dives": 1},
    "not a number here and there": {"nan": True, "dives": 2},
    "sixty dives": {
        "dives": 60, "dive_s": 3000.0, "surface_s": 300.0, "rate_hz": 0.1, "gnss_every_s": 50.0, "reference": False,
        "imu": False,
    },
    "no dive": {"dives": 0, "final_s": 200.0},
    "no resurfacing": {"dives": 1, "final_s": 0.0},
    "another kind": {"kind": "aided"},
}  # fmt: skip


@pytest.mark.parametrize("case", CASES.values(), ids=CASES)
def test_whatever_is_missing_the_page_stands(case: dict) -> None:
    text = page(fake(**case))
    content = Reader(text).data()
    assert not re.search(r"\b(nan|inf|None)\b", re.sub(r"<script.*?</script>", "", text, flags=re.S))
    for figure in content["figures"]:
        assert figure["data"]
        for trace in figure["data"]:
            lengths = {len(values(content["pool"][trace[k]["$"]])) for k in ("x", "y") if "$" in trace.get(k, {})}
            assert len(lengths) <= 1
            assert max(lengths, default=0) <= decimate.LIMIT


def test_unknown_throughout_is_left_out() -> None:
    result = fake()
    n = result.navigation
    for track in (n.filter, n.smoother):
        assert track is not None
        for name in ("height", "v_n", "rpy", "cov_pos", "cov_vel", "cov_rpy"):
            getattr(track, name)[:] = np.nan
    n.states["current_north"].std[:] = np.nan
    n.innovations["speed"].value[:] = np.nan
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        ids = Reader(page(result)).ids()
    assert "track" in ids and "velocity" not in ids


def test_tables_alone() -> None:
    """An empty navigation is still a page, with words instead of figures."""
    result = fake(final_s=50.0, dives=0, reference=False)
    f = result.navigation.filter
    empty = type(f)(*(getattr(f, name)[:0] for name in f.__dataclass_fields__))
    result.navigation = Navigation(empty)
    assert "nothing can be said" in page(result)


def test_same_result_same_bytes() -> None:
    assert page(fake()) == page(fake())


def test_errors_inside_the_page_are_those_of_the_result() -> None:
    """From the pool of the page back to the truth: the north error as drawn is estimate minus truth."""
    result = fake(seed=5)
    content = Reader(page(result)).data()
    figure = next(f for f in content["figures"] if f["id"] == "fig-position")
    trace = next(t for t in figure["data"] if t["name"] == "filter" and t["yaxis"] == "y")
    t, north = (values(content["pool"][trace[k]["$"]]) for k in ("x", "y"))
    assert result.reference is not None
    want = View(result).filter.errors
    assert want is not None
    rows = np.searchsorted(want.time, t - 0.05)
    assert np.allclose(north, want.position[rows, 0], atol=0.01)
    assert north.max() == pytest.approx(want.position[:, 0].max(), abs=0.01)


def test_decimation_keeps_every_low_and_high() -> None:
    rng = np.random.default_rng(1)
    a, b = rng.normal(size=100_003), np.cumsum(rng.normal(size=100_003))
    a[77_777], b[50_000:50_010] = 40.0, np.nan
    rows = decimate.keep([a, b], 1200)
    assert len(rows) <= 1200 and rows[0] == 0 and rows[-1] == len(a) - 1
    assert (np.diff(rows) > 0).all()
    for line in (a, b):
        assert np.nanmin(line[rows]) == np.nanmin(line) and np.nanmax(line[rows]) == np.nanmax(line)
    assert np.isnan(b[rows]).any()
    assert np.array_equal(decimate.keep([a[:100]], 1200), np.arange(100))
    assert decimate.keep([], 10).size == 0
    every = decimate.keep([a], 10**9)
    assert len(every) <= decimate.LIMIT


def test_pool_stores_each_array_once_and_finely() -> None:
    pool = figures.Pool()
    x = np.array([1.0, np.nan, -3.0, np.inf, 5e3])
    first, again = pool.add(x), pool.add(x.copy())
    assert first == again and len(pool.entries) == 1
    back = values(pool.entries[0])
    assert np.array_equal(np.isnan(back), [False, True, False, True, False])
    assert np.allclose(back[[0, 2, 4]], x[[0, 2, 4]], atol=5003 / 65000)
    assert np.allclose(values(pool.entries[pool.add([7.0, 7.0])["$"]]), 7.0)
    assert np.isnan(values(pool.entries[pool.add([np.nan])["$"]])).all()


def test_ellipse_holds_its_share() -> None:
    cov = np.array([[9.0, 4.0], [4.0, 5.0]])
    n, e = figures.ellipse(cov)
    square = np.einsum("ik,ij,jk->k", np.vstack([n, e]), np.linalg.inv(cov), np.vstack([n, e]))
    assert np.allclose(square, 5.991464547)
    drawn = np.random.default_rng(2).multivariate_normal([0, 0], cov, 40_000)
    inside = np.einsum("ni,ij,nj->n", drawn, np.linalg.inv(cov), drawn) <= square[0]
    assert inside.mean() == pytest.approx(0.95, abs=0.005)


@pytest.mark.parametrize(
    ("got", "want"),
    [
        (number(0.012345), "0.0123"), (number(None), "–"), (number(float("nan")), "–"), (number(-2.0), "−2.00"),
        (number(1234.5), "1234"), (number(3e-9), "3.00e−09"), (metres(23.4), "23 m"), (metres(1240.0), "1.24 km"),
        (metres(87_654.0), "87.7 km"), (seconds(520.0), "520 s"), (seconds(2880.0), "48 min"),
        (seconds(5760.0), "96 min"), (seconds(90_000.0), "25 h"), (seconds(285_120.0), "3.3 days"),
    ],
)  # fmt: skip
def test_figures_in_words(got: str, want: str) -> None:
    assert got == want
