"""A wrong arm of the antenna that other states have taken in: found by a second run that estimates the arm too."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from schuler.aiding.solution import Navigation

if TYPE_CHECKING:
    from schuler.aiding.aided_settings import AidedSettings

SUSPECT = 2.0  # mean NIS of fixes or GNSS velocities from which a second look is taken
BETTER = 0.6  # the NIS must fall to this share of it
PRIOR_M = 2.0
LEAST_M = 0.2


def second_look(
    navigation: Navigation, settings: AidedSettings, run: Callable[[AidedSettings], Navigation]
) -> list[str]:
    """A sentence where an estimated arm explains the innovations that the typed one does not.

    The residuals themselves may say nothing: a turn's share of a wrong arm goes into delays, mounting and biases.
    """
    before = _nis(navigation)
    if before < SUSPECT or settings.estimate is None or "antenna_lever" in settings.estimate:
        return []
    looked = run(replace(settings, estimate=(*settings.estimate, "antenna_lever"), antenna_std=PRIOR_M, smoother=False))
    after = _nis(looked)
    states = [looked.states.get(f"antenna_lever_{axis}") for axis in "xyz"]
    if after > BETTER * before or any(s is None for s in states):
        return []
    arm = np.array([s.value[-1] for s in states if s is not None])
    std = np.array([s.std[-1] for s in states if s is not None])
    off = arm - np.asarray(settings.antenna)
    told = (np.abs(off) > 4.0 * std) & (np.abs(off) > LEAST_M)
    if not told.any():
        return []
    typed = ", ".join(f"{x:.2f}" for x in np.where(told, arm, settings.antenna))
    wrong = ", ".join(f"{axis} by {d:+.2f} m" for axis, d, t in zip("xyz", off, told, strict=True) if t)
    return [
        f"[mounting] antenna_frd_m looks wrong, {wrong}: a run that estimates it brings the NIS of GNSS from "
        f'{before:.1f} to {after:.1f}; type antenna_frd_m = [{typed}], or estimate = [..., "antenna_lever"]'
    ]


def _nis(navigation: Navigation) -> float:
    """Mean NIS per degree of freedom of fixes and GNSS velocities, the refused with the weight of the bound."""
    total, dof = 0.0, 0
    for kind in ("gnss_position", "gnss_velocity"):
        i = navigation.innovations.get(kind)
        if i is not None:
            total += float(np.minimum(i.nis, 100.0).sum())
            dof += 2 * len(i.nis)
    return total / dof if dof else 0.0
