"""Certificates of paths: proofs with rounding included, against 50-digit arithmetic."""

import mpmath as mp
import numpy as np
import pytest
from helpers import precise
from helpers.arms import load_text, random_chain, seeds
from hypothesis import given, settings
from hypothesis import strategies as st

import spacearm as sa
from spacearm.polynomial import certificate as certificates
from spacearm.polynomial.certificate import Restriction
from spacearm.polynomial.jets import Chart, Jets
from spacearm.singularities.polynomials import minor_polynomials

degrees = st.lists(st.integers(0, 3), min_size=1, max_size=3)


def certify(f, path):
    """The certificate of one polynomial of angles, or of several."""
    several = [f] if isinstance(f, sa.TrigPolynomial) else f
    return certificates.certify([Jets(g, Chart.turning(g.n)) for g in several], path)


def random_polynomial(rng, degrees, spread) -> sa.TrigPolynomial:
    """Coefficients of sizes from 10^-spread to 1."""
    shape = [2 * d + 1 for d in degrees]
    c = rng.normal(size=shape) + 1j * rng.normal(size=shape)
    c *= 10.0 ** -rng.uniform(0.0, spread, shape)
    return sa.TrigPolynomial((c + np.conj(np.flip(c))) / 2)


def exactly(f, q) -> mp.mpf:
    """The value of the polynomial with these coefficients, to 50 digits."""
    total = mp.mpf(0)
    for index, c in np.ndenumerate(f.coefficients):
        phase = mp.fsum((i - d) * x for i, d, x in zip(index, f.degrees, q, strict=True))
        total += mp.mpf(c.real) * mp.cos(phase) - mp.mpf(c.imag) * mp.sin(phase)
    return total


def point(q0, q1, t) -> list[mp.mpf]:
    return [mp.mpf(a) + (mp.mpf(b) - mp.mpf(a)) * t for a, b in zip(q0, q1, strict=True)]


@given(seeds, degrees, st.floats(0.0, 14.0), st.floats(-100.0, 100.0))
def test_values_are_within_their_noise(seed, degrees, spread, far):
    rng = np.random.default_rng(seed)
    f = random_polynomial(rng, degrees, spread)
    for q in far + rng.uniform(-4.0, 4.0, (3, f.n)):
        assert abs(mp.mpf(f(q)) - exactly(f, q)) <= f.noise(np.abs(q).max())


@given(seeds, degrees, st.floats(-3.0, 3.0))
def test_series_along_a_segment_are_within_their_noise(seed, degrees, length):
    """Also along thousands of radians of one joint, while others hardly move."""
    rng = np.random.default_rng(seed)
    f = random_polynomial(rng, degrees, 3.0)
    start, step = rng.uniform(-np.pi, np.pi, (2, 1, f.n))
    step *= 10.0 ** (length + rng.uniform(-4.0, 0.0, f.n))
    line = Restriction.of(Jets(f, Chart.turning(f.n)), start, step)
    if line is not None:
        t = np.append(rng.uniform(0.0, 1.0, 300), [0.0, 1.0])
        off = line(np.zeros(len(t), dtype=int), 2.0 * t - 1.0) - f(start + t[:, None] * step)
        assert np.abs(off).max() <= line.noise + f.noise(np.abs(start + step).max() + np.pi)


@pytest.mark.parametrize("length", [1e3, 1e4, 1e6])
def test_the_first_root_of_a_very_long_segment_is_named(length):
    """cos q1 = 0.5 + 0.7 cos q2, where q2 turns ever so little."""
    c = np.zeros((3, 3), complex)
    c[[0, 2], 1], c[1, [0, 2]], c[1, 1] = 0.5, -0.35, -0.5
    f = sa.TrigPolynomial(c)
    for slow in (0.0, 1e-4, 1e-3):
        path = np.array([[0.1, 0.3], [0.1 + slow * length, 0.3 + length]])
        certificate = certify(f, path)
        t = np.linspace(0.0, min(1.0, 30.0 / length), 300_000)
        values = f(path[0] + t[:, None] * (path[1] - path[0]))
        first = t[np.flatnonzero(np.diff(np.sign(values)))[0]]
        assert certificate.verdict == "singular"
        assert certificate.at[1] == pytest.approx(0.3 + first * length, abs=2e-4)


def test_halving_ends_where_no_number_lies_between():
    """The last of a thousand segments of a million radians touches."""
    c = np.array([-0.5, 1.0, -0.5], complex)  # 1 - cos q
    path = np.append(np.full(1000, 1.0), 1e6)[:, None]
    touch = certify(sa.TrigPolynomial(c), path)
    assert touch.segment == 999
    assert not touch


