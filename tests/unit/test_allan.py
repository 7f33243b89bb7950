"""Allan deviations against a slow twin and a second library; fitted noise terms."""

import numpy as np
import pytest

from schuler.calibration import allan, allan_fit
from schuler.ground.errors import InputError

RATE = 50.0


def white_and_walk(n, seed=1, white=1.0, walk=0.0):
    rng = np.random.default_rng(seed)
    return white * rng.standard_normal(n) + walk * np.cumsum(rng.standard_normal(n))


def twin(y, m, kind):
    x = np.concatenate([[0.0], np.cumsum(y)])
    if kind == "oadev":
        d = x[2 * m :] - 2 * x[m:-m] + x[: -2 * m]
        return np.sqrt(np.mean(d**2) / 2) / m
    if kind == "hdev":
        d = x[3 * m :] - 3 * x[2 * m : -m] + 3 * x[m : -2 * m] - x[: -3 * m]
        return np.sqrt(np.mean(d**2) / 6) / m
    n = x.size - 3 * m + 1
    d = [np.sum(x[j + 2 * m : j + 3 * m] - 2 * x[j + m : j + 2 * m] + x[j : j + m]) for j in range(n)]
    return np.sqrt(np.mean(np.square(d)) / 2) / m**2


@pytest.mark.parametrize("kind", allan.KINDS)
def test_kernels_are_their_slow_twins(kind):
    y = white_and_walk(2003, walk=0.05)
    dev = allan.deviation(y, RATE, tau=[0.02, 0.06, 0.5, 4.0], kind=kind)
    assert dev.m.tolist() == [1, 3, 25, 200]
    assert dev.dev == pytest.approx([twin(y, int(m), kind) for m in dev.m], rel=1e-9)


@pytest.mark.parametrize(("kind", "theirs"), [("oadev", "oadev"), ("mdev", "mdev"), ("hdev", "ohdev")])
def test_deviations_are_a_second_library_s(kind, theirs):
    judge = pytest.importorskip("allantools", reason="allantools is not installed: pip install allantools")
    y = white_and_walk(60_000, walk=0.02)
    dev = allan.deviation(y, RATE, kind=kind)
    tau, values, _, _ = getattr(judge, theirs)(y, rate=RATE, data_type="freq", taus=dev.tau)
    assert tau == pytest.approx(dev.tau)
    assert dev.dev == pytest.approx(values, rel=1e-6)


@pytest.mark.parametrize("alpha", [0, -1, -2])
@pytest.mark.parametrize(("kind", "d", "modified"), [("oadev", 2, False), ("mdev", 2, True), ("hdev", 3, False)])
def test_degrees_of_freedom_are_a_second_library_s(alpha, kind, d, modified):
    judge = pytest.importorskip("allantools", reason="allantools is not installed: pip install allantools")
    for m in (1, 7, 100, 5000):
        theirs = judge.edf_greenhall(alpha, d, m, 100_001, overlapping=True, modified=modified)
        assert allan.degrees_of_freedom(100_001, m, alpha, kind) == pytest.approx(theirs, rel=0.01)


def test_the_interval_holds_the_truth_as_often_as_it_says():
    inside = []
    for seed in range(150):
        dev = allan.deviation(white_and_walk(3000, seed), 1.0, tau=[3.0, 30.0, 150.0])
        truth = 1.0 / np.sqrt(dev.tau)
        inside.append((dev.low < truth) & (truth < dev.high))
    share = np.mean(inside, axis=0)
    assert np.all(np.abs(share - 0.683) < 4.0 * np.sqrt(0.683 * 0.317 / 150))


def test_default_times():
    m = allan.default_samples(1_000_000)
    assert m[0] == 2 and m[-1] == 100_000
    assert len(m) == pytest.approx(10 * np.log10(50_000), abs=4)


def test_impossible_times_are_refused():
    y = white_and_walk(1000)
    with pytest.raises(InputError, match="shorter than a sample"):
        allan.deviation(y, 100.0, tau=[0.001])
    with pytest.raises(InputError, match="needs more than 12 s"):
        allan.deviation(y, 100.0, tau=[6.0])
    with pytest.raises(InputError, match="without gaps"):
        allan.deviation(np.where(np.arange(1000) == 5, np.nan, y), 100.0)


