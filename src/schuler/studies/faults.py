"""Faults of a study file as sentences: the place, what came, what was meant, what to type."""

from __future__ import annotations

import difflib
import json
import re
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pydantic import BaseModel, ValidationError

HUGE = 1e12  # Unix seconds are 2e9
_LISTS = {"outage"}  # sections that are written [[name]]
_SAMPLE_WORDS = {"name": '"harbour trial 7"', "kind": '"auv"'}


def typed(value: Any) -> str:
    """A value as it would be typed in TOML, shortened."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        text = json.dumps(value, ensure_ascii=False)
    elif isinstance(value, list | tuple):
        text = "[" + ", ".join(typed(v) for v in value) + "]"
    elif isinstance(value, dict):
        text = "a table"
    elif _finite(value) and value == int(value) and abs(value) < 1e15:
        text = f"{value:.1f}"
    else:
        text = str(value)
    return text if len(text) <= 60 else text[:57] + "..."


def _finite(value: Any) -> bool:
    return isinstance(value, float) and value - value == 0.0


def nearest(word: str, known: list[str]) -> str | None:
    """The known spelling nearest to a word, or None where nothing is near."""
    exact = {k.lower(): k for k in known}
    if word.lower() in exact:
        return exact[word.lower()]
    close = difflib.get_close_matches(word.lower(), [k.lower() for k in known], n=1, cutoff=0.6)
    if close:
        return exact[close[0]]
    starts = [k for k in known if k.lower().startswith(word.lower() + "_") or word.lower().startswith(k.lower() + "_")]
    return starts[0] if starts else None


def place_of(loc: tuple[Any, ...]) -> str:
    """`[noise] speed_mps`, `[[outage]] 2 start_s`, `[platform.alignment] damping` of a location in the file."""
    path = [p for p in loc if isinstance(p, str)]
    if not path:
        return "the file"
    if path[0] in _LISTS:
        number = next((p + 1 for p in loc if isinstance(p, int)), None)
        where = f"[[{path[0]}]]" + (f" {number}" if number else "")
        return " ".join([where, *path[1:]])
    if len(path) == 1:
        return f"[{path[0]}]"
    index = next((p + 1 for p in loc if isinstance(p, int)), None)
    return f"[{'.'.join(path[:-1])}] {path[-1]}" + (f" (entry {index})" if index else "")


def _section_class(top: type[BaseModel], loc: tuple[Any, ...]) -> tuple[type[BaseModel], list[str]]:
    """The model class in which the last name of a location stands, and its keys."""
    current: Any = top
    for part in loc[:-1]:
        if isinstance(part, int):
            continue
        current = _model_in(current.model_fields[part].annotation)
    return current, list(current.model_fields)


def _model_in(annotation: Any) -> Any:
    from typing import get_args

    if isinstance(annotation, type) and hasattr(annotation, "model_fields"):
        return annotation
    for arg in get_args(annotation):
        found = _model_in(arg)
        if found is not None:
            return found
    return None


def _field(top: type[BaseModel], loc: tuple[Any, ...]) -> Any:
    names = tuple(p for p in loc if isinstance(p, str))
    try:
        model, _ = _section_class(top, names)
        return model.model_fields[names[-1]]
    except (AttributeError, KeyError, IndexError):
        return None


def _unit(field: Any) -> str:
    return ((getattr(field, "json_schema_extra", None) or {}).get("unit", "")) if field is not None else ""


def _number_in(value: Any) -> str | None:
    if isinstance(value, str):
        found = re.search(r"[-+]?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?", value)
        return found.group(0).rstrip(".") if found else None
    return None


def _converted(value: Any, unit: str) -> str | None:
    """A number with a unit behind it, such as "0.5 kn", in the unit of its key; None where that cannot be known."""
    from schuler.ground.units import UNITS, quantity, to_si

    found = (
        re.fullmatch(r"\s*([-+]?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?)\s*(\S+)\s*", value) if isinstance(value, str) else None
    )
    if found is None or found[2] not in UNITS or unit not in UNITS or quantity(found[2]) != quantity(unit):
        return None
    return f"{float(to_si(float(found[1]), found[2])) / float(to_si(1.0, unit)):.6g}"


def _type_next(name: str, value: Any, field: Any, shape: str) -> str:
    default = None if field is None or field.is_required() else field.default
    if shape == "three":
        sample = typed(default) if default is not None else "[0.0, 0.0, 0.0]"
    elif shape == "truth":
        sample = "true"
    elif shape == "text":
        if _unit(field) == "file":
            sample = f'"{name}.csv"'
        else:
            sample = _SAMPLE_WORDS.get(name, f'"{value}"' if isinstance(value, int | float) else '"..."')
    else:
        number = _converted(value, _unit(field)) or _number_in(value)
        sample = number or (typed(default) if isinstance(default, int | float) else "1" if shape == "whole" else "1.0")
    return f"type {name} = {sample}"


def _sentence(top: type[BaseModel], e: dict[str, Any]) -> str:
    loc, kind, value, ctx = tuple(e["loc"]), e["type"], e["input"], e.get("ctx") or {}
    place = place_of(loc)
    names = [p for p in loc if isinstance(p, str)]
    name = names[-1] if names else ""
    field = _field(top, loc)
    unit = _unit(field)
    in_unit = f" in {unit}" if unit and unit != "file" else ""
    inside_list = bool(loc) and isinstance(loc[-1], int)

    if kind == "extra_forbidden":
        model, known = _section_class(top, loc)
        what = "section" if model is top else "key"
        near = nearest(name, known)
        if what == "section":
            if not isinstance(value, dict | list):
                homes = [
                    s
                    for s, f in top.model_fields.items()
                    if name in getattr(_model_in(f.annotation), "model_fields", {})
                ]
                if homes:
                    return f"{name}: stands outside every section; it belongs under [{homes[0]}]"
            shown = f"[[{near}]]" if near in _LISTS else f"[{near}]"
            return f"[{name}]: no such section" + (
                f"; did you mean {shown}?" if near else f"; the sections are {', '.join(known)}"
            )
        homes = [s for s, f in top.model_fields.items() if name in getattr(_model_in(f.annotation), "model_fields", {})]
        if homes:
            return f"{place}: no such key here; it belongs under [{homes[0]}]"
        if near:
            return f"{place}: no such key; did you mean {near}? type {near} = {typed(value)}"
        return f"{place}: no such key; the keys here are {', '.join(known)}"
    if kind == "missing":
        if len(names) == 1 and not isinstance(loc[-1], int):
            extra = ' with name = "harbour trial 7" and kind = "auv"' if name == "study" else ""
            return f"[{name}]: missing; type a [{name}] section{extra}"
        return f"{place}: missing; {_type_next(name, None, field, _shape_of(field))}"
    if kind in ("model_type", "model_attributes_type", "dict_type"):
        if names and names[0] in _LISTS:
            return f"[[{name}]]: expects a table of its own; came {typed(value)}; begin it with the line [[{name}]]"
        return f"[{name}]: expects a section; came {typed(value)}; begin it with the line [{name}]"
    if kind == "tuple_type":
        if names and names[0] in _LISTS and len(names) == 1:
            return f"[[{name}]]: came as one table [{name}]; type it with two brackets, [[{name}]]"
        return f"{place}: expects a list; came {typed(value)}; type {name} = [{typed(value)}]"
    if kind in ("float_type", "float_parsing", "finite_number"):
        if inside_list:
            return f"{place}: expects numbers{in_unit}; came {typed(value)}"
        if kind == "finite_number":
            return f"{place}: expects a finite number{in_unit}; came {typed(value)}"
        return f"{place}: expects a number{in_unit}; came {typed(value)}; {_type_next(name, value, field, 'number')}"
    if kind in ("int_type", "int_from_float", "int_parsing"):
        return f"{place}: expects a whole number; came {typed(value)}; {_type_next(name, value, field, 'whole')}"
    if kind == "bool_type":
        return f"{place}: expects true or false; came {typed(value)}; type {name} = true"
    if kind == "string_type":
        what = "a file name in quotes" if unit == "file" else "text in quotes"
        return f"{place}: expects {what}; came {typed(value)}; {_type_next(name, value, field, 'text')}"
    if kind == "literal_error":
        known = [w.strip("' ") for w in re.split(r",| or ", ctx.get("expected", "")) if w.strip()]
        near = nearest(value, known) if isinstance(value, str) else None
        hint = f'; did you mean "{near}"?' if near else ""
        quoted = ", ".join(f'"{w}"' for w in known)
        return f"{place}: expects one of {quoted}; came {typed(value)}{hint}"
    limits = {
        "greater_than": ("gt", "more than"),
        "greater_than_equal": ("ge", "at least"),
        "less_than": ("lt", "less than"),
        "less_than_equal": ("le", "at most"),
    }
    if kind in limits:
        bound, words = limits[kind]
        return f"{place}: must be {words} {ctx[bound]:g}{' ' + unit if unit else ''}; came {typed(value)}"
    if kind in ("three_numbers", "one_or_three_numbers", "two_numbers", "grid", "rate", "negative_sigma"):
        if kind == "rate":
            return f"{place}: {e['msg']}; came {typed(value)}; type {name} = {_number_in(value) or 10}"
        return f"{place}: {e['msg']}{in_unit}; came {typed(value)}" + (
            f"; {_type_next(name, value, field, 'three')}" if kind == "three_numbers" else ""
        )
    if kind == "string_pattern_mismatch":
        return f"{place}: names the result folder, so no slash and no leading dot; came {typed(value)}"
    if kind in ("too_short", "tuple_too_short"):
        return f"{place}: expects at least one number{in_unit}; came {typed(value)}"
    return f"{place}: {e['msg'][0].lower()}{e['msg'][1:]}; came {typed(value)}"


def _shape_of(field: Any) -> str:
    text = str(getattr(field, "annotation", ""))
    if "tuple[float, float, float]" in text:
        return "three"
    if "str" in text or "Literal" in text:
        return "text"
    return "truth" if "bool" in text else "number"


def sentences(error: ValidationError, top: type[BaseModel], raw: dict[str, Any]) -> list[str]:
    """One sentence a fault, in the order of the file where that is known."""
    order = {name: i for i, name in enumerate(raw)}
    found = sorted(error.errors(), key=lambda e: order.get(str(e["loc"][0]) if e["loc"] else "", -1))
    misspelt = set()  # a key that came under another spelling is not said to be missing as well
    for e in found:
        if e["type"] == "extra_forbidden":
            near = nearest(str(e["loc"][-1]), _section_class(top, tuple(e["loc"]))[1])
            misspelt.add((*e["loc"][:-1], near))
    out: list[str] = []
    for e in found:
        if e["type"] == "missing" and tuple(e["loc"]) in misspelt:
            continue
        said = _sentence(top, dict(e))
        if said not in out:
            out.append(said)
    return out


# ---- what no single key can say ----


def _section(raw: dict[str, Any], name: str) -> dict[str, Any]:
    value = raw.get(name)
    return value if isinstance(value, dict) else {}


def cross_faults(raw: dict[str, Any], folder: Path | None) -> list[str]:
    """Faults between keys and sections, and named files that do not exist. Works on a file with other faults too."""
    faults: list[str] = []
    imu = _section(raw, "imu")
    numbers = [k for k in imu if k not in ("preset", "calibration")]
    if "preset" in imu and numbers:
        faults.append(
            f"[imu] preset: came beside {', '.join(numbers)}; a preset or numbers, never both; "
            f"delete the line preset = {typed(imu['preset'])} or the numbers"
        )
    given = _section(raw, "input")
    files = [k for k, v in given.items() if isinstance(v, str) and not k.endswith("_unit")]
    faults += _units(given)
    recorded = [k for k in files if k != "reference"]
    kind = _section(raw, "study").get("kind")
    if "mission" in raw and recorded:
        faults.append(
            f"[mission]: came beside [input] {', '.join(recorded)}; a study with recorded tables is not simulated; "
            "delete [mission] or [input]"
        )
    if kind == "auv" and "mission" not in raw and not recorded:
        faults.append(
            '[input]: names no table and there is no [mission]; type [input] with gnss = "gnss.csv" and the others, '
            'or [mission] with preset = "demo"'
        )
    if kind == "auv" and recorded:
        faults += _auv_inputs(raw, recorded)
    if kind == "ahrs" and "imu" not in recorded:
        faults.append('[input] imu: missing; kind "ahrs" reads gyros and accelerometers; type imu = "imu.csv"')
    if isinstance(kind, str) and kind != "auv":
        method = _section(raw, "filter").get("method")
        if method in ("paper", "paper-literal"):
            faults.append(f'[filter] method: {typed(method)} belongs to kind "auv"; type method = "schuler"')
    if folder is not None:
        for name in files:
            path = folder / given[name]
            if not path.is_file():
                what = "is a folder" if path.is_dir() else "does not exist"
                faults.append(f"[input] {name}: {typed(given[name])} {what} (looked in {path.parent})")
        calibration = imu.get("calibration")
        if isinstance(calibration, str) and not (folder / calibration).is_file():
            faults.append(f"[imu] calibration: {typed(calibration)} does not exist (looked in {folder})")
    faults += _spans(raw)
    faults += _huge(raw)
    for key in ("gnss_m", "gnss_mps", "attitude_deg"):
        value = _section(raw, "noise").get(key)
        if isinstance(value, list) and any(isinstance(v, int | float) and v <= 0 for v in value):
            faults.append(f"[noise] {key}: a sigma must be more than 0; came {typed(value)}")
    return faults


def _units(given: dict[str, Any]) -> list[str]:
    """Units typed under [input] that are none, or of another quantity."""
    from schuler.ground.errors import InputError
    from schuler.io.headings import check_unit

    faults = []
    for key, want, sample in (("gyro_unit", "angular rate", "deg/s"), ("accel_unit", "acceleration", "g")):
        value = given.get(key)
        if isinstance(value, str):
            try:
                check_unit(value, want, f"[input] {key}")
            except InputError as error:
                said = str(error)
                place = "" if said.startswith("[input]") else f"[input] {key}: "
                faults.append(f'{place}{said}; type {key} = "{sample}"')
    return faults


def _huge(raw: dict[str, Any]) -> list[str]:
    """Finite numbers that nothing real has: they would only end as overflow somewhere."""
    faults = []
    for name, section in raw.items():
        tables = section if isinstance(section, list) else [section]
        for number, table in enumerate(tables, 1):
            where = f"[[{name}]] {number}" if isinstance(section, list) else f"[{name}]"
            for key, value in table.items() if isinstance(table, dict) else ():
                values = value if isinstance(value, list) else [value]
                if any(isinstance(v, int | float) and HUGE < abs(v) < inf for v in values):
                    faults.append(f"{where} {key}: {typed(value)} is far outside anything real")
    return faults


def _auv_inputs(raw: dict[str, Any], recorded: list[str]) -> list[str]:
    faults = []
    start = _section(raw, "start")
    if "imu" not in recorded and "attitude" not in recorded:
        faults.append(
            '[input]: kind "auv" needs an imu or an attitude table; type imu = "imu.csv" or attitude = "attitude.csv"'
        )
    if "gnss" not in recorded and not {"lat_deg", "lon_deg"} <= set(start):
        faults.append(
            "[input] gnss: missing, and [start] does not say where; "
            'type gnss = "gnss.csv", or lat_deg and lon_deg under [start]'
        )
    if _section(raw, "filter").get("method") in ("paper", "paper-literal"):
        missing = [t for t in ("imu", "gnss", "speed") if t not in recorded]
        if missing:
            faults.append(
                f"[input] {', '.join(missing)}: missing; "
                f"method {typed(raw['filter']['method'])} needs imu, gnss and speed"
            )
    return faults


def _spans(raw: dict[str, Any]) -> list[str]:
    faults = []
    outages = raw.get("outage")
    for i, outage in enumerate(outages if isinstance(outages, list) else [], 1):
        if not isinstance(outage, dict):
            continue
        a, b = outage.get("start_s"), outage.get("end_s")
        if isinstance(a, int | float) and isinstance(b, int | float) and not b > a:
            faults.append(f"[[outage]] {i}: end_s = {b:g} is not after start_s = {a:g}")
    align = _section(raw, "align")
    a, b = align.get("from_s"), align.get("to_s")
    if isinstance(a, int | float) and isinstance(b, int | float) and not b > a:
        faults.append(f"[align]: to_s = {b:g} is not after from_s = {a:g}")
    lengths = _section(raw, "sweep").get("length_s")
    for length in lengths if isinstance(lengths, list) else [lengths]:
        if isinstance(length, int | float) and length <= 0:
            faults.append(f"[sweep] length_s: must be more than 0 s; came {typed(lengths)}")
    return faults