@given(seeds, degrees, st.floats(0.0, 14.0), st.integers(3, 18), st.booleans())
def test_a_segment_through_a_root_is_never_free(seed, degrees, spread, digits, tangent):
    """Also where it nearly touches the set, in the direction of the tangent plane."""
    rng = np.random.default_rng(seed)
    f = random_polynomial(rng, [max(d, i == 0) for i, d in enumerate(degrees)], spread)
    q = rng.uniform(-np.pi, np.pi, f.n)
    roots = f.roots(q, 0)
    if roots.everywhere or not len(roots.angles):
        return
    q[0] = roots.angles[0]
    g = f.gradient(q)
    direction = rng.normal(size=f.n)
    if tangent and f.n > 1:
        direction -= (direction @ g) / max(g @ g, 1e-300) * g
        q += rng.choice([-1.0, 1.0]) * 10.0**-digits * g / max(np.linalg.norm(g), 1e-300)
    q0, q1 = q - rng.uniform(0.01, 1.0) * direction, q + rng.uniform(0.01, 1.0) * direction
    certificate = certify(f, np.array([q0, q1]))
    t = np.unique([0.0, 1.0, *rng.uniform(0, 1, 5), *nearest_to(q0, q1, q)])
    signs = {mp.sign(exactly(f, point(q0, q1, mp.mpf(x)))) for x in t}
    if certificate:
        assert certificate.verdict == "free"
        assert len(signs) == 1
        assert 0 not in signs
    else:
        assert abs(f(certificate.at)) <= 4 * f.noise(np.abs(certificate.at).max()) + 1e-13 * f.scale
        assert certificate.verdict in ("singular", "undecided")


def nearest_to(q0, q1, q):
    """Positions on the segment about the point nearest to q."""
    middle = (q - q0) @ (q1 - q0) / max((q1 - q0) @ (q1 - q0), 1e-300)
    return [
        float(np.clip(middle + s * 10.0**-k, 0, 1)) for k in range(2, 17, 2) for s in (-1, 0, 1)
    ]


@given(seeds, st.integers(2, 3))
def test_several_polynomials_are_free_where_one_is(seed, n):
    rng = np.random.default_rng(seed)
    family = [random_polynomial(rng, [1] * n, 1.0) for _ in range(2)]
    q0, q1 = rng.uniform(-np.pi, np.pi, (2, n))
    both = certify(family, np.array([q0, q1]))
    each = [certify(f, np.array([q0, q1])) for f in family]
    assert bool(both) >= any(each)
    line = q0 + np.linspace(0, 1, 500)[:, None] * (q1 - q0)
    values = np.abs([f(line) / f.scale for f in family]).max(axis=0)
    assert values.min() > 0
    assert both  # two random hypersurfaces and a line have no common point
    assert 0 < both.margin < 1
    together = certify([family[0], family[0]], np.array([q0, q1]))
    assert bool(together) == bool(each[0])
    if not each[0]:
        assert together.verdict == "undecided"
        assert np.allclose(together.at, each[0].at, atol=1e-6)


def test_the_first_root_of_a_long_path_is_named():
    f = sa.TrigPolynomial(np.array([0.5, 0, 0.5], complex))  # cos q
    certificate = certify(f, np.array([[-100.0], [100.0]]))
    assert certificate.verdict == "singular"
    assert certificate.at[0] == pytest.approx(-63 * np.pi / 2, abs=1e-9)
    ends = certify(f, np.array([[0.0], [np.pi / 2]]))
    assert not ends
    assert ends.at[0] == pytest.approx(np.pi / 2, abs=1e-9)


def test_a_path_in_blocks_has_the_certificate_of_the_whole(monkeypatch):
    """Its first root is the same, and its progress grows to the end."""
    f = sa.TrigPolynomial(np.array([0.5, 0, 0.5], complex))  # cos q
    free, crossing = np.linspace([[-1.5], [-2.0]], [[1.5], [3.0]], 12, axis=1)
    whole = certify(f, free), certify(f, crossing)
    monkeypatch.setattr(certificates, "BLOCK", 4)
    told = []
    jets = [Jets(f, Chart.turning(1))]
    parts = (
        certificates.certify(jets, free, None, lambda *done: told.append(done)),
        certify(f, crossing),
    )
    assert parts[0].free
    assert parts[0].margin == pytest.approx(whole[0].margin, rel=1e-12)
    assert parts[1].verdict == whole[1].verdict == "singular"
    assert parts[1].segment == whole[1].segment
    assert parts[1].at == pytest.approx(whole[1].at, abs=1e-12)
    assert told == sorted(told)
    assert told[0][0] < certificates.WHOLE
    assert told[-1] == (certificates.WHOLE, certificates.WHOLE)


