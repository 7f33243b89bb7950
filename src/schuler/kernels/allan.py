"""Sums of squared differences of phase for Allan-type deviations, many averaging times in one pass.

The phase is walked in blocks that stay in the cache while all averaging times use them; eight partial sums a block keep
the additions independent, so that they are done side by side without giving up the order of floating-point sums.
"""

from __future__ import annotations

from numba import njit

BLOCK = 4096


@njit(cache=True, error_model="numpy")
def second_differences(x, m, out):
    """out[k] = sum over i of (x[i + 2 m[k]] - 2 x[i + m[k]] + x[i])^2, every i for which the three exist."""
    n = x.size
    out[:] = 0.0
    for b in range(0, n, BLOCK):
        for k in range(m.size):
            step = m[k]
            count = min(b + BLOCK, n - 2 * step) - b
            if count <= 0:
                continue
            u = x[b : b + count]
            v = x[b + step : b + step + count]
            w = x[b + 2 * step : b + 2 * step + count]
            s0 = s1 = s2 = s3 = s4 = s5 = s6 = s7 = 0.0
            for q in range(count // 8):
                i = 8 * q
                d0 = u[i] - 2.0 * v[i] + w[i]
                d1 = u[i + 1] - 2.0 * v[i + 1] + w[i + 1]
                d2 = u[i + 2] - 2.0 * v[i + 2] + w[i + 2]
                d3 = u[i + 3] - 2.0 * v[i + 3] + w[i + 3]
                d4 = u[i + 4] - 2.0 * v[i + 4] + w[i + 4]
                d5 = u[i + 5] - 2.0 * v[i + 5] + w[i + 5]
                d6 = u[i + 6] - 2.0 * v[i + 6] + w[i + 6]
                d7 = u[i + 7] - 2.0 * v[i + 7] + w[i + 7]
                s0 += d0 * d0
                s1 += d1 * d1
                s2 += d2 * d2
                s3 += d3 * d3
                s4 += d4 * d4
                s5 += d5 * d5
                s6 += d6 * d6
                s7 += d7 * d7
            for i in range(8 * (count // 8), count):
                d = u[i] - 2.0 * v[i] + w[i]
                s0 += d * d
            out[k] += ((s0 + s1) + (s2 + s3)) + ((s4 + s5) + (s6 + s7))


@njit(cache=True, error_model="numpy")
def third_differences(x, m, out):
    """out[k] = sum over i of (x[i + 3 m[k]] - 3 x[i + 2 m[k]] + 3 x[i + m[k]] - x[i])^2, every i for which they exist.

    Of a phase: the Hadamard deviation. Of the running sum of a phase: the modified Allan deviation.
    """
    n = x.size
    out[:] = 0.0
    for b in range(0, n, BLOCK):
        for k in range(m.size):
            step = m[k]
            count = min(b + BLOCK, n - 3 * step) - b
            if count <= 0:
                continue
            u = x[b : b + count]
            v = x[b + step : b + step + count]
            w = x[b + 2 * step : b + 2 * step + count]
            z = x[b + 3 * step : b + 3 * step + count]
            s0 = s1 = s2 = s3 = 0.0
            for q in range(count // 4):
                i = 4 * q
                d0 = (z[i] - u[i]) - 3.0 * (w[i] - v[i])
                d1 = (z[i + 1] - u[i + 1]) - 3.0 * (w[i + 1] - v[i + 1])
                d2 = (z[i + 2] - u[i + 2]) - 3.0 * (w[i + 2] - v[i + 2])
                d3 = (z[i + 3] - u[i + 3]) - 3.0 * (w[i + 3] - v[i + 3])
                s0 += d0 * d0
                s1 += d1 * d1
                s2 += d2 * d2
                s3 += d3 * d3
            for i in range(4 * (count // 4), count):
                d = (z[i] - u[i]) - 3.0 * (w[i] - v[i])
                s0 += d * d
            out[k] += (s0 + s1) + (s2 + s3)
