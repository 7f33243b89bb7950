"""Units, Earth, frames, time bases and table schemas: numpy only, no files, no navigation."""
