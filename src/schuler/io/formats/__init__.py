"""One reader a recorder's format. Each module has `recognise(path)` and `convert(path, ...) -> dict[name, Table]`.

`FORMATS` lists them in the order in which they are asked; a module is imported when it is asked.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from types import ModuleType


@dataclass(frozen=True)
class Format:
    """name : what --format takes. what : for people, also in messages."""

    name: str
    what: str

    @property
    def module(self) -> ModuleType:
        return import_module(f"schuler.io.formats.{self.name}")


FORMATS = (
    Format("seaglider", "Seaglider dives: basestation p*.nc, or a folder of them, or diveN_*.csv sets"),
    Format("seaexplorer", "SeaExplorer navigation: *.gli.sub.* files, a folder of them, or nav.csv"),
    Format("comma2k19", "a comma2k19 segment: a folder with imu, gnss_ublox, speed and reference csv files"),
    Format("phone", "a drive with a telephone: a folder with acc, gyro and gnss csv files, each with its own stamps"),
    Format("quaddot", "quadrotor flights with DOT sensors: a folder with NAME_truth and NAME_imuK csv files"),
    Format("umnuav", "UMN / AuraUAS flight data: a csv with p q r, ax ay az, GPS_TOW and the rest in one row"),
    Format("rtklib", "RTKLIB solutions (.pos), and IMU logs with its time tag (.tag) beside them"),
    Format("broad", "BROAD trials (.npz): hand-moved 9-axis IMU with optical attitude"),
    Format("ulog", "PX4 ULog (.ulg)"),
    Format("nmea", "NMEA 0183 logs (.nmea, .log, .txt)"),
    Format("matlab", "MATLAB files (.mat, version 5 to 7.2), NaveGo structures among them"),
    Format("generic", "tables in CSV, .csv.gz, npz or parquet, whatever their headings; a folder of them"),
)
