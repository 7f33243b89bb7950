"""Navigation from inertia alone."""