def test_a_path_within_the_set_is_refused_at_once():
    c = np.zeros((3, 3), complex)
    c[0, 2] = c[2, 0] = 0.5  # cos(q1 - q2)
    c[0, 0] = c[2, 2] = -0.5  # - cos(q1 + q2): together 2 sin q1 sin q2
    f = sa.TrigPolynomial(c)
    along = certify(f, np.array([[0.0, -1.0], [0.0, 1.0]]))
    assert along.verdict == "undecided"
    assert np.allclose(along.at, [0, -1])
    beside = certify(f, np.array([[1e-9, 0.2], [1e-9, 1.0]]))
    assert beside
    across = certify(f, np.array([[-1.0, 0.5], [0.5, 0.5], [0.5, 1.0]]))
    assert across.verdict == "singular"
    assert across.segment == 0
    assert np.allclose(across.at, [0, 0.5], atol=1e-12)


# --- arms -----------------------------------------------------------------------------------


def with_bus(text, mass):
    """A URDF text whose spacecraft has another mass, at the same radii of gyration."""
    head, tail = text.split('<mass value="', 1)
    old, tail = tail.split('"', 1)
    inertia, tail = tail.split("/>", 2)[1], tail.split("/>", 2)
    factor = mass / float(old)
    words = [
        f'{word.split("=")[0]}="{float(word.split(chr(34))[1]) * factor!r}"'
        for word in inertia.split("<inertia ")[1].split()
    ]
    return f'{head}<mass value="{mass}"{tail[0]}/><inertia {" ".join(words)}/>{tail[2]}'


TASKS = {2: "x ry", 3: "position", 4: "x y z rx", 5: "x y z rx ry", 6: "pose"}


@pytest.mark.slow
@given(seeds, st.integers(2, 6), st.sampled_from([None, 1e-1, 1e-4, 1e-8, 1e6]))
@settings(max_examples=25)
def test_noise_bounds_the_error_of_an_arms_polynomial(seed, n, bus):
    check_noise(seed, n, bus, "free-floating")


def test_light_spacecraft_have_the_right_degrees_and_noise():
    """Far lighter, terms of a power of the spacecraft's mass vanish in rounding."""
    heavy, light, lightest = (check_noise(3, 4, bus, "free-floating") for bus in (None, 1e-4, 1e-8))
    assert light.degrees == heavy.degrees
    assert max(S.noise() / S.scale for S in (heavy, light, lightest)) < 1e-10


@pytest.mark.parametrize("mode", ["attitude-controlled", "fixed"])
def test_noise_of_held_arms(mode):
    check_noise(4, 3, None, mode)


def check_noise(seed, n, bus, mode):
    """Compare S with the determinant to 50 digits at random points."""
    text = random_chain(seed, n, ("revolute",))
    arm = load_text(text if bus is None else with_bus(text, bus), tip="tip", task=TASKS[n])
    S = sa.singularity_polynomial(arm, mode=mode)
    Q = np.random.default_rng(seed).uniform(-np.pi, np.pi, (5, n))
    wanted = [precise.minor(arm.at(q), range(n), mode) for q in Q]
    values = [mp.mpf(S(q)) for q in Q]
    largest = max(range(5), key=lambda i: abs(wanted[i]))
    unit = values[largest] / wanted[largest]
    size = abs(values[largest])
    for value, exact in zip(values, wanted, strict=True):
        allowed = S.noise() * (1 + abs(value) / size)
        assert abs(value - unit * exact) <= allowed
    return S


def test_minors_of_a_redundant_arm_are_those_of_the_whole_system():
    arm = sa.load("chaser7")
    joints = [(0, 1, 2, 3, 4, 5), (0, 1, 2, 3, 4, 6), (1, 2, 3, 4, 5, 6)]
    polynomials = minor_polynomials(arm, joints)
    assert polynomials[0].degrees[5:] == (0, 0)
    assert polynomials[1].degrees[5:] == (1, 0)
    Q = np.random.default_rng(7).uniform(-np.pi, np.pi, (3, 7))
    units = []
    for q in Q:
        cfg = arm.at(q)
        wanted = [precise.minor(cfg, taken) for taken in joints]
        units += [float(f(q) / w) for f, w in zip(polynomials, wanted, strict=True)]
    assert np.abs(units) == pytest.approx(abs(units[0]), rel=1e-9)
    assert len({np.sign(u) for u in units}) == 1
