"""Errors that reach a user: one clear sentence (what came, what was meant, what to type) and an exit status."""

from __future__ import annotations

from collections.abc import Sequence


class SchulerError(Exception):
    """The work cannot be done; the message is meant for the user's terminal. Exit status 1."""

    exit_status = 1


class InputError(SchulerError):
    """A table or recording cannot be used as it is."""


class StudyError(SchulerError):
    """Faults of a study file or of the command line, all reported together. Exit status 2."""

    exit_status = 2

    def __init__(self, faults: str | Sequence[str]) -> None:
        self.faults = [faults] if isinstance(faults, str) else list(faults)
        super().__init__("\n".join(self.faults))
