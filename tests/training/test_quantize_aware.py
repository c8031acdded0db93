"""The integer network in torch: bit for bit the reference, trainable, written as a valid model."""

from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from export.bounds import Bound, own_groups, pair_groups, word_groups
from export.calibrate import Kind, frame_of, network_inputs
from export.quantize_kernel import calibration_set
from export.quantizer import Options, Quantizer
from export.reference import IntModel, load_model
from export.synthetic import noisy
from export.tza import write_weights
from tests.training.tools import TINY, picture, write_features
from training import integer_stage, nets, quantize_aware
from training.data import Picture
from training.errors import DATA, STATE, USAGE
from training.loss import l1
from training.quantize_aware import IntegerNet, fine_tune, rounded_weights
from training.settings import Settings

GOLDEN = Path(__file__).resolve().parent.parent / "golden"
CASES = sorted(p.name for p in GOLDEN.glob("int_*"))


def run(net: IntegerNet, x: np.ndarray) -> np.ndarray:
    """[H,W,C] through the module, in output codes."""
    with torch.no_grad():
        y = net(torch.from_numpy(x.transpose(2, 0, 1).copy())[None])[0].numpy()
    codes = y.transpose(1, 2, 0) / net.output_scale
    assert abs(codes - np.rint(codes)).max() < 1e-3
    return np.rint(codes).astype(np.uint16)


@pytest.mark.parametrize("name", CASES)
def test_torch_equals_the_golden_codes(name):
    h, w, cin, cout = map(int, (GOLDEN / name / "shape.txt").read_text().split())
    x = np.fromfile(GOLDEN / name / "input.f32", "<f4").reshape(h, w, cin)
    wanted = np.fromfile(GOLDEN / name / "output.u15", "<u2").reshape(h, w, cout)
    model = load_model(GOLDEN / name / "weights.tza")
    assert (run(IntegerNet(model), x) == wanted).all()


def test_there_are_golden_models():
    assert len(CASES) >= 8


@settings(max_examples=30)
@given(st.integers(0, 10**6), st.sampled_from((own_groups, pair_groups, word_groups)))
def test_rounded_weights_keep_the_bounds(seed, groups_of):
    rng = np.random.default_rng(seed)
    w = torch.tensor(rng.normal(0, 90, (3, int(rng.integers(1, 6)), 3, 3)), requires_grad=True)
    bound = Bound(groups_of(w.shape[1:]))
    q = rounded_weights(w, bound)
    assert (q == q.round()).all() and q.abs().max() <= 127
    assert bound.holds(q.detach().numpy().reshape(3, -1))
    q.sum().backward()
    assert (w.grad == 1).all()


