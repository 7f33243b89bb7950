"""The arrows between the packages point downwards only. Reads the imports of every module; runs nothing of them."""

from __future__ import annotations

import ast
import sys
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[2] / "src" / "schuler"

# Lowest first; packages of one line stand beside each other and do not know each other, but for BESIDE.
ORDER = [
    {"ground"},
    {"kernels"},
    {"truth"},
    {"inertial"},
    {"aiding", "calibration"},
    {"judging"},
    {"published", "io", "report"},
    {"studies"},
    {"cli"},
]
LEVEL = {name: level for level, names in enumerate(ORDER) for name in names}
BESIDE = {("published", "io"), ("published", "report")}
ONLY_FROM = {
    "io": {"studies", "published", "cli"},
    "report": {"studies", "published", "cli"},
    "published": {"studies", "cli"},
}
PHYSICS = {"ground", "kernels", "truth", "inertial", "aiding", "calibration"}
FILE_CALLS = {
    "open", "read_text", "read_bytes", "write_text", "write_bytes", "loadtxt", "genfromtxt", "savetxt", "fromfile",
    "tofile", "memmap", "mkdir", "unlink",
}  # fmt: skip


def imports(tree: ast.AST, module: str, is_package: bool) -> list[tuple[int, str]]:
    """(line, absolute name) of every import, those inside functions and under TYPE_CHECKING too."""
    found = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found += [(node.lineno, alias.name) for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                parts = module.split(".")
                parts = parts[: len(parts) - node.level + (1 if is_package else 0)]
                base = ".".join([*parts, base]) if base else ".".join(parts)
            found += [(node.lineno, f"{base}.{alias.name}") for alias in node.names]
    return found


def layer(name: str) -> str | None:
    """The package a name of ours belongs to ("schuler.ground.units.DEG" -> "ground"), None for others' modules."""
    parts = name.split(".")
    return parts[1] if parts[0] == "schuler" and len(parts) > 1 else None


def faults(source: str, module: str, is_package: bool = False) -> list[str]:
    """What is wrong with the imports and file accesses of one module, as sentences."""
    tree = ast.parse(source)
    here = layer(module)
    if here is None or here in ("__main__", "__version__"):
        return []  # the package's own front door may name anything
    if here not in LEVEL:
        return [f"{module}: '{here}' has no place in the order of layers"]
    found = []
    for line, name in imports(tree, module, is_package):
        there = layer(name)
        if there is None:
            top = name.split(".")[0]
            if here == "ground" and top not in sys.stdlib_module_names | {"numpy", "__future__"}:
                found.append(f"{module}:{line} imports {top}; the ground layer stands on numpy alone")
            if top == "schuler" and name != "schuler.__version__":
                found.append(f"{module}:{line} imports the whole package; name the module that is wanted")
        elif there == "__version__":
            continue
        elif there not in LEVEL:
            found.append(f"{module}:{line} imports {name}, which has no place in the order of layers")
        elif there != here:
            if here not in ONLY_FROM.get(there, {here}):
                found.append(f"{module}:{line} imports {name}; only {sorted(ONLY_FROM[there])} may")
            elif LEVEL[there] >= LEVEL[here] and (here, there) not in BESIDE:
                found.append(f"{module}:{line} imports {name}: the arrow from {here} to {there} points upwards")
    if here in PHYSICS:
        for node in ast.walk(tree):
            if isinstance(node, ast.Call):
                called = node.func
                what = called.id if isinstance(called, ast.Name) else getattr(called, "attr", "")
                if what in FILE_CALLS:
                    found.append(f"{module}:{node.lineno} calls {what}(); {here} never touches a file")
    return found


def modules() -> list[tuple[Path, str]]:
    result = []
    for path in sorted(PACKAGE.rglob("*.py")):
        parts = ["schuler", *path.relative_to(PACKAGE).with_suffix("").parts]
        result.append((path, ".".join(parts[:-1] if parts[-1] == "__init__" else parts)))
    return result


@pytest.mark.parametrize(("path", "module"), [pytest.param(*m, id=m[1]) for m in modules()])
def test_no_arrow_points_upwards(path, module):
    assert faults(path.read_text(encoding="utf-8"), module, path.name == "__init__.py") == []


def test_every_package_is_looked_at():
    seen = {layer(module) for _, module in modules()}
    assert {"ground", "kernels", "truth", "aiding", "judging", "io", "report", "studies"} <= seen


@pytest.mark.parametrize(
    ("module", "line", "message"),
    [
        ("schuler.ground.x", "import scipy", "numpy alone"),
        ("schuler.ground.x", "from numba import njit", "numpy alone"),
        ("schuler.ground.x", "from schuler.kernels.earth import radii", "points upwards"),
        ("schuler.kernels.x", "from ..truth import missions", "points upwards"),
        ("schuler.truth.x", "def f():\n    import schuler.aiding.solution", "points upwards"),
        ("schuler.truth.x", "def f():\n    import schuler.io.tables", "only"),
        ("schuler.aiding.x", "from schuler import report", "only"),
        ("schuler.judging.x", "from schuler.io import tables", "only"),
        ("schuler.io.x", "from schuler.report import page", "only"),
        ("schuler.report.x", "from schuler.studies import run", "points upwards"),
        ("schuler.studies.x", "from schuler import cli", "points upwards"),
        ("schuler.judging.x", "from schuler.published import ledger", "only"),
        ("schuler.aiding.x", "from schuler.calibration import allan", "points upwards"),
        ("schuler.truth.x", "import schuler", "whole package"),
        ("schuler.truth.x", "text = open('a').read()", "never touches a file"),
        ("schuler.aiding.x", "import numpy as np\nnp.loadtxt('a')", "never touches a file"),
        ("schuler.newroom.x", "", "no place"),
    ],
)
def test_the_guard_sees_what_it_should(module, line, message):
    assert any(message in fault for fault in faults(line, module))


@pytest.mark.parametrize(
    ("module", "line"),
    [
        (
            "schuler.ground.x",
            "import math\nfrom datetime import UTC\nimport numpy as np\nfrom .errors import InputError",
        ),
        ("schuler.published.x", "from schuler.io import tables\nfrom schuler.judging import errors"),
        ("schuler.studies.x", "from schuler.report.page import page\nfrom schuler import __version__, io"),
        ("schuler.cli", "from schuler import studies, published, io"),
        ("schuler.io.x", "text = open('a').read()"),
    ],
)
def test_the_guard_lets_the_rest_pass(module, line):
    assert faults(line, module) == []
