"""Networks from nets.def: parser, widths, forward pass against a plain transcription."""

import pytest
import torch
import torch.nn.functional as F
from hypothesis import given, settings
from hypothesis import strategies as st

from export.graph import Layer, Net, read_nets
from training import nets


def test_parser_reads_rows_and_ignores_comments(tmp_path):
    path = tmp_path / "nets.def"
    path.write_text("/* NET(no, U, x) */\n#ifndef NET\n#define NET(a, b, c)\n#endif\n"
                    "NET(one, U, b)\nLAYER(one, a, input, 1, none, 2)\n"
                    "LAYER(one, b, a, 2, input, 1)\n")
    assert read_nets(path) == [Net("one", "U", "b", (Layer("a", "input", False, None, True),
                                                     Layer("b", "a", True, "input", False)))]


# Parameters and multiply-adds per pixel (9 inputs) of the models of Open Image Denoise.
@pytest.mark.parametrize("model,params,macs", [
    ("unet_small", 320035, 62136), ("unet", 919811, 125406), ("unet_large", 3848387, 312192),
    ("unet_xl", 7744611, 630432), ("w16", 132459, 17946)])
def test_models_have_known_sizes(model, params, macs):
    net = nets.build(model, 9)
    assert sum(p.numel() for p in net.parameters()) == params
    assert net.macs_per_pixel() == macs


def transcription(t, x):
    """The U-Net written out by hand: t tensors by name, x [N,C,H,W]."""
    def conv(name, v, relu=True):
        v = F.conv2d(v, t[name + ".weight"], t[name + ".bias"], padding=1)
        return v.relu() if relu else v

    def up(v):
        return v.repeat_interleave(2, -1).repeat_interleave(2, -2)

    p1 = F.max_pool2d(conv("enc_conv1", conv("enc_conv0", x)), 2)
    p2 = F.max_pool2d(conv("enc_conv2", p1), 2)
    p3 = F.max_pool2d(conv("enc_conv3", p2), 2)
    p4 = F.max_pool2d(conv("enc_conv4", p3), 2)
    v = conv("enc_conv5b", conv("enc_conv5a", p4))
    for level, skip in ((4, p3), (3, p2), (2, p1)):
        v = conv(f"dec_conv{level}b", conv(f"dec_conv{level}a", torch.cat((up(v), skip), 1)))
    v = conv("dec_conv1b", conv("dec_conv1a", torch.cat((up(v), x), 1)))
    return conv("dec_conv0", v, relu=False)


@settings(max_examples=8)
@given(st.lists(st.integers(1, 9), min_size=15, max_size=15), st.sampled_from([3, 6, 9]),
       st.sampled_from([(16, 16), (32, 48)]))
def test_forward_is_the_transcription(widths, inputs, size):
    torch.manual_seed(1)
    net = nets.build("unet:" + ",".join(map(str, widths)), inputs)
    x = torch.rand(1, inputs, *size)
    with torch.no_grad():
        assert torch.allclose(net(x), transcription(net.state_dict(), x), atol=1e-5)


def test_weights_identify_their_network():
    for name in ("w8", "unet_large:" + ",".join(["3"] * 18)):
        net = nets.build(name, 6)
        again = nets.from_tensors({k: v.numpy() for k, v in net.state_dict().items()})
        x = torch.rand(1, 6, 16, 16)
        with torch.no_grad():
            assert again.net == net.net and torch.equal(again(x), net(x))
    with pytest.raises(ValueError, match="no known network"):
        nets.identify(["x.weight"])


@pytest.mark.parametrize("model,text", [("nope", "unknown model"), ("nope:1,2", "unknown topology"),
                                        ("unet:1,2", "needs 15 widths")])
def test_bad_models_are_named(model, text):
    with pytest.raises(ValueError, match=text):
        nets.build(model, 3)


def test_padding():
    assert nets.pad_to(torch.ones(1, 3, 17, 32)).shape == (1, 3, 32, 32)
    assert float(nets.pad_to(torch.ones(1, 3, 17, 32)).sum()) == 3 * 17 * 32
