"""After a run of kind "aided": what the track says of the camera's and the lidar's tables, as sentences."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

import numpy as np

from schuler.aiding.solution import Navigation, Solution
from schuler.ground.errors import InputError
from schuler.ground.tables import Table

if TYPE_CHECKING:
    from schuler.aiding.optics_checks import Fault
    from schuler.studies.model import Study

Again = Callable[[dict[str, Table]], Navigation]

PICTURES = 300  # looked at, evenly over the track
STRANGE = 3.0  # median NIS over what it should be, from which the track is not trusted to judge its own camera
BLIND_M = 60.0  # sigma of a track without the camera up to which it judges the pictures
_SAID = {"unknown", "no-height", "reach", "no-model"}  # what the filter says itself


def optics_notes(study: Study, tables: Mapping[str, Table], navigation: Navigation, again: Again) -> list[str]:
    """Sentences on mounting, focal length, mirrored axes, exchanged names, cover and datum of the height model.

    again : the filter over other tables. A camera that is wrong draws the track after it; where its innovations are
    strange the pictures are judged by the track that the other sensors give, as long as that is good to 60 m.
    """
    found: list[Fault] = []
    if "sightings" in tables and "landmarks" in tables and study.camera is not None:
        found += _camera(study, tables, navigation, again)
    if "lidar" in tables:
        found += _lidar(study, tables, navigation)
    heard = [f for f in found if f.code not in _SAID]
    return [f.says if f.type_next.startswith("nothing") else f"{f.says}; {f.type_next}" for f in heard]


def _camera(study: Study, tables: Mapping[str, Table], navigation: Navigation, again: Again) -> list[Fault]:
    from schuler.aiding import optics_checks as checks
    from schuler.studies.aided_mapping import camera_of

    model, seen = camera_of(study), tables["sightings"]
    track = navigation.smoother if navigation.smoother is not None and len(navigation.smoother) else navigation.filter
    points = tables["landmarks"]
    if model is None or not np.isfinite(track.rpy).all():
        return []
    if "lat" not in points or "height" not in points or not np.isfinite(points["height"]).all():
        return []
    if _strange(navigation):
        try:
            blind = again({name: t for name, t in tables.items() if name != "sightings"}).filter
        except InputError:
            blind = track
        until = _good_until(blind)
        if until > blind.time[0] + 10.0 and np.isfinite(blind.rpy).all():
            track, seen = blind, seen.where(seen.time <= until)
    seen = _thinned(seen)
    pictures = len(np.unique(seen.time))
    # a few pictures of one or two points are nothing to speak of beside an INS
    return [f for f in checks.camera(seen, points, model, track) if f.code != "few" or 2 * f.rows > pictures]


def _strange(navigation: Navigation) -> bool:
    """Whether the sightings contradict the track that they are part of, or were not let in at all."""
    told = navigation.innovations.get("sightings")
    if told is None or not len(told.time):
        return True
    expected = 1.386  # median of chi-square of two
    return float(np.median(told.nis)) > STRANGE * expected or float(np.mean(told.used)) < 0.7


def _good_until(track: Solution) -> float:
    """The time up to which a track without the camera is good enough to judge it."""
    sigma = np.sqrt(np.max(np.diagonal(track.cov_pos, axis1=1, axis2=2), axis=1))
    bad = ~(sigma < BLIND_M)
    return float(track.time[-1] if not bad.any() else track.time[int(np.argmax(bad))])


def _thinned(seen: Table) -> Table:
    """Whole pictures, at most PICTURES of them and 20 000 rows."""
    times = np.unique(seen.time)
    if len(times) > PICTURES:
        times = times[np.linspace(0, len(times) - 1, PICTURES).astype(int)]
    kept = seen.where(np.isin(seen.time, times))
    return kept if len(kept) <= 20_000 else kept.where(np.isin(kept.time, times[:: len(kept) // 20_000 + 1]))


def _lidar(study: Study, tables: Mapping[str, Table], navigation: Navigation) -> list[Fault]:
    from schuler.aiding import optics_checks as checks
    from schuler.ground.lidar import Lidar
    from schuler.ground.terrain import HeightModel
    from schuler.studies.sections import LidarSection

    k, track = study.lidar or LidarSection(), navigation.filter
    if not np.isfinite(track.rpy).all():
        return []
    sensor = Lidar(study.noise.lidar_m, k.reach_m, 1e-3 * k.divergence_mrad, np.array(k.position_frd_m))
    try:
        model = HeightModel.from_table(tables["height_model"]) if "height_model" in tables else None
    except InputError:
        return []  # refused before, with its reason
    return checks.lidar(tables["lidar"], sensor, track, model=model, landmarks=tables.get("landmarks"))
