"""Kept figures of `sins_filters`; written by benchmarks/oeson.py."""

from __future__ import annotations

from typing import NamedTuple


class Kept(NamedTuple):
    """rms of position m, velocity m/s, tilt and yaw arcmin; position at the end m; smallest and largest error / sigma
    of the seven states; error / sigma at the end."""

    runs: int
    figures: tuple[float, float, float, float]
    end_m: float
    ratio_low: float
    ratio_high: float
    end_ratio: float


KEPT: dict[str, Kept] = {
    "unaided straight": Kept(200, (1849, 2.78, 1.047, 4.404), 3361, 0.5371, 1.32, 1.015),
    "unaided turns": Kept(200, (1797, 2.685, 1.013, 4.319), 3261, 0.6397, 1.276, 1.007),
    "landmarks-1px-6 straight": Kept(200, (0.0636, 0.0006879, 0.2061, 0.04756), 0.05524, 0.6886, 1.048, 1.013),
    "landmarks-1px-6 turns": Kept(200, (0.01891, 0.0007741, 0.009283, 0.02472), 0.01739, 0.3374, 0.8683, 0.8271),
    "landmarks-5px-6 straight": Kept(200, (0.1179, 0.001572, 0.3284, 0.2155), 0.1187, 0.7126, 1.009, 0.9768),
    "landmarks-5px-6 turns": Kept(200, (0.07076, 0.001834, 0.012, 0.06898), 0.06681, 0.3734, 0.9185, 0.8946),
    "landmarks-5px-1 straight": Kept(40, (0.1793, 0.002514, 0.3547, 0.4311), 0.1793, 0.7136, 1.065, 0.9691),
    "landmarks-5px-1 turns": Kept(40, (0.1514, 0.003213, 0.01468, 0.116), 0.1466, 0.3931, 0.9335, 0.9155),
    "gap-300 straight": Kept(40, (0.5396, 0.004955, 0.2057, 0.05384), 2.438, 0.9136, 1.016, 0.9314),
    "gap-300 turns": Kept(40, (0.5266, 0.004893, 0.02126, 0.0331), 2.387, 0.7906, 0.986, 0.8858),
    "false-5-percent straight": Kept(40, (0.06272, 0.0006914, 0.2021, 0.04504), 0.05584, 0.6803, 1.039, 0.9898),
    "false-5-percent turns": Kept(40, (0.01914, 0.0007803, 0.008899, 0.02193), 0.01809, 0.317, 0.8709, 0.8446),
    "a2-consistent straight": Kept(40, (0.5874, 0.006992, 0.3521, 4.298), 0.6003, 0.8219, 1.257, 0.9701),
    "a2-consistent turns": Kept(40, (0.6837, 0.01183, 0.06314, 0.3011), 0.59, 0.8766, 1.059, 0.925),
    "a2-zeroed straight": Kept(40, (8.672, 0.3175, 0.7654, 7.138), 46.86, 1.271, 18.56, 72.33),
    "a2-zeroed turns": Kept(40, (0.7312, 0.0145, 0.06817, 0.3255), 0.9182, 0.6881, 1.059, 1.427),
    "a2-printed straight": Kept(40, (1.29, 0.07302, 1.245, 243.7), 1.22, 0.1174, 0.9501, 0.8861),
    "a2-printed turns": Kept(40, (1.319, 0.08123, 1.064, 3.998), 1.225, 0.5034, 0.9493, 0.8892),
    "a3-unaided straight": Kept(40, (1.187e+04, 33, 20.95, 27.25), 2.166e+04, 0.4998, 0.912, 0.6412),
    "a3-unaided turns": Kept(40, (1.159e+04, 32.08, 20.21, 28.95), 2.113e+04, 0.3252, 0.9644, 0.6486),
}
