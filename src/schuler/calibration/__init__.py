"""From recordings to corrected sensors."""
