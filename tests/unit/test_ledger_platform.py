"""The platform paper's ledger: complete, and its verdicts are the ones that the numbers give."""

import json
import re

import pytest

from schuler.published.ledger import CORRECTED, NOT_REPRODUCIBLE, REPRODUCED, ledger, to_json


@pytest.fixture(scope="module")
def rows():
    return ledger("platform")


def test_every_erratum_is_there(rows):
    found = {int(n) for row in rows for n in re.findall(r"Erratum (\d+)", row.reason)}
    assert found == set(range(1, 25))


def test_the_recomputation_is_met_row_by_row(rows):
    again = [row for row in rows if row.where.startswith("recomputation")]
    assert len(again) == 72 + 30 + 42
    assert [row.quantity for row in again if row.verdict != REPRODUCED] == []


def test_channel_3_bounded_is_not_reproducible_and_says_why(rows):
    bounded = [row for row in rows if row.quantity.endswith("bounded")]
    assert len(bounded) == 4
    for row in bounded:
        assert row.verdict == NOT_REPRODUCIBLE
        assert "heading that the drift does not turn" in row.reason
        assert row.published is None  # the text says "bounded" and no number
        assert row.ours > 4000.0
    models = [float(re.search(r"at most (\d+) m then", row.reason)[1]) for row in bounded]
    assert models == pytest.approx([237, 762, 818, 959], abs=1)


def test_distances_and_crossovers_of_free_azimuth(rows):
    distances = [row for row in rows if row.unit == "km"]
    assert len(distances) == 7
    assert all(row.verdict == REPRODUCED and abs(row.relative_difference) < 0.08 for row in distances)
    assert distances[0].ours == pytest.approx(4.437, abs=0.001)
    times = [row.ours for row in rows if "overtakes" in row.quantity]
    assert times == pytest.approx([2244, 2249, 2261, 2237, 3377, 2042, 2726], abs=0.6)


def test_the_claim_of_the_abstract_is_answered(rows):
    row = next(row for row in rows if row.where == "abstract")
    assert row.verdict == NOT_REPRODUCIBLE
    assert "without gravity feedback" in row.reason


def test_what_is_corrected_has_both_numbers_or_is_a_reading(rows):
    for row in rows:
        if row.verdict == CORRECTED and row.published is None and row.ours is None:
            assert row.quantity == "reading"
    identity = next(row for row in rows if row.where == "eq. (15)")
    assert identity.ours < 1e-20 < 1e-5 < identity.published
    json.loads(to_json(rows))
