"""Angular vibration: roll, pitch and heading as sums of sines over a band, with rates and accelerations in closed
form."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from schuler.ground.errors import InputError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Vibration:
    """amplitude (3, k) rad, frequency (3, k) Hz, phase (3, k) rad of the sines of roll, pitch, heading."""

    amplitude: Array
    frequency: Array
    phase: Array

    @classmethod
    def band(cls, low_hz: float, high_hz: float, rms: ArrayLike, *, tones: int = 70, seed: int = 1) -> Vibration:
        """Flat between two frequencies: one tone at a random place of each of `tones` equal parts, random phases.

        rms (3,) or one number, rad, of each angle.
        """
        if not 0.0 < low_hz < high_hz or tones < 1:
            raise InputError(f"a band from {low_hz:g} to {high_hz:g} Hz with {tones} tones is not possible")
        rng = np.random.default_rng(seed)
        edges = np.linspace(low_hz, high_hz, tones + 1)[:-1]
        f = edges + (high_hz - low_hz) / tones * rng.random((3, tones))
        a = np.broadcast_to(np.asarray(rms, dtype=np.float64), (3,))[:, None] * np.sqrt(2.0 / tones)
        return cls(np.broadcast_to(a, f.shape).copy(), f, 2.0 * np.pi * rng.random((3, tones)))

    @classmethod
    def tone(cls, frequency_hz: float, amplitude: ArrayLike, phase: ArrayLike = 0.0) -> Vibration:
        """One frequency; amplitude and phase (3,) rad of roll, pitch, heading."""
        a = np.broadcast_to(np.asarray(amplitude, dtype=np.float64), (3,))[:, None].copy()
        p = np.broadcast_to(np.asarray(phase, dtype=np.float64), (3,))[:, None].copy()
        return cls(a, np.full((3, 1), float(frequency_hz)), p)

    def angles(self, time: ArrayLike) -> tuple[Array, Array, Array]:
        """Roll, pitch, heading (n, 3) rad and their first and second derivatives."""
        t = np.asarray(time, dtype=np.float64)
        out = np.zeros((3, t.size, 3))
        for axis in range(3):
            for a, f, p in zip(self.amplitude[axis], self.frequency[axis], self.phase[axis], strict=True):
                if a == 0.0:
                    continue
                w = 2.0 * np.pi * f
                s, c = np.sin(w * t + p), np.cos(w * t + p)
                out[0, :, axis] += a * s
                out[1, :, axis] += a * w * c
                out[2, :, axis] -= a * w * w * s
        return out[0], out[1], out[2]

    def motion(self, time: ArrayLike) -> tuple[Array, Array, Array]:
        """C_nb (n, 3, 3), rate w (n, 3) rad/s and angular acceleration wd (n, 3) rad/s^2 against n, in b."""
        x, d, dd = self.angles(time)
        sr, cr, sp, cp = np.sin(x[:, 0]), np.cos(x[:, 0]), np.sin(x[:, 1]), np.cos(x[:, 1])
        sh, ch = np.sin(x[:, 2]), np.cos(x[:, 2])
        C = np.empty((len(x), 3, 3))
        C[:, 0, 0], C[:, 0, 1], C[:, 0, 2] = cp * ch, sr * sp * ch - cr * sh, cr * sp * ch + sr * sh
        C[:, 1, 0], C[:, 1, 1], C[:, 1, 2] = cp * sh, sr * sp * sh + cr * ch, cr * sp * sh - sr * ch
        C[:, 2, 0], C[:, 2, 1], C[:, 2, 2] = -sp, sr * cp, cr * cp
        rd, pd, hd = d.T
        w = np.column_stack([rd - hd * sp, pd * cr + hd * sr * cp, -pd * sr + hd * cr * cp])
        wd = np.column_stack(
            [
                dd[:, 0] - dd[:, 2] * sp - hd * pd * cp,
                dd[:, 1] * cr - pd * rd * sr + dd[:, 2] * sr * cp + hd * (rd * cr * cp - pd * sr * sp),
                -dd[:, 1] * sr - pd * rd * cr + dd[:, 2] * cr * cp - hd * (rd * sr * cp + pd * cr * sp),
            ]
        )
        return C, w, wd

    @property
    def rate_covariance(self) -> Array:
        """(3, 3) rad^2/s^2: mean of w w^T for small angles; axes vibrate independently unless they share
        frequencies."""
        w = 2.0 * np.pi * self.frequency * self.amplitude
        S = np.diag(0.5 * np.sum(w**2, axis=1))
        for i in range(3):
            for j in range(i):
                same = self.frequency[i][:, None] == self.frequency[j][None, :]
                turn = np.cos(self.phase[i][:, None] - self.phase[j][None, :])
                S[i, j] = S[j, i] = 0.5 * float(np.sum(same * turn * w[i][:, None] * w[j][None, :]))
        return S
