"""Random numbers that do not depend on how runs are spread, nor on which other sensors there are."""

from __future__ import annotations

import zlib

import numpy as np

from schuler.ground.errors import InputError


def stream(seed: int, run: int, sensor: str) -> np.random.Generator:
    """The random stream of one quantity in one run: the same numbers for the same (seed, run, sensor), always.

    `sensor` is a name such as "imu.noise"; its checksum is part of the spawn key, so a new name cannot disturb the
    others. Philox is counter based (Salmon et al. 2011): streams with different keys do not overlap.
    """
    if seed < 0 or run < 0:
        raise InputError(f"seed {seed} and run {run} must not be negative: type a whole number from 0 on")
    key = (run, zlib.crc32(sensor.encode()))
    return np.random.Generator(np.random.Philox(np.random.SeedSequence(seed, spawn_key=key)))
