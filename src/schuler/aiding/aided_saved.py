"""An online filter as bytes, and back: JSON for the words, float64 for the numbers, a checksum over both."""

from __future__ import annotations

import json
import math
import struct
import zlib
from collections import deque
from collections.abc import Sequence
from dataclasses import asdict, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from schuler.aiding.aided_aids import Aid
from schuler.aiding.aided_sensors import Sensor
from schuler.aiding.aided_settings import AidedSettings, Start
from schuler.ground.errors import InputError

if TYPE_CHECKING:
    from schuler.aiding.aided_online import AidedFilter

Array = NDArray[np.float64]
MAGIC = b"SCHULER-AIDED-1\n"


def save(nav: AidedFilter) -> bytes:
    """See `AidedFilter.save`."""
    from schuler.aiding.aided_online import STATE
    from schuler.aiding.aided_window import first_node

    e, w = nav.engine, nav._wait
    n = int(e.kept.counts[nav._NODES])
    first = first_node(nav, n) if n and nav.started else 0  # what has left the lag is not told
    arrays: list[Array] = [getattr(e, name) for name in STATE]
    arrays += [e.c, e.ring, nav._ear.numbers, nav._ear.window, *nav._rows, *w.rows]
    for mark in (*nav._marks, *((nav._undo,) if nav._undo is not None else ())):
        arrays += [*mark.state, mark.ring]
    if nav.lag_s > 0.0:
        arrays += [a[first:n] for a in (*e.kept.nodes, e.kept.node_time, e.kept.node_std)]
    head: dict[str, Any] = {
        "settings": asdict(replace(nav.settings, camera=None, height_model=None)),
        "sensors": nav.sensors, "own": list(nav.own), "late_s": nav.late_s,
        "lag_s": nav.lag_s, "interval": nav.interval, "started": nav.started, "lost": nav.lost, "start": nav.start_time,
        "notes": nav.notes, "pending": nav._pending, "done": nav._done, "slots": nav._slots, "nodes": n - first,
        "marks": [[m.time, m.nodes - first] for m in nav._marks],
        "undo": None if nav._undo is None else [nav._undo.time, nav._undo.nodes - first],
        "shapes": [list(a.shape) for a in arrays], "rows": len(nav._rows), "waiting": len(w.rows),
        "aids": [[a.kind, a.time, list(a.z), a.ready] for a in w.aids], "next": w.next, "reason": w.reason,
        "innovations": {
            k: [i.time, i.value.tolist(), i.std.tolist(), i.nis, i.weight] for k, i in nav.innovations.items()
        },
    }  # fmt: skip
    text = json.dumps(head, sort_keys=True).encode()
    body = struct.pack("<q", len(text)) + text + b"".join(np.asarray(a, "<f8").tobytes() for a in arrays)
    return MAGIC + struct.pack("<I", zlib.crc32(body)) + body


def load(cls: type[AidedFilter], blob: bytes, own: Sequence[Sensor]) -> AidedFilter:
    """See `AidedFilter.load`."""
    try:
        if not blob.startswith(MAGIC):
            raise ValueError("no filter")
        check, size = struct.unpack_from("<Iq", blob, len(MAGIC))
        begin = len(MAGIC) + 12
        if check != zlib.crc32(blob[begin - 8 :]):
            raise ValueError("changed")
        head = json.loads(blob[begin : begin + size])
        numbers = np.frombuffer(blob, "<f8", offset=begin + size)
        sensors = {sensor.name: sensor for sensor in own}
        missing = [name for name in head["own"] if name not in sensors]
    except (ValueError, KeyError, TypeError, struct.error) as error:
        raise InputError("these bytes are not a saved aided filter of this version; save one with .save()") from error
    if missing:
        raise InputError(f"load: the filter was saved with the sensor {', '.join(missing)}; give it in own")
    try:
        return _rebuilt(cls, head, numbers, [sensors[name] for name in head["own"]])
    except (ValueError, KeyError, TypeError, IndexError, AttributeError) as error:
        raise InputError("these bytes are not a saved aided filter of this version; save one with .save()") from error


def _rebuilt(cls: type[AidedFilter], head: dict[str, Any], numbers: Array, own: list[Sensor]) -> AidedFilter:
    from schuler.aiding.aided_engine import room
    from schuler.aiding.aided_online import STATE, Innovation, Mark
    from schuler.aiding.aided_window import INNER_ROOM

    def tuples(given: dict[str, Any]) -> dict[str, Any]:
        return {a: tuple(b) if isinstance(b, list) else b for a, b in given.items()}

    given = dict(head["settings"])
    given["start"] = Start(**tuples(given["start"]))
    nav = cls(
        AidedSettings(**tuples(given)), sensors=head["sensors"], own=own, late_s=head["late_s"], lag_s=head["lag_s"],
        interval=head["interval"],
    )  # fmt: skip
    shapes = [tuple(shape) for shape in head["shapes"]]
    place, number = 0, 0

    def take() -> Array:
        nonlocal place, number
        shape = shapes[number]
        n = math.prod(shape)
        place, number = place + n, number + 1
        return numbers[place - n : place].reshape(shape).copy()

    e = nav.engine
    for name in (*STATE, "c", "ring"):
        value = take()
        if value.shape != getattr(e, name).shape:
            raise ValueError(name)
        setattr(e, name, value)
    nav._ear.numbers, nav._ear.window = take(), take()
    nav._rows = deque(take() for _ in range(head["rows"]))
    w = nav._wait
    w.rows = [take() for _ in range(head["waiting"])]
    w.aids = [Aid(k, t, tuple(z), ready) for k, t, z, ready in head["aids"]]
    w.next, w.reason = head["next"], head["reason"]
    for time, nodes in head["marks"]:
        nav._marks.append(Mark(time, tuple(take() for _ in STATE), take(), nodes))
    if head["undo"] is not None:
        nav._undo = Mark(head["undo"][0], tuple(take() for _ in STATE), take(), head["undo"][1])
    n = int(head["nodes"])
    if nav.lag_s > 0.0:
        e.kept = room(e.layout.n, inner=INNER_ROOM, nodes=max(64, 2 * n))
        for a in (*e.kept.nodes, e.kept.node_time, e.kept.node_std):
            a[:n] = take()
    e.kept.counts[nav._NODES] = n
    if place != numbers.size or number != len(shapes):
        raise ValueError("length")
    nav.started, nav.start_time, nav.notes = head["started"], head["start"], list(head["notes"])
    nav.lost = head["lost"]
    nav._pending, nav._done = ([(t, k, tuple(z)) for t, k, z in head[name]] for name in ("pending", "done"))
    nav._slots = {k: list(v) for k, v in head["slots"].items()}
    nav.innovations = {
        k: Innovation(t, np.array(v), np.array(s), nis, weight)
        for k, (t, v, s, nis, weight) in head["innovations"].items()
    }
    return nav
