"""The bench: medians of what was asked for, in the contract's JSON."""

import json
import time

import pytest

from schuler.studies import bench


@pytest.fixture
def two_tasks(monkeypatch):
    def sleeper(seconds):
        return bench.Task(f"sleep {seconds}", "naps/s", 1.0, lambda: lambda: time.sleep(seconds), repeats=3)

    monkeypatch.setattr(bench, "TASKS", [sleeper(0.02), sleeper(0.04)])
    monkeypatch.setattr(bench, "loop_rate", lambda repeats=3: 1e8)


def test_rates_are_medians_and_ratios_to_the_loop(two_tasks):
    rows = bench.run_tasks(lambda step: None, only="sleep")
    assert [r.task for r in rows] == ["sleep 0.02", "sleep 0.04"]
    assert rows[0].rate == pytest.approx(50, rel=0.3) and rows[1].rate == pytest.approx(25, rel=0.3)
    assert rows[0].ratio == pytest.approx(rows[0].rate / 1e8)


def test_json_is_the_contract_s(two_tasks):
    told = json.loads(bench.to_json(bench.run_tasks(lambda step: None, only="sleep 0.02")))
    assert {"task", "unit", "rate", "repeats", "spread"} <= set(told[0])
    assert told[0]["repeats"] == 3 and 0 <= told[0]["spread"] < 1


def test_tasks_are_named_once_and_as_users_would():
    names = [t.name for t in bench.TASKS]
    assert len(set(names)) == len(names) >= 6
    assert not any("_" in n for n in names)


def test_a_table_has_a_line_a_task(two_tasks):
    lines = bench.table_lines(bench.run_tasks(lambda step: None, only="sleep"))
    assert len(lines) == 3 and "naps/s" in lines[1]
