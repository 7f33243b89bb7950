"""Ledger rows of the AUV paper's sea trials: Table 3, the times, the bias, currents that close the table, the bound."""

from __future__ import annotations

from functools import partial
from math import degrees, hypot, radians, sin, sqrt

from schuler.published.auv_equations import SOURCE
from schuler.published.auv_figures import (
    TESTS,
    bias_bound,
    closing_current,
    heading_bound,
    latitude_for,
    rounding_range,
    table_error,
)
from schuler.published.ledger import CORRECTED, NOT_REPRODUCIBLE, REPRODUCED, Row, judge

NORMAL_95 = 1.959963984540054  # two-sided
RAMP_DEG = {1: -5.0, 2: 3.0}  # the published end errors of heading, with signs of the recomputation (assumed)


def times() -> list[Row]:
    """Times, the share below the surface and the bias, as the text and Table 3 print them."""
    rows: list[Row] = []
    for test, printed in ((TESTS[1], "84"), (TESTS[2], "89")):
        share = 100.0 * test.dive_s / (test.surface_s + test.dive_s)
        rows.append(
            judge(
                SOURCE,
                f"section 5, test {test.number}",
                "share of the time below the surface",
                "%",
                printed,
                share,
                f"{test.surface_s:g} s on the surface and {test.dive_s:g} s below",
            )
        )
    for test in TESTS.values():
        ratio = test.table_outage_s / test.dive_s
        rows.append(
            Row(
                SOURCE,
                f"Table 3, test {test.number}",
                "time without GPS",
                "s",
                test.table_outage_s,
                test.dive_s,
                NOT_REPRODUCIBLE,
                f"the table says {ratio:.3f} times what the text says; text and shares of time agree with each other; "
                "a table that counts samples at 2 Hz would explain it, nothing in the paper decides",
            )
        )
    one, two = TESTS[1].bias_deg_per_s, TESTS[2].bias_deg_per_s
    rows.append(
        Row(
            SOURCE,
            "section 5, test 2",
            "estimated bias of the z gyro",
            "deg/s",
            two,
            None,
            NOT_REPRODUCIBLE,
            f"{abs(two / one):.1f} times that of test 1 and of the other sign on the same sensor, {two / 0.2:.1f} "
            "times the 0.2 deg/s of Table 1: most likely -0.052, sign and zero lost; the recording is not published",
        )
    )
    return rows


def table_3() -> list[Row]:
    """The position errors of Table 3 from its own coordinates."""
    rows: list[Row] = []
    for test in TESTS.values():
        north, east, horizontal = table_error(test)
        least, most = rounding_range(test)
        inside = least <= test.published_error_m <= most
        reason = (
            f"estimate minus truth {north:+.1f} m north, {east:+.1f} m east; "
            f"coordinates round to {least:.0f} .. {most:.0f} m"
        )
        if not inside:
            wide = rounding_range(test, 0.5e-3)
            reason += (
                f": {test.published_error_m:g} m is outside and equals the east part alone. A true latitude rounded to "
                f"the three decimals printed would allow {wide[0]:.0f} .. {wide[1]:.0f} m"
            )
        rows.append(
            Row(
                SOURCE,
                f"Table 3, test {test.number}",
                "horizontal position error",
                "m",
                test.published_error_m,
                horizontal,
                REPRODUCED if inside else CORRECTED,
                reason,
            )
        )
    one = TESTS[1]
    rows.append(
        Row(
            SOURCE,
            "Table 3, test 1",
            "true latitude",
            "deg",
            one.true_deg[0],
            latitude_for(one, one.published_error_m),
            CORRECTED,
            "printed with three decimals where all others have four: a digit is missing. This latitude gives the "
            f"published 340 m; rounded to 36.7299 it gives {table_error(one, 36.7299)[2]:.1f} m",
        )
    )
    figure = partial(judge, SOURCE, "recomputation, Table 3")
    second = {
        1: ("122.07", "-339.44", "360.72", "348.6", "373.0", "0.694", "0.347"),
        2: ("-55.49", "-357.29", "361.57", "351.2", "372.2", "0.691", "0.346"),
    }
    for number, (n, e, h, low, high, slow, slower) in second.items():
        test = TESTS[number]
        north, east, horizontal = table_error(test)
        least, most = rounding_range(test)
        metre, edge = 0.02, 0.1  # the latitude at which degrees become metres is not stated to this digit
        rows += [
            figure(f"test {number}, north", "m", n, north, "estimate minus truth", within=metre),
            figure(f"test {number}, east", "m", e, east, "estimate minus truth", within=metre),
            figure(f"test {number}, horizontal", "m", h, horizontal, "estimate minus truth", within=metre),
            figure(
                f"test {number}, least by rounding", "m", low, least, "half a unit of the fourth decimal", within=edge
            ),
            figure(
                f"test {number}, most by rounding", "m", high, most, "half a unit of the fourth decimal", within=edge
            ),
            figure(f"test {number}, mean drift, text", "m/s", slow, horizontal / test.dive_s, "over 520 / 523 s"),
            figure(
                f"test {number}, mean drift, table",
                "m/s",
                slower,
                horizontal / test.table_outage_s,
                "over 1040 / 1045 s",
            ),
        ]
    rows.append(
        figure("test 1, horizontal with 36.7299", "m", "340.2", table_error(one, 36.7299)[2], "the missing digit")
    )
    length = 2.5 * one.dive_s
    rows += [
        figure("2 % of the log over the dive", "m", "26", 0.02 * length, "1300 m at 2.5 m/s: far from 340 m"),
        figure(
            "heading ramp to 5 deg over the dive, cross track", "m", "57", length * sin(radians(5.0)) / 2.0,
            "1300 m at 2.5 m/s: far from 340 m",
        ),
    ]  # fmt: skip
    return rows


