"""Schuler: design, run and judge inertial navigation."""

__version__ = "0.1.0"
