"""The thesis's catalogue of sensors, tables 2.1 to 2.4, with the captions put right.

Source: master thesis on the accuracy of strapdown INS (2022, in Ukrainian), pages after (2.13); figures only. Tables
2.2 to
2.4 are captioned accelerometers there and list gyros. None: not printed. Names are transliterated.
"""

from __future__ import annotations

from dataclasses import dataclass

from schuler.truth.instruments import ImuModel


@dataclass(frozen=True)
class Accelerometer:
    """One of table 2.1. scale: not repeatable part, ratio; bias_g: not repeatable part, g; axis_arcsec: change of the
    base
    plane; range_g; usd: price."""

    name: str
    scale: float
    bias_g: float
    axis_arcsec: float
    range_g: float
    usd: float | None


@dataclass(frozen=True)
class Gyro:
    """One of tables 2.2 (fibre-optic), 2.3 (dynamically tuned), 2.4 (laser). systematic: run to run, random: in run,
    deg/h
    (of a range such as 0.01/0.2 the larger is kept); g_deg_per_h: per g; scale_ratio: instability; mass_g."""

    name: str
    table: str
    range_deg_per_s: float | None
    systematic_deg_per_h: float | None
    random_deg_per_h: float | None
    scale_ratio: float | None
    g_deg_per_h: float | None = None
    mass_g: float | None = None


ACCELEROMETERS = (
    Accelerometer("A-18", 15e-5, 20e-5, 30.0, 40.0, 3310.8),
    Accelerometer("AK-15", 20e-5, 3e-5, 40.0, 20.0, 3659.3),
    Accelerometer("VA-3", 24e-5, 16e-5, 20.0, 50.0, 4356.3),
    Accelerometer("A-18T", 10e-5, 10e-5, 20.0, 40.0, 4356.3),
    Accelerometer("AK-6", 8e-5, 6e-5, 10.0, 20.0, 3833.5),
    Accelerometer("E1", 5e-5, 8e-5, 20.0, 50.0, 2265.3),
)
GYROS = (
    Gyro("VG910F", "2.2", 300.0, 5.0, 0.08, 1e-3, mass_g=110.0),
    Gyro("VG941-3", "2.2", 500.0, 30.0, 0.3, 3e-3, mass_g=40.0),
    Gyro("VG951", "2.2", 80.0, 3.0, 0.017, 1e-3, mass_g=650.0),
    Gyro("DUS-500", "2.2", 500.0, 2.0, 0.03, 1e-4, mass_g=1500.0),
    Gyro("D-36", "2.2", 60.0, 36.0, None, None),
    Gyro("KI-05-5A", "2.3", 15.0, None, 0.3, 5e-4, mass_g=430.0),
    Gyro("KIND-05-049", "2.3", 30.0, None, 0.15, 5e-4, mass_g=80.0),
    Gyro("RVG-1M", "2.3", 150.0, None, 5.0, 1e-3, mass_g=50.0),
    Gyro("GVK-6-1", "2.3", 160.0, 3.0, 0.01, None, 1.0, 265.0),
    Gyro("GVK-10", "2.3", 50.0, 25.0, 0.3, 1e-3, 3.0, 460.0),
    Gyro("GVK-18", "2.3", None, 3.0, 0.01, None, 3.0, 250.0),
    Gyro("DNG-4", "2.3", 15.0, 50.0, 0.5, None, 6.0, 80.0),
    Gyro("LG-8028", "2.4", 600.0, 0.2, 0.003, 5e-6, mass_g=1700.0),
    Gyro("GG-1342", "2.4", 800.0, 0.01, 0.003, 5e-6, mass_g=1900.0),
    Gyro("ASLIG", "2.4", 100.0, 0.1, 0.05, 5e-6, mass_g=1800.0),
    Gyro("KM-11", "2.4", None, 0.01, 0.003, None),
    Gyro("BLG-1", "2.4", 100.0, 1.5, None, 1e-5, mass_g=1600.0),
    Gyro("LG-1", "2.4", None, 0.01, 0.003, 5e-6, mass_g=1800.0),
    Gyro("Morion", "2.4", 200.0, 2.0, 0.03, None),
)


def imu_of(gyro: str, accelerometer: str) -> ImuModel:
    """An IMU of three such gyros and three such accelerometers: systematic error as turn-on bias, random one as in-run
    Gauss-Markov of an hour, scale and range as printed. KeyError for a name that is not in the tables."""
    g = {x.name: x for x in GYROS}[gyro]
    a = {x.name: x for x in ACCELEROMETERS}[accelerometer]
    return ImuModel(
        name=f"{g.name} with {a.name}",
        gyro_bias_deg_per_h=g.systematic_deg_per_h or 0.0,
        gyro_instability_deg_per_h=g.random_deg_per_h or 0.0,
        gyro_tau_s=3600.0,
        gyro_scale_ppm=(g.scale_ratio or 0.0) * 1e6,
        gyro_g_sensitivity_deg_per_h_per_g=g.g_deg_per_h or 0.0,
        gyro_range_deg_per_s=g.range_deg_per_s or 0.0,
        accel_bias_ug=a.bias_g * 1e6,
        accel_scale_ppm=a.scale * 1e6,
        accel_misalignment_mrad=a.axis_arcsec * 4.84813681109536e-3,
        accel_range_g=a.range_g,
        published=frozenset(
            {"gyro_bias_deg_per_h", "gyro_instability_deg_per_h", "gyro_scale_ppm", "gyro_range_deg_per_s",
             "gyro_g_sensitivity_deg_per_h_per_g", "accel_bias_ug", "accel_scale_ppm", "accel_misalignment_mrad",
             "accel_range_g"}
        ),
    )  # fmt: skip


