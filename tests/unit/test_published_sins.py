"""The thesis's ledger: complete, and every recomputed figure is ours too."""

import pytest

from schuler.published import sins, sins_errata
from schuler.published.ledger import CORRECTED, REPRODUCED, SOURCES, Row


@pytest.fixture(scope="module")
def rows() -> list[Row]:
    return sins.rows()


def test_the_source_is_known() -> None:
    assert SOURCES["sins"] == "schuler.published.sins"


@pytest.mark.slow
def test_recomputed_figures_agree(rows: list[Row]) -> None:
    """A figure that an independent recomputation gives must come out of ours within its last digit."""
    wrong = [r for r in rows if r.where.startswith("recomputation") and r.verdict != REPRODUCED]
    assert not wrong, [(r.where, r.quantity, r.published, r.ours) for r in wrong]


@pytest.mark.slow
def test_every_correction_has_a_reason_and_differs(rows: list[Row]) -> None:
    for r in rows:
        assert r.reason
        assert r.source == "sins"
        if r.verdict == CORRECTED and r.published is not None and r.ours is not None:
            assert r.published != pytest.approx(r.ours, rel=1e-4)


@pytest.mark.slow
def test_nothing_of_the_chapters_is_missing(rows: list[Row]) -> None:
    text = " ".join(r.where for r in rows)
    for place in (
        "(2.1)",
        "(2.4)",
        "(2.6)",
        "(2.7)",
        "(2.9)",
        "(2.10)",
        "(2.11)",
        "(2.12)",
        "(2.19)",
        "(2.27)",
        "(2.28)",
        "(2.41)",
        "(2.43)",
        "(2.45)",
        "(2.46)",
        "(2.47)",
        "(2.49)",
        "(2.50)",
        "(2.51)",
        "F(2,9)",
        "F(3,7)",
        "F(3,9)",
        "F(5,9)",
        "F(6,9)",
        "figure 2.18",
        "listing A.1",
        "table 2.2",
        "table 4.2",
    ):
        assert place in text, place
    assert len(rows) > 200


def test_published_arithmetic_of_table_4_2() -> None:
    by = {r.quantity: r for r in sins_errata.rows()}
    assert by["mean of rho11"].verdict == REPRODUCED
