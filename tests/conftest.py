"""Fixtures shared by all tests."""

from pathlib import Path

import pytest

DATA = Path(__file__).resolve().parents[2] / "shared" / "data"


@pytest.fixture(scope="session")
def data_folder() -> Path:
    """The folder of real recordings beside the checkout; tests that need it are skipped where it is absent."""
    if not DATA.is_dir():
        pytest.skip(f"no recordings: {DATA} does not exist")
    return DATA


def pytest_configure(config: pytest.Config) -> None:
    """Once, before any test process runs: no kernel is called in the form that an older source gave it."""
    if not hasattr(config, "workerinput"):
        from schuler.studies.cache import drop_stale

        drop_stale()
