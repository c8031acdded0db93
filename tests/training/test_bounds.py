"""Integer weights: bounds, rounding by effect, folding, the mapping between weights and rows."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from export.bounds import Bound, own_groups, pair_groups, word_groups
from export.fit import designs, make_fit, second_moments
from export.fold import phase_kernels
from export.graph import Layer
from export.reference import unsafe_pairs
from export.rounding import Problem, passed_on, refined, rounded

SHAPES = st.tuples(st.integers(1, 3), st.integers(1, 5), st.sampled_from((2, 3)))


@st.composite
def weights(draw, low=-300, high=300):
    o, c, k = draw(SHAPES)
    return draw(arrays(np.int32, (o, c, k, k), elements=st.integers(low, high)))


def runs_by_hand(w):
    """Runs of [O,C,kh,kw] as docs/arithmetic.md words it."""
    for o in range(w.shape[0]):
        for dy in range(w.shape[2]):
            yield [w[o, c, dy, dx] for dx in range(w.shape[3]) for c in range(w.shape[1])]


def pairs_by_hand(w):
    for run in runs_by_hand(w):
        for j in range(0, len(run), 2):
            yield run[j:j + 2]


def words_by_hand(w):
    """What is summed in the low words of a run's dwords, and in the high ones."""
    for run in runs_by_hand(w):
        for first in (0, 2):
            yield [v for j in range(first, len(run), 4) for v in run[j:j + 2]]


def breaks(group):
    return sum(v for v in group if v > 0) > 128 or sum(v for v in group if v < 0) < -128


KINDS = pytest.mark.parametrize("groups_of, by_hand", ((pair_groups, pairs_by_hand),
                                                       (word_groups, words_by_hand)))


@KINDS
@settings(max_examples=60)
@given(w=weights())
def test_weights_within_a_bound_are_near(groups_of, by_hand, w):
    made = Bound(groups_of(w.shape[1:])).kernels(w)
    assert made.dtype == np.int8 and abs(made.astype(int)).max() <= 127
    assert not any(map(breaks, by_hand(made.astype(int))))
    assert unsafe_pairs(made) == 0, "what keeps the bound of words keeps that of pairs"
    assert not (made.astype(int) * w < 0).any(), "a sign changed"
    assert (abs(made.astype(int)) <= abs(w)).all(), "a weight grew"


@KINDS
@settings(max_examples=60)
@given(w=weights(-127, 127))
def test_a_bound_holds_where_it_does_and_leaves_weights_alone(groups_of, by_hand, w):
    bound, is_broken = Bound(groups_of(w.shape[1:])), any(map(breaks, by_hand(w)))
    assert bound.holds(w.reshape(len(w), -1)) != is_broken
    if groups_of is pair_groups:
        assert unsafe_pairs(w.astype(np.int8)) == sum(map(breaks, by_hand(w)))
    assert is_broken or (bound.kernels(w) == w).all()


@pytest.mark.parametrize("last, fits", ((0, True), (1, False), (-128, True), (-129, False)))
def test_sums_in_words_may_reach_128(last, fits):
    w = np.zeros((1, 8, 3, 3), int)
    w[0, (0, 1, 4, 5), 1] = [[40, 40, 40], [1, 1, 1], [1, 1, 1], [1, 1, 0]]  # 128 in low words
    w[0, 2, 1], w[0, :, 0, 0] = 42, 64  # and what is not with them
    w[0, (2, 6), 0, 0] = 0
    w[0, (0, 4), 0, 0] = 64, 0
    w[0, (1, 5), 0, 0] = 64, 0
    if last < -127:
        w[0, 0, 2] = -127, 0, last + 127
    else:
        w[0, 5, 1, 2] += last
    assert Bound(word_groups(w.shape[1:])).holds(w.reshape(1, -1)) == fits
    assert any(map(breaks, words_by_hand(w))) != fits


@KINDS
@settings(max_examples=60)
@given(w=weights())
def test_weights_over_their_norm_keep_the_bounds(groups_of, by_hand, w):
    norm = Bound(groups_of(w.shape[1:])).norm(w.reshape(len(w), -1))
    w = w / np.where(norm > 0, norm, 1)[:, None, None, None]
    assert abs(w).max() <= 127 + 1e-9
    assert all(sum(v for v in g if v * sign > 0) * sign <= 128 + 1e-9
               for g in by_hand(w) for sign in (1, -1))


def problem(rng, k, kind="pairs"):
    """A rounding problem with correlated inputs, as neighbouring pixels are."""
    x = rng.gamma(1.0, 40.0, (500, k)) + rng.gamma(1.0, 60.0, (500, 1))
    group = {"own": np.arange(k), "pairs": np.arange(k) // 2,
             "words": np.arange(k) // 2 % 2}[kind]
    return Problem(x.T @ x / len(x), Bound(group)), x


@settings(max_examples=40)
@given(st.integers(0, 10**6), st.integers(1, 30), st.sampled_from(("own", "pairs", "words")))
def test_every_rounding_is_whole_and_within_its_bound(seed, k, kind):
    rng = np.random.default_rng(seed)
    p, _ = problem(rng, k, kind)
    wish = rng.uniform(-160, 160, (4, k))  # also beyond the limits
    for made in (p.bound.nearest(wish), passed_on(wish, p), rounded(wish, p)[0]):
        assert (made == np.rint(made)).all() and p.bound.holds(made)


def test_rounding_in_words_uses_its_room():
    """Wishes whose groups are full: passing errors on must not fill them with the first weights."""
    rng = np.random.default_rng(8)
    p, x = problem(rng, 72, "words")
    wish = rng.normal(0, 1, (8, 72))
    wish /= p.bound.norm(wish)[:, None]
    made, _ = rounded(wish, p)
    effect = (((made - wish) @ x.T) ** 2).mean()
    plain = (((p.bound.nearest(wish) - wish) @ x.T) ** 2).mean()
    assert p.bound.holds(made) and effect < 0.5 * plain


@pytest.mark.parametrize("seed", range(3))
def test_rounding_by_effect_changes_the_output_less(seed):
    rng = np.random.default_rng(seed)
    p, x = problem(rng, 36)
    wish = rng.normal(0, 25, (8, 36))
    made, error = rounded(wish, p)
    plain = p.bound.nearest(wish)
    effect = [float((((q - wish) @ x.T) ** 2).mean()) for q in (plain, made)]
    assert effect[1] < 0.3 * effect[0]
    damped = np.einsum("ok,kl,ol->o", made - wish, p.damped(), made - wish)
    assert np.allclose(error, damped, rtol=1e-6)


def test_refinement_stops_where_no_single_step_helps():
    rng = np.random.default_rng(5)
    p, _ = problem(rng, 12)
    wish = rng.normal(0, 20, (3, 12))
    q, error = refined(p.bound.nearest(wish), wish, p)
    h = p.damped()
    for k in range(12):
        for step in (-1, 1):
            tried = q.copy()
            tried[:, k] += step
            cost = np.einsum("ok,kl,ol->o", tried - wish, h, tried - wish)
            allowed = np.array([p.bound.holds(row[None]) for row in tried])
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
    assert fit.words() is None or not skip  # `b` is wide
    for bound, groups_of in ((fit.pairs(), pair_groups), (fit.words(), word_groups)):
        if bound is None:
            continue
        wanted, at = [], 0
        for block in fit.blocks:
            of = own_groups if block.wide else groups_of
            for _ in range(len(block.weight) // fit.outputs):
                wanted.append(of(block.weight.shape[1:]) + at)
                at = wanted[-1].max() + 1
        assert (bound.group == np.concatenate(wanted)).all()
