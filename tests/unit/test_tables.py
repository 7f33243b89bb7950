"""The schemas say what the contract says, and validate finds each kind of fault."""

import numpy as np
import pytest

from schuler.ground.aliases import ALIASES, plain
from schuler.ground.tables import SCHEMAS, Table, validate
from schuler.ground.units import quantity


def gnss(**changes):
    columns = {
        "time": np.arange(5.0),
        "lat": np.full(5, 0.9),
        "lon": np.full(5, 0.1),
        "height": np.zeros(5),
        "std_north": np.ones(5),
    }
    return Table("gnss", columns | changes)


@pytest.mark.parametrize(
    "table,headers",
    [
        (
            "imu",
            "time[s] gyro_x[rad/s] gyro_z[rad/s] accel_x[m/s^2] dtheta_y[rad] dv_z[m/s] mag_x[uT] temperature[degC]",
        ),
        (
            "gnss",
            "time[s] lat[deg] lon[deg] height[m] std_north[m] std_east[m] std_down[m] v_north[m/s] std_v_down[m/s]",
        ),
        ("gnss", "north[m] east[m]"),
        ("speed", "time[s] speed[m/s] ddist[m] dheading[rad]"),
        ("dvl", "time[s] v_x[m/s] v_y[m/s] v_z[m/s]"),
        ("depth", "time[s] depth[m]"),
        ("attitude", "time[s] roll[deg] pitch[deg] heading[deg] heading_mag[deg]"),
        ("height", "time[s] height[m]"),
        ("ranges", "time[s] id range[m]"),
        ("lidar", "time[s] range[m] azimuth[deg] elevation[deg] id"),
        ("height_model", "lat[deg] lon[deg] height[m]"),
        ("landmarks", "id lat[deg] lon[deg] height[m]"),
        ("sightings", "time[s] id u[px] v[px]"),
        ("reference", "time[s] lat[deg] lon[deg] height[m] v_north[m/s] v_down[m/s] roll[deg] pitch[deg] heading[deg]"),
        ("solution", "std_north[m] std_v_east[m/s] std_heading[deg]"),
    ],
)
def test_headers_of_the_contract(table, headers):
    have = [c.header for c in SCHEMAS[table].columns]
    for header in headers.split():
        assert header in have


def test_units_are_known_and_angles_become_radians():
    for schema in SCHEMAS.values():
        for column in schema.columns:
            if column.unit:
                assert quantity(column.unit) == quantity(column.si)
    assert SCHEMAS["gnss"]["lat"].si == "rad"
    assert SCHEMAS["imu"]["mag_x"].si == "T"


def test_an_imu_needs_rates_or_increments_and_a_fix_a_place():
    imu = SCHEMAS["imu"]
    rates = [f"{s}_{a}" for s in ("gyro", "accel") for a in "xyz"]
    increments = [f"{s}_{a}" for s in ("dtheta", "dv") for a in "xyz"]
    assert imu.missing(["time", *rates]) == []
    assert imu.missing(["time", *increments]) == []
    assert imu.missing(["time", *rates[:-1]]) == ["accel_z[m/s^2]"]
    assert SCHEMAS["gnss"].missing(["time", "north", "east"]) == []
    assert SCHEMAS["gnss"].missing(["time", "lat"]) == ["lon[deg]"]
    assert SCHEMAS["attitude"].missing(["time", "roll", "pitch", "heading_mag"]) == []


def test_no_alias_stands_for_two_columns_of_a_table():
    for table, columns in ALIASES.items():
        own = {plain(name): name for name in columns}
        for column, names in columns.items():
            for name in names:
                assert own.get(plain(name), column) == column, (table, name)


def test_a_sound_table_has_no_faults():
    assert validate(gnss()) == []


@pytest.mark.parametrize(
    "changes,word",
    [
        ({"lat": np.array([0.9, np.nan, 0.9, 0.9, 0.9])}, "row 2"),
        ({"time": np.array([0.0, 1.0, 1.0, 2.0, 3.0])}, "repeat the time"),
        ({"time": np.array([0.0, 1.0, 0.5, 2.0, 3.0])}, "goes back"),
        ({"lat": np.full(5, 1.6)}, "lat reaches"),
        ({"lon": np.full(5, 7.0)}, "lon reaches"),
        ({"std_north": np.array([1.0, 0.0, 1.0, 1.0, 1.0])}, "zero or negative"),
        ({"height": np.zeros(4)}, "different lengths"),
    ],
)
def test_each_fault_is_one_sentence(changes, word):
    faults = validate(gnss(**changes))
    assert len(faults) == 1
    assert word in faults[0]


def test_several_beacons_may_share_a_time():
    ranges = {"time": np.array([0.0, 0.0, 1.0]), "id": np.array(["a", "b", "a"]), "range": np.ones(3)}
    assert validate(Table("ranges", ranges)) == []


def test_unknown_table_and_no_rows():
    assert "no table named" in validate(Table("sonar", {}))[0]
    empty = {k: v[:0] for k, v in gnss().columns.items()}
    assert any("no rows" in f for f in validate(Table("gnss", empty)))


def test_length_of_tables_without_time():
    model = Table("height_model", {"lat": np.zeros(3), "lon": np.zeros(3), "height": np.zeros(3)})
    assert len(model) == 3
    assert len(model.where(np.array([True, False, True]))) == 2
