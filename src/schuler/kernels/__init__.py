"""Compiled loops (numba): scalars and float64 arrays in and out; no objects, no files, no exceptions."""
