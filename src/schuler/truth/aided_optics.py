"""Camera and lidar aboard a simulated vehicle: the part of `truth.aided` that looks at the ground."""

from __future__ import annotations

from math import pi
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from schuler.ground.errors import InputError
from schuler.ground.lidar import Lidar
from schuler.ground.tables import Table
from schuler.ground.terrain import HeightModel
from schuler.truth import optics

if TYPE_CHECKING:
    from schuler.truth.aided import _Vehicle


def sightings(v: _Vehicle) -> None:
    """The sightings and landmarks tables of `AidedSuite.camera`."""
    s = v.suite
    if s.sightings_hz <= 0.0:
        return
    if s.camera is None:
        raise InputError("sightings need a camera: type [camera] focal_px and the others")
    camera = s.camera
    m = v.moments(s.sightings_hz)
    _ground(v)

    def rows() -> dict[str, NDArray]:
        seen = optics.scattered(
            m.truth(), camera, s.sightings_each, ground=v.ground, half=s.picture, wrong_share=s.sightings_wrong,
            seed=v.seed, run=v.run, earth=v.path.earth,
        )  # fmt: skip
        if not len(seen.sightings):
            v.notes.append("the camera never has the ground before it: no sightings")
        names = ("id", "lat", "lon", "height")
        old = v.landmarks
        joined = {c: seen.landmarks[c] if old is None else np.concatenate([old[c], seen.landmarks[c]]) for c in names}
        v.landmarks = Table("landmarks", joined, source="simulated")
        return dict(seen.sightings.columns)

    v.tables["sightings"] = rows


def lidar_ranges(v: _Vehicle) -> None:
    """The lidar table, over a height model."""
    s = v.suite
    if s.lidar_hz <= 0.0:
        return
    lidar = s.lidar or Lidar()
    m = v.moments(s.lidar_hz)
    _ground(v, wanted=True)

    def rows() -> dict[str, NDArray]:
        assert isinstance(v.ground, HeightModel)
        n = len(m.time)
        down, aside = -0.5 * pi, -0.5 * pi + s.lidar_swing
        beams = np.array([[0.0, down], [0.5 * pi, aside], [-0.5 * pi, aside]])[np.arange(n) % 3][:, None, :]
        table, notes = optics.lidar_over_ground(
            m.truth(), lidar, v.ground, beams, seed=v.seed, run=v.run, earth=v.path.earth
        )
        v.notes += [f"lidar: {note}" for note in notes]
        return dict(table.columns)

    v.tables["lidar"] = rows


def _ground(v: _Vehicle, wanted: bool = False) -> None:
    """Hills under the whole track where there is relief, or a flat model where one is wanted."""
    s, path = v.suite, v.path
    if isinstance(v.ground, HeightModel) or (s.ground_relief <= 0.0 and not wanted):
        return
    seen = path.at(np.linspace(0.0, path.duration, 400))
    lon = np.unwrap(seen.lon)
    above = float(np.max(seen.height)) - s.ground_height + 3.0 * s.ground_relief
    margin = (2.0 * max(above, 0.0) + 500.0) / path.earth.a
    aside = margin / float(np.min(np.cos(seen.lat)))
    lat = float(seen.lat.min()) - margin, float(seen.lat.max()) + margin
    cell = 30.0
    while (lat[1] - lat[0]) * (float(np.ptp(lon)) + 2.0 * aside) * (path.earth.a / cell) ** 2 > 4e6:
        cell *= 1.5
    v.ground = optics.hills(
        lat, (float(lon.min()) - aside, float(lon.max()) + aside), cell=cell, height=s.ground_height,
        relief=s.ground_relief, seed=v.seed, sigma=s.ground_std,
    )  # fmt: skip