# Grades, with where the figures come from; biases and scale 1 sigma.
# The three mems- grades are for the filter of a vehicle that shakes, not for a bench: a car's or a rotor's vibration is
# rectified and makes noise 5 to 10 times the data sheet's. Each was chosen so that the error at the end of GNSS outages
# is as large as the filter says, on one recording of its class each (docs/recordings.md); biases are random walks.
GRADES: dict[str, ImuModel] = {
    "mems-car": ImuModel(
        name="mems-car", gyro_arw_deg_per_sqrt_h=3.44, gyro_bias_deg_per_h=1000.0, gyro_rrw_deg_per_h_per_sqrt_h=619.0,
        gyro_scale_ppm=10000.0, accel_vrw_mps_per_sqrt_h=3.0, accel_bias_ug=30000.0, accel_rrw_ug_per_sqrt_h=3060.0,
        accel_scale_ppm=20000.0,
    ),
    "mems-aircraft": ImuModel(
        name="mems-aircraft", gyro_arw_deg_per_sqrt_h=3.44, gyro_bias_deg_per_h=4000.0,
        gyro_rrw_deg_per_h_per_sqrt_h=1238.0, gyro_scale_ppm=10000.0, accel_vrw_mps_per_sqrt_h=3.0,
        accel_bias_ug=30000.0, accel_rrw_ug_per_sqrt_h=12240.0, accel_scale_ppm=20000.0,
    ),
    "mems-multirotor": ImuModel(
        name="mems-multirotor", gyro_arw_deg_per_sqrt_h=1.72, gyro_bias_deg_per_h=6000.0,
        gyro_rrw_deg_per_h_per_sqrt_h=619.0, gyro_scale_ppm=10000.0, accel_vrw_mps_per_sqrt_h=3.0,
        accel_bias_ug=100000.0, accel_rrw_ug_per_sqrt_h=12240.0, accel_scale_ppm=20000.0,
    ),
    # Bosch BMI160 data sheet BST-BMI160-DS000 (2020): 0.007 deg/s/sqrt(Hz), 180 ug/sqrt(Hz), zero offset 3 deg/s and
    # 40 mg
    # before calibration (left out here), range 2000 deg/s and 16 g; in-run figures assumed.
    "consumer": ImuModel(
        name="consumer", gyro_arw_deg_per_sqrt_h=0.42, gyro_bias_deg_per_h=1800.0, gyro_instability_deg_per_h=20.0,
        gyro_tau_s=300.0, gyro_scale_ppm=10000.0, gyro_misalignment_mrad=5.0, gyro_range_deg_per_s=2000.0,
        accel_vrw_mps_per_sqrt_h=0.106, accel_bias_ug=20000.0, accel_instability_ug=100.0, accel_tau_s=300.0,
        accel_scale_ppm=5000.0, accel_misalignment_mrad=5.0, accel_range_g=16.0,
        published=frozenset({"gyro_arw_deg_per_sqrt_h", "accel_vrw_mps_per_sqrt_h", "gyro_range_deg_per_s",
                             "accel_range_g"}),
    ),
    # Honeywell HG1700 brochure N61-1619: 1 deg/h, 0.125 deg/sqrt(h), 1 mg, 0.065 ft/s/sqrt(h); the rest is assumed.
    "tactical": ImuModel(
        name="tactical", gyro_arw_deg_per_sqrt_h=0.125, gyro_bias_deg_per_h=1.0, gyro_instability_deg_per_h=0.3,
        gyro_tau_s=600.0, gyro_scale_ppm=150.0, gyro_misalignment_mrad=0.5, gyro_range_deg_per_s=1000.0,
        accel_vrw_mps_per_sqrt_h=0.0198, accel_bias_ug=1000.0, accel_instability_ug=50.0, accel_tau_s=600.0,
        accel_scale_ppm=300.0, accel_misalignment_mrad=0.5, accel_range_g=37.0,
        published=frozenset({"gyro_arw_deg_per_sqrt_h", "gyro_bias_deg_per_h", "accel_bias_ug",
                             "accel_vrw_mps_per_sqrt_h"}),
    ),
    # Groves (2013), table 4.1 and section 4.4: navigation (aviation) grade, 0.01 deg/h, 0.002 deg/sqrt(h), 30-100 ug.
    "navigation": ImuModel(
        name="navigation", gyro_arw_deg_per_sqrt_h=0.002, gyro_bias_deg_per_h=0.01, gyro_instability_deg_per_h=0.003,
        gyro_tau_s=3600.0, gyro_scale_ppm=5.0, gyro_misalignment_mrad=0.01, accel_vrw_mps_per_sqrt_h=0.012,
        accel_bias_ug=50.0, accel_instability_ug=10.0, accel_tau_s=3600.0, accel_scale_ppm=100.0,
        accel_misalignment_mrad=0.05, published=frozenset({"gyro_bias_deg_per_h", "gyro_arw_deg_per_sqrt_h",
                                                           "accel_bias_ug"}),
    ),
}  # fmt: skip
