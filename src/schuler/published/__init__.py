"""One module a source: its figures, ours, the verdict."""
