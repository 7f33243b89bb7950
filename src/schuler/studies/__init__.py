"""The study file and running it: the only place where the pieces meet."""