def test_columns_are_the_integrals_of_their_spectra():
    from scipy.integrate import quad

    def gain(x):
        return 2 * np.sin(x) ** 4 / x**2

    tau, T = 3.0, 1.4
    white = 2 * quad(lambda f: gain(np.pi * f * tau), 1e-9, 400, limit=4000)[0]
    walk = 2 * quad(lambda f: gain(np.pi * f * tau) / (2 * np.pi * f) ** 2, 1e-9, 60, limit=4000)[0]
    markov = 2 * quad(lambda f: gain(np.pi * f * tau) * 2 * T / (1 + (2 * np.pi * f * T) ** 2), 1e-9, 60, limit=4000)[0]
    H = allan_fit.columns([tau])[0]
    assert H[1] == pytest.approx(white, rel=2e-3)
    assert H[3] == pytest.approx(walk, rel=1e-4)
    assert allan_fit.gauss_markov_column([tau], T)[0] == pytest.approx(markov, rel=1e-3)
    assert allan_fit.gauss_markov_column([1e-4], 1.0)[0] == pytest.approx(2e-4 / 3, rel=1e-3)


@pytest.mark.slow
def test_white_noise_and_rate_walk_come_back():
    N, K = 0.02, 6e-4
    pulls = []
    for seed in range(12):
        y = white_and_walk(200_000, seed, N * np.sqrt(RATE), K / np.sqrt(RATE))
        _, fit = allan_fit.fit(y, RATE)
        term = fit.terms["random_walk"]
        assert term.value == pytest.approx(N, rel=0.03)
        assert term.low < term.value < term.high
        if "rate_walk" in fit.terms:
            walk = fit.terms["rate_walk"]
            pulls.append((walk.value**2 - K**2) / (0.5 * (walk.high**2 - walk.low**2)))
    assert len(pulls) >= 8  # else flicker or correlated noise explain it as well
    assert np.abs(np.mean(pulls)) < 1.2
    assert 0.3 < np.sqrt(np.mean(np.square(pulls))) < 2.0


def test_correlated_noise_is_found_with_its_time_constant():
    from scipy.signal import lfilter

    rng = np.random.default_rng(5)
    sigma, T, n = 0.05, 4.0, 400_000
    phi = np.exp(-1.0 / (RATE * T))
    markov = sigma * lfilter([np.sqrt(1 - phi**2)], [1.0, -phi], rng.standard_normal(n))
    _, fit = allan_fit.fit(markov + 0.02 * np.sqrt(RATE) * rng.standard_normal(n), RATE)
    assert fit.correlated.value == pytest.approx(sigma, rel=0.1)
    assert fit.correlated_tau.value == pytest.approx(T, rel=0.3)
    assert fit.floor is None or fit.floor_tau > 0


def test_terms_that_are_not_there_are_not_seen():
    _, fit = allan_fit.fit(white_and_walk(100_000, 7), RATE)
    assert set(fit.terms) == {"random_walk"}
    assert fit.correlated is None
    assert fit.floor is None and fit.bias_instability is None
    _, dead = allan_fit.fit(np.zeros(1000), RATE)
    assert dead.terms == {}


# ---- a real recording ----

PUBLISHED = {"x": (2.44, 147.7, 48.3), "y": (2.56, 155.2, 54.5), "z": (2.33, 139.6, 46.6)}


@pytest.mark.slow
@pytest.mark.data
@pytest.mark.parametrize("axis", "xyz")
def test_static_adis16405(data_folder, axis):
    data = np.load(data_folder / "static_adis16405" / "adis16405_imu1.npz")
    y = data["gyro_counts"][:, "xyz".index(axis)] * float(data["gyro_lsb_dps"]) * 3600.0  # deg/h
    arw, at_1, at_10 = PUBLISHED[axis]
    dev = allan.deviation(y, 100.0, tau=[1.0, 10.0])
    assert dev.dev == pytest.approx([at_1, at_10], rel=0.01)
    _, fit = allan_fit.fit(y, 100.0)
    term = fit.terms["random_walk"]
    assert term.value / 60.0 == pytest.approx(arw, rel=0.03)
    assert term.high - term.low < 0.05 * term.value
    instability = fit.correlated.value if fit.correlated else fit.bias_instability.value
    assert 18.0 < instability < 60.0


@pytest.mark.slow
@pytest.mark.data
def test_static_adis16405_is_a_second_library_s(data_folder):
    judge = pytest.importorskip("allantools", reason="allantools is not installed: pip install allantools")
    data = np.load(data_folder / "static_adis16405" / "adis16405_imu1.npz")
    y = data["accel_counts"][:, 2] * float(data["accel_lsb_g"])
    dev = allan.deviation(y, 100.0, tau=[0.1, 1.0, 10.0, 100.0, 1000.0])
    values = judge.oadev(y, rate=100.0, data_type="freq", taus=dev.tau)[1]
    assert dev.dev == pytest.approx(values, rel=1e-4)