def currents() -> list[Row]:
    """Constant currents that would close Table 3, for both readings of its times."""
    figure = partial(judge, SOURCE, "recomputation, currents that close Table 3")
    why = "straight dive east at 2.5 m/s, surface leg as fast, heading from the course there, linear ramp: an example"
    printed = {
        (1, 520.0): ("-0.5929", "0.6262"),
        (1, 1040.0): ("-0.0721", "0.3252"),
        (2, 523.0): ("0.1888", "0.6815"),
        (2, 1045.0): ("-0.1027", "0.3368"),
    }
    rows: list[Row] = []
    for (number, duration), (north, east) in printed.items():
        test, ramp = TESTS[number], radians(RAMP_DEG[number])
        c = closing_current(test, duration, ramp)
        rows += [
            figure(f"test {number}, {duration:g} s, north", "m/s", north, c[0], why, within=1e-4),
            figure(f"test {number}, {duration:g} s, east", "m/s", east, c[1], why, within=1e-4),
        ]
    slow = closing_current(TESTS[1], 520.0, radians(RAMP_DEG[1]), surface_speed=2.0)
    caution = (
        f"with a surface leg at 2.0 m/s the first current would be {slow[0]:+.2f}, {slow[1]:+.2f} m/s: "
        "the closure is an example, no finding"
    )
    sizes = {(1, 520.0): "0.86", (2, 523.0): "0.71", (1, 1040.0): "0.33", (2, 1045.0): "0.35"}
    for (number, duration), text in sizes.items():
        c = closing_current(TESTS[number], duration, radians(RAMP_DEG[number]))
        rows.append(figure(f"test {number}, {duration:g} s, size", "m/s", text, hypot(c[0], c[1]), caution))
    base = closing_current(TESTS[1], 520.0, radians(RAMP_DEG[1]))
    for scale, text in ((-0.02, "-0.05"), (0.02, "0.05")):
        c = closing_current(TESTS[1], 520.0, radians(RAMP_DEG[1]), scale)
        rows.append(
            figure(f"east, change with a log error of {scale:+.0%}", "m/s", text, c[1] - base[1], "test 1, 520 s")
        )
    return rows


def bound() -> list[Row]:
    """Heading after an outage at best: a straight line through the courses of the surface leg."""
    figure = partial(judge, SOURCE, "recomputation, information bound")
    rows: list[Row] = []
    printed = {
        (100, 520.0, 1.5): ("0.00520", "2.966", "5.81"),
        (62, 523.0, 1.5): ("0.01065", "5.900", "11.6"),
        (100, 520.0, 3.0): ("0.01039", "5.932", "11.6"),
    }
    for (fixes, outage, sigma), (bias, heading, most) in printed.items():
        case = f"{fixes} fixes of {sigma:g} deg, {outage:g} s"
        s = degrees(heading_bound(fixes, outage, radians(sigma)))
        rows += [
            figure(
                f"bias sigma, {case}", "deg/s", bias, degrees(bias_bound(fixes, radians(sigma))), "straight-line fit"
            ),
            figure(f"heading sigma, {case}", "deg", heading, s, "straight-line fit"),
            figure(f"heading 95 %, {case}", "deg", most, NORMAL_95 * s, "straight-line fit"),
        ]
    drift = radians(0.005)
    for number, text in ((1, "3.22"), (2, "5.83")):
        test = TESTS[number]
        s = degrees(heading_bound(int(test.surface_s), test.dive_s, 0.05 / 2.0, drift))
        # Gyro noise q makes the true heading wander: a slope over N seconds of a random walk has variance 6 q^2/(5 N).
        n, walk = test.surface_s, 0.03
        noise = walk * sqrt(6.0 / (5.0 * n) * (test.dive_s + n / 2.0) ** 2 + test.dive_s)
        rows.append(
            figure(
                f"heading sigma, test {number}, white course 0.05/2 rad and drift",
                "deg",
                text,
                s,
                f"gyro noise of 0.03 deg/s/sqrt(Hz) is not in it; with it about {hypot(s, noise):.1f} deg",
                within=0.02,
            )
        )
    for number, text in ((1, "0.00962"), (2, "0.00574")):
        test = TESTS[number]
        rows.append(
            figure(
                f"mean residual bias behind the published heading error, test {number}",
                "deg/s",
                text,
                test.heading_error_deg / test.dive_s,
                "end error over the length of the outage: right at this bound",
            )
        )
    return rows
