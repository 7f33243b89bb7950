"""`schuler calibrate --design`: the best positions for a table, as a plan that the laboratory can follow."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from schuler.ground.errors import StudyError
from schuler.ground.tables import Table
from schuler.ground.units import DEG
from schuler.studies.calibration import AXES, made_by, table_model
from schuler.studies.run import Progress, silent

if TYPE_CHECKING:
    from schuler.calibration.plan_design import Design, TableModel
    from schuler.studies.calibration_plan import Plan


@dataclass
class Designed:
    """The best plan of k positions, what one more gains, and the thesis's five beside them."""

    plan: Plan
    design: Design
    more: Design
    thesis: Design
    curve: list[tuple[int, float, float]]
    table: TableModel

    def positions(self) -> Table:
        from schuler.truth.turntable import positions_table

        t = self.plan.table
        return positions_table(
            [(float(g) / DEG, float(b) / DEG) for g, b in self.design.settings],
            rate_deg_per_s=t.rate_deg_per_s,
            still_s=t.still_s,
            spin_s=t.spin_s,
            stops=t.stops,
            both_ways=t.both_ways,
            move_s=t.move_s,
        )

    def write(self, out: Path, progress: Progress = silent) -> Path:
        """design.csv, design.json and report.html."""
        from schuler.io.results import json_text, result_folder
        from schuler.io.tables import write_table
        from schuler.report.calibration import design_page

        progress("drawing the page")
        page = design_page(self)
        with result_folder(out) as folder:
            write_table(folder / "design.csv", self.positions())
            (folder / "calibration.json").write_text(json_text(self.told()), encoding="utf-8", newline="\n")
            (folder / "report.html").write_text(page, encoding="utf-8", newline="\n")
        return out

    def told(self) -> dict[str, Any]:
        def of(d: Design) -> dict[str, Any]:
            return {
                "positions_deg": (d.settings / DEG).tolist(),
                "std_mm": (1e3 * d.std).tolist(),
                "rms_mm": 1e3 * d.score,
                "condition": d.condition.tolist(),
                "table_time_s": d.time,
            }

        return {
            "plan": self.plan.plan.name,
            "made_by": made_by(self.plan),
            "design": of(self.design),
            "one_more": of(self.more),
            "thesis": of(self.thesis),
            "curve": [{"positions": k, "rms_mm": 1e3 * s, "table_time_s": t} for k, s, t in self.curve],
        }


def design_plan(plan: Plan, k: int, progress: Progress = silent) -> Designed:
    """The best k positions for the plan's table."""
    from schuler.calibration import plan_design
    from schuler.truth.turntable import THESIS_PLAN

    if plan.plan.kind != "turntable":
        raise StudyError('--design needs [plan] kind = "turntable"; a multiposition plan has no table to set')
    if not 1 <= k <= 60:
        raise StudyError(f"--design {k}: type how many positions, 1 to 60")
    table = table_model(plan)
    progress("searching positions")
    best = plan_design.design(k, table)
    curve = []
    for n in range(max(2, k - 2), min(k + 4, 61)):
        d = best if n == k else plan_design.design(n, table)
        curve.append((n, d.score, d.time))
    more = plan_design.one_more(best.settings, table)
    thesis = plan_design.judge(np.deg2rad(np.array(THESIS_PLAN)), table)
    return Designed(plan, best, more, thesis, curve, table)


def design_lines(d: Designed) -> list[str]:
    """What the terminal says."""
    out = [f"best {len(d.design.settings)} positions (gamma, beta in deg), {d.design.time / 60:.0f} min of table time:"]
    out.append("  " + "; ".join(f"{g / DEG:.0f}, {b / DEG:.0f}" for g, b in d.design.settings))
    hidden = np.isinf(d.design.std)
    if hidden.any():
        names = [f"accel_{AXES[i]}_lever_{AXES[j]}" for i, j in np.argwhere(hidden)]
        out.append(f"  not observable with so few: {', '.join(names)}")
    else:
        out.append(
            f"  sigma of a component from noise: {1e3 * d.design.score:.3g} mm rms, worst "
            f"{1e3 * d.design.std.max():.3g} mm"
        )
    if np.isfinite(d.more.score):
        g, b = d.more.settings[-1] if len(d.more.settings) else (0.0, 0.0)
        extra = [s for s in d.more.settings.tolist() if s not in d.design.settings.tolist()] or [
            d.more.settings[-1].tolist()
        ]
        g, b = extra[0]
        gain = "" if hidden.any() else f" ({100 * (1 - d.more.score / d.design.score):.0f} % less)"
        out.append(f"  one more ({g / DEG:.0f}, {b / DEG:.0f}) would give {1e3 * d.more.score:.3g} mm rms{gain}")
    same = d.design.score * np.sqrt(d.design.time / d.thesis.time)
    if np.isfinite(same):
        out.append(
            f"  the thesis's five positions give {1e3 * d.thesis.score:.3g} mm rms; these, in the same table "
            f"time, {1e3 * same:.3g}"
        )
    return out