class Teacher:
    """Batches whose targets a network of floats makes: item k is a function of k."""

    def __init__(self, model, inputs):
        self.model, self.inputs = model, inputs

    def __getitem__(self, step: int):
        rng = np.random.default_rng(step)
        x = self.inputs[step % len(self.inputs)]
        y, z = (int(rng.integers(0, (n - 32) // 16 + 1)) * 16 for n in x.shape[:2])
        cut = x[y:y + 32, z:z + 32]
        pair = (cut, self.model.run(cut))
        return tuple(torch.from_numpy(v.transpose(2, 0, 1).copy())[None] for v in pair)


def test_training_repairs_a_spoilt_model():
    """Weights disturbed after quantisation come back, and what is written is what was trained."""
    exact = load_model(GOLDEN / "unet_9_tall" / "weights.tza")
    kind = Kind.of(9, "hdr", "color")
    inputs = network_inputs([frame_of(noisy(64, s, 8), kind) for s in (1, 2)])
    model = Quantizer(exact, inputs, Options(samples=2000)).run()
    net = IntegerNet(model)
    generator = torch.Generator().manual_seed(1)
    with torch.no_grad():
        for name, p in net.named_parameters():
            if not name.endswith("bias"):
                p += torch.randn(p.shape, generator=generator, dtype=p.dtype) * 2

    def error(made: IntModel) -> float:
        x = inputs[0][:48, :48]
        return float(np.abs(made.run(x) - exact.run(x)).mean())

    before = error(net.integer_model())
    teacher = Teacher(exact, inputs)
    tuned = fine_tune(net, teacher, [teacher[k] for k in range(900, 908)], 60, 0.1, l1,
                      log=lambda line: None)
    assert tuned.least < 0.8 * tuned.before and tuned.step > 0
    made = net.integer_model()
    assert error(made) < 0.6 * before
    x = inputs[1][:32, :48]
    assert (run(net, x) == made.output_codes(x)).all()


def test_training_that_spoils_a_model_leaves_it_as_it_was():
    """Steps far too large: what comes out is what went in."""
    exact = load_model(GOLDEN / "unet_9_tall" / "weights.tza")
    inputs = network_inputs([frame_of(noisy(64, 1, 8), Kind.of(9, "hdr", "color"))])
    model = Quantizer(exact, inputs, Options(samples=2000)).run()
    net, teacher = IntegerNet(model), Teacher(exact, inputs)
    losses = []
    tuned = fine_tune(net, teacher, [teacher[9]], 5, 30.0, l1, log=losses.append)
    assert (tuned.step, tuned.least) == (0, tuned.before) and len(losses) == 1
    assert (net.integer_model().run(inputs[0]) == model.run(inputs[0])).all()


@pytest.fixture
def weights(work) -> str:
    torch.manual_seed(3)
    state = nets.build(TINY, 9).state_dict()
    write_weights(work / "in.tza", {k: v.numpy() for k, v in state.items()})
    return str(work / "in.tza")


def test_command(raw, work, weights, capsys):
    args = [weights, "out.tza", "-D", str(raw), "-t", "train", "--steps", "3", "--ts", "32",
            "-b", "2"]
    quantize_aware.main(args)
    assert "loss" in capsys.readouterr().out
    first = Path("out.tza").read_bytes()
    assert isinstance(load_model("out.tza"), IntModel)
    quantize_aware.main(args)
    assert Path("out.tza").read_bytes() == first


def test_command_refuses(raw, work, weights, fails):
    data = ["-D", str(raw), "-t", "train"]
    for args, code, word in (
            (["none.tza", "out.tza", *data], STATE, "none.tza"),
            ([weights, "out.tza", "-D", str(raw), "-t", "nothing"], DATA, "nothing"),
            ([weights, "out.tza", *data, "--steps", "0"], USAGE, "--steps")):
        got, message = fails(quantize_aware.main, args)
        assert got == code and word in message
    assert not Path("out.tza").exists()


class Seen(Exception):
    """Ends a quantisation once its pictures are known."""


@pytest.mark.parametrize("height, width, cut", [(400, 1000, 256), (128, 192, None)])
@pytest.mark.parametrize("family", ["U", "K"])
def test_large_pictures_are_calibrated_with_their_middles(family, height, width, cut, monkeypatch):
    """Whole frames of renderers would take gigabytes and half an hour; small ones stay whole."""
    def seen(model, inputs, options):
        assert len(inputs) == integer_stage.CALIBRATION
        for x in inputs:
            assert x.shape[:2] == ((cut, cut) if cut else (height, width))
        raise Seen

    monkeypatch.setattr(integer_stage, "KernelQuantizer" if family == "K" else "Quantizer", seen)
    features = ["hdr", "alb", "nrm"]
    codes = np.full((height, width, 9), 0.5, np.float16)
    pictures = [Picture("p", [codes], [4.0], codes[..., :3])] * 15
    settings = Settings({"family": family, "main_feature": "hdr", "features": features,
                         "transfer": "pu", "result": "a"})
    model = nets.build("k8" if family == "K" else TINY, 9)
    with pytest.raises(Seen):
        integer_stage.quantize(model.state_dict(), settings, pictures)


def test_large_pictures_of_a_data_set_are_cut(tmp_path):
    for version in "4", "ref":
        write_features(tmp_path, f"p_{version}", picture(0, 400, 496))
    assert [x.shape for x in calibration_set(tmp_path, 1)] == [(256, 256, 12)]
