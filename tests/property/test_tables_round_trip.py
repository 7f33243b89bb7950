"""A table written and read again is the same table, whatever numbers are in it."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from schuler.ground.tables import SCHEMAS, Table
from schuler.io.tables import read_table, write_table

NAMES = [n for n in SCHEMAS if n not in ("positions", "imu")]
quick = settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])


@st.composite
def tables(draw):
    """Any table of the contract with a random choice of its optional columns."""
    name = draw(st.sampled_from(NAMES))
    schema = SCHEMAS[name]
    rows = draw(st.integers(1, 12))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    wanted = {c.name for c in schema.columns if c.required or draw(st.booleans())}
    for choice in schema.choices:
        wanted |= set(choice[0])
    columns = {}
    for c in schema.columns:
        if c.name not in wanted:
            continue
        size = draw(st.sampled_from([1e-6, 1.0, 1e4]))
        if c.text:
            columns[c.name] = np.array([f"b{k % 3}, {k}" for k in range(rows)])
        elif c.name == "time":
            columns[c.name] = draw(st.sampled_from([0.0, 1.7e9])) + np.cumsum(rng.uniform(0.01, 2.0, rows))
        elif c.name in ("lat", "pitch", "elevation"):
            columns[c.name] = rng.uniform(-1.57, 1.57, rows)
        elif c.si == "rad":
            columns[c.name] = rng.uniform(0, 1, rows) if c.name.startswith("std_") else rng.uniform(-3.1, 3.1, rows)
        else:
            columns[c.name] = rng.uniform(0.01, 1.0, rows) * size
    return Table(name, columns)


@pytest.mark.parametrize("suffix", [".csv", ".csv.gz", ".npz", ".parquet"])
@given(table=tables())
@quick
def test_write_and_read_again(tmp_path, suffix, table):
    back = read_table(write_table(tmp_path / f"t{suffix}", table), table.name)
    assert list(back.columns) == [c for c in table.columns]
    for name, values in table.columns.items():
        if values.dtype.kind == "U":
            assert list(back[name]) == list(values)
        elif SCHEMAS[table.name][name].si == "rad":
            np.testing.assert_allclose(back[name], values, rtol=1e-12, atol=2e-14)  # 12 digits of a degree
        else:
            np.testing.assert_allclose(back[name], values, rtol=1e-15, atol=0)


@given(seed=st.integers(0, 2**32 - 1), rows=st.integers(1, 50), kind=st.sampled_from(["rates", "increments"]))
@quick
def test_an_imu_keeps_every_bit(tmp_path, seed, rows, kind):
    rng = np.random.default_rng(seed)
    dt = 0.01
    stems = ("gyro", "accel") if kind == "rates" else ("dtheta", "dv")
    scale = 1.0 if kind == "rates" else dt
    columns = {"time": dt * np.arange(1, rows + 1)}
    for stem, size, offset in zip(stems, (0.01, 0.1), (0.0, -9.8), strict=True):
        columns |= {f"{stem}_{a}": scale * (rng.normal(0, size, rows) + offset * (a == "z")) for a in "xyz"}
    table = Table("imu", columns, kind)
    back = read_table(write_table(tmp_path / "imu.csv", table), "imu")
    assert back.kind == kind and back.notes == []
    for name, values in columns.items():
        np.testing.assert_array_equal(back[name], values)


def test_equal_tables_make_equal_files(tmp_path):
    table = Table("depth", {"time": np.arange(3.0), "depth": np.array([1.0, np.pi, 2.0])})
    for suffix in (".csv", ".csv.gz"):
        a, b = (write_table(tmp_path / f"{n}{suffix}", table).read_bytes() for n in "ab")
        assert a == b


def test_latitude_has_twelve_digits(tmp_path):
    place = {"time": np.zeros(1), "lat": np.array([0.7]), "lon": np.array([-1.2])}
    row = write_table(tmp_path / "g.csv", Table("gnss", place)).read_text().splitlines()[1].split(",")
    assert [len(cell.partition(".")[2]) for cell in row[1:]] == [12, 12]
