"""Integer weights: pairs, rounding by effect, folding, the mapping between weights and rows."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from export.fit import designs, make_fit, second_moments
from export.fold import phase_kernels
from export.graph import Layer
from export.pairs import from_pairs, pair_norm, safe, to_pairs
from export.reference import unsafe_pairs
from export.rounding import Problem, nearest, passed_on, refined, rounded

SHAPES = st.tuples(st.integers(1, 3), st.integers(1, 5), st.sampled_from((2, 3)))


@st.composite
def weights(draw, low=-300, high=300):
    o, c, k = draw(SHAPES)
    return draw(arrays(np.int32, (o, c, k, k), elements=st.integers(low, high)))


def pairs_by_hand(w):
    """Pairs of [O,C,kh,kw] as docs/arithmetic.md words it."""
    for o in range(w.shape[0]):
        for dy in range(w.shape[2]):
            run = [w[o, c, dy, dx] for dx in range(w.shape[3]) for c in range(w.shape[1])]
            for j in range(0, len(run), 2):
                yield run[j:j + 2]


def breaks(pair):
    return sum(v for v in pair if v > 0) > 128 or sum(v for v in pair if v < 0) < -128


@settings(deadline=None)
@given(weights())
def test_safe_weights_are_safe_and_near(w):
    made = safe(w)
    assert made.dtype == np.int8 and abs(made.astype(int)).max() <= 127
    assert unsafe_pairs(made) == 0 == sum(map(breaks, pairs_by_hand(made.astype(int))))
    assert not (made.astype(int) * w < 0).any(), "a sign changed"
    assert (abs(made.astype(int)) <= abs(w)).all(), "a weight grew"


@settings(deadline=None)
@given(weights(-127, 127))
def test_unsafe_pairs_are_counted_and_safe_weights_left_alone(w):
    count = sum(map(breaks, pairs_by_hand(w)))
    assert unsafe_pairs(w.astype(np.int8)) == count
    if not count:
        assert (safe(w) == w).all()


@settings(deadline=None)
@given(weights())
def test_pairs_come_back(w):
    assert [list(p) + [0] * (2 - len(p)) for p in pairs_by_hand(w)] == \
        to_pairs(w).reshape(-1, 2).tolist()
    assert (from_pairs(to_pairs(w), w.shape) == w).all()


@settings(deadline=None)
@given(weights())
def test_weights_over_their_norm_keep_the_bounds(w):
    norm = pair_norm(w)
    w = w / np.where(norm > 0, norm, 1)[:, None, None, None]
    assert abs(w).max() <= 127 + 1e-9
    assert all(abs(sum(p)) <= 128 + 1e-9 for p in pairs_by_hand(w) if p[0] * p[-1] > 0)


def problem(rng, k, narrow=True):
    """A rounding problem with correlated inputs, as neighbouring pixels are."""
    x = rng.gamma(1.0, 40.0, (500, k)) + rng.gamma(1.0, 60.0, (500, 1))
    partner = np.arange(k)
    if narrow:
        even = np.arange(0, k - 1, 2)
        partner[even], partner[even + 1] = even + 1, even
    return Problem(x.T @ x / len(x), partner), x


def is_safe(q, partner):
    other = np.where(partner == np.arange(len(partner)), 0, q[:, partner])
    return (abs(q) <= 127).all() and (np.maximum(q, 0) + np.maximum(other, 0) <= 128).all() and \
        (np.minimum(q, 0) + np.minimum(other, 0) >= -128).all()


@settings(deadline=None, max_examples=40)
@given(st.integers(0, 10**6), st.integers(1, 30), st.booleans())
def test_every_rounding_is_whole_and_pair_safe(seed, k, narrow):
    rng = np.random.default_rng(seed)
    p, _ = problem(rng, k, narrow)
    wish = rng.uniform(-160, 160, (4, k))  # also beyond the limits
    for made in (nearest(wish, p.partner), passed_on(wish, p), rounded(wish, p)[0]):
        assert (made == np.rint(made)).all() and is_safe(made, p.partner)


@pytest.mark.parametrize("seed", range(3))
def test_rounding_by_effect_changes_the_output_less(seed):
    rng = np.random.default_rng(seed)
    p, x = problem(rng, 36)
    wish = rng.normal(0, 25, (8, 36))
    made, error = rounded(wish, p)
    plain = nearest(wish, p.partner)
    effect = [float((((q - wish) @ x.T) ** 2).mean()) for q in (plain, made)]
    assert effect[1] < 0.3 * effect[0]
    damped = np.einsum("ok,kl,ol->o", made - wish, p.damped(), made - wish)
    assert np.allclose(error, damped, rtol=1e-6)


def test_refinement_stops_where_no_single_step_helps():
    rng = np.random.default_rng(5)
    p, _ = problem(rng, 12)
    wish = rng.normal(0, 20, (3, 12))
    q, error = refined(nearest(wish, p.partner), wish, p)
    h = p.damped()
    for k in range(12):
        for step in (-1, 1):
            tried = q.copy()
            tried[:, k] += step
            cost = np.einsum("ok,kl,ol->o", tried - wish, h, tried - wish)
            allowed = np.array([is_safe(row[None], p.partner) for row in tried])
            assert (cost[allowed] >= error[allowed] * (1 - 1e-9) - 1e-6).all()


def conv_by_hand(x, w):
    """3x3, zero padding, [H,W,C] x [O,C,3,3], one output at a time."""
    h, width, _ = x.shape
    p = np.pad(x, ((1, 1), (1, 1), (0, 0)))
    return np.array([[[(p[y:y + 3, i:i + 3] * w[o].transpose(1, 2, 0)).sum()
                       for o in range(len(w))] for i in range(width)] for y in range(h)])


def test_phase_kernels_equal_upsampling_first():
    rng = np.random.default_rng(1)
    x, w = rng.normal(size=(3, 4, 2)), rng.normal(size=(2, 2, 3, 3))
    wanted = conv_by_hand(x.repeat(2, 0).repeat(2, 1), w)
    phases = phase_kernels(w).reshape(4, 2, 2, 2, 2)
    p = np.pad(x, ((1, 1), (1, 1), (0, 0)))
    for y in range(6):
        for i in range(8):
            k = phases[2 * (y & 1) + (i & 1)]
            top, left = (y + 1) // 2, (i + 1) // 2  # in the padded map: one more than in the text
            got = np.einsum("ocyx,yxc->o", k, p[top:top + 2, left:left + 2])
            assert np.allclose(got, wanted[y, i])


@pytest.mark.parametrize("up", (False, True))
@pytest.mark.parametrize("skip", (False, True))
def test_rows_meet_their_inputs(up, skip):
    """The design's inputs times a layer's rows are the convolution; rows come back as weights."""
    rng = np.random.default_rng(3)
    maps = {"a": rng.integers(0, 200, (4, 6, 3)), "b": rng.integers(0, 200, (8, 12, 5))}
    if not up:
        maps["a"] = rng.integers(0, 200, (8, 12, 3))
    layer = Layer("l", "a", up, "b" if skip else None, False)
    w = rng.normal(size=(2, 8 if skip else 3, 3, 3))
    steps = {"a": np.array([0.5, 1, 2.0]), "b": np.full(5, 0.25)}
    fit = make_fit(layer, w, steps, ("b",))
    x = (maps["a"] * steps["a"]).astype(float)
    x = x.repeat(2, 0).repeat(2, 1) if up else x
    if skip:
        x = np.concatenate((x, maps["b"] * steps["b"]), -1)
    wanted = conv_by_hand(x, w)
    rows, seen = fit.rows(), 0
    first = fit.blocks[0].weight[0].size
    rest = rows.shape[1] - first * (4 if up else 1)
    for phase, inputs in designs(layer, maps, 10**6):
        own = np.concatenate((rows[:, phase * first:(phase + 1) * first],
                              rows[:, rows.shape[1] - rest:]), 1)
        got = (inputs @ own.T).reshape(4 if up else 8, -1, 2)
        py, px = divmod(phase, 2)
        assert np.allclose(got, wanted[py::2, px::2] if up else wanted)
        seen += len(inputs)
    assert seen == 8 * 12
    whole = [np.rint(r) for r in (rows * 10,)][0]
    for made, block in zip(fit.unrows(whole), fit.blocks):
        assert (made == np.rint(block.weight * 10)).all()
    moments = second_moments(fit, [maps], 10**6)
    assert np.allclose(np.einsum("ok,kl,ol->o", rows, moments, rows), (wanted**2).mean((0, 1)))
    partner = fit.partners()
    assert (partner[partner] == np.arange(len(partner))).all()
    odd = (3 * (2 if up else 3)) % 2  # a run with an odd end leaves one element alone
    alone = partner[:first * (4 if up else 1)] == np.arange(first * (4 if up else 1))
    assert alone.sum() == odd * (8 if up else 3)
