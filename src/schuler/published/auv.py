"""The AUV paper's ledger: every figure of its equations, sea trials and Table 3, and of a recomputation of them.

Source: Alizadeh, Nourmohammadi, Sabet and Zarrini (2017), "Design and implementation of AHRS/GPS/DR navigation
algorithm applied to long-range AUVs with high underwater durability" (in Persian). The scan it is read from adds slips
of its own, which the reasons name.
"""

from __future__ import annotations

from schuler.published import auv_equations, auv_field, auv_policies
from schuler.published.ledger import Progress, Row

TITLE = "AHRS/GPS/DR navigation of a long-range AUV (Alizadeh and others, 2017)"


def rows(progress: Progress | None = None, runs: int = 20, seed: int = 0) -> list[Row]:
    """All rows, those of one place together. runs : simulated runs of each ensemble; more make the verdicts sharper."""
    tell = progress or (lambda sentence: None)
    found = auv_policies.simulate_all(runs, seed, tell)
    tell("equations and Table 3")
    answer = [
        *auv_equations.errata(),
        *auv_policies.zero_innovation(found),
        *auv_field.times(),
        *auv_policies.claims(found),
        *auv_field.table_3(),
        *auv_equations.constants(),
        *auv_equations.one_epoch(),
        *auv_field.currents(),
        *auv_policies.in_currents(found),
        *auv_field.bound(),
        *auv_policies.freeze(found),
        *auv_policies.policies(found),
    ]
    order = {where: i for i, where in reversed(list(enumerate(row.where for row in answer)))}
    return sorted(answer, key=lambda row: (row.where.startswith("recomputation"), order[row.where]))
