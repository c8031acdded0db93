"""Train a kernel-predicting network (family K, docs/kernel-prediction.md) in a given time.

    python -m training.train_kernel training/configs/kernel5_16.json -D data -t train \\
        --minutes 50 -o kernel.tza

All features are in the data; random tiles lose some of them, and some are clipped like LDR images,
so that one set of weights serves every combination. The result is an fp16 TZA; of it
export.quantize_kernel makes the integer model that the C core runs. A checkpoint beside the output
(`.pt`) serves `--init`, not resuming: the schedule follows the clock.
"""
from __future__ import annotations

import argparse
import json
import math
import os
import time
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from export.tza import write_weights
from training import color, errors, nets
from training.data import Augment, Batches, from_raw
from training.errors import DATA, OUTPUT, USAGE, ToolError
from training.kernel_net import KernelNet, apply_filter, mixed_input, parse_heads
from training.scan import scan

FEATURES = ["hdr", "alb", "nrm"]
LOWEST = 1e-6  # radiance below this has no gradient in the PU curve worth following


@dataclass(frozen=True)
class Config:
    """A file of training/configs; unknown keys are errors."""

    net: str
    widths: list[int]
    batch_size: int = 4
    tile_size: int = 128
    learning_rate: float = 2e-3
    warmup: float = 0.05          # share of the time in which the learning rate rises
    floor: float = 0.002          # of the learning rate at the end
    drop_features: float = 0.3    # share of tiles that lose auxiliary features
    clip: float = 0.12            # share of tiles clipped at a random white
    exposure_jitter: float = 2.0  # these five as in training.train
    average_inputs: float = 0.1
    blend_target: float = 0.15
    mix_clean_aux: float = 0.15
    normal_signs: float = 0.5
    bf16: bool = False            # convolutions in bfloat16; pays on CPUs that multiply it
    seed: int = 1


def read_config(path: Path) -> Config:
    try:
        values = json.loads(path.read_text())
    except (OSError, ValueError) as e:
        raise ToolError(f"{path}: {e}", USAGE) from e
    unknown = set(values) - {f.name for f in fields(Config)}
    if unknown:
        raise ToolError(f"{path}: unknown settings: {', '.join(sorted(unknown))}", USAGE)
    try:
        return Config(**values)
    except TypeError as e:
        raise ToolError(f"{path}: {e}", USAGE) from e


def make_net(config: Config) -> KernelNet:
    topologies = nets.parse_nets()
    if config.net not in topologies or topologies[config.net].family != "K":
        raise ToolError(f"'{config.net}' is no network of family K", USAGE)
    net = topologies[config.net]
    if len(config.widths) != len(net.layers):
        raise ToolError(f"'{config.net}' needs {len(net.layers)} widths", USAGE)
    heads = parse_heads(nets.NETS_DEF.read_text(), config.net)
    return KernelNet(net, heads, config.widths).to(memory_format=torch.channels_last)


@dataclass(frozen=True)
class Tiles:
    """A batch as the network sees it, [N,C,H,W]; presence planes are [N,1,H,W]."""

    radiance: Tensor
    target: Tensor
    albedo: Tensor
    normal: Tensor
    has_albedo: Tensor
    has_normal: Tensor
    clipped: Tensor


def mutate(x: Tensor, y: Tensor, config: Config, rng: np.random.Generator) -> Tiles:
    """Decodes PU codes and drops features and highlights of random tiles."""
    radiance = color.pu_inverse(x[:, :3].clamp(0, 1))
    target = color.pu_inverse(y[:, :3].clamp(0, 1))
    n = x.shape[0]
    plane = torch.ones(n, 1, *x.shape[-2:])
    has_albedo, has_normal, clipped = torch.ones(3, n, 1, 1, 1)
    clipped[:] = 0
    for i in range(n):
        u, drop = rng.random(), config.drop_features
        if u < drop * 0.5:
            has_albedo[i] = has_normal[i] = 0
        elif u < drop * 0.8:
            has_normal[i] = 0
        elif u < drop:
            has_albedo[i] = 0
        if rng.random() < config.clip:
            gain = float(2 ** rng.uniform(-0.5, 2.0))
            clipped[i] = 1
            radiance[i] = (radiance[i] * gain).clamp(max=1)
            target[i] = (target[i] * gain).clamp(max=1)
    return Tiles(radiance, target, x[:, 3:6], x[:, 6:9] * 2 - 1, has_albedo * plane,
                 has_normal * plane, clipped * plane)


def run(net: KernelNet, t: Tiles, bf16: bool = False) -> Tensor:
    codes = mixed_input(t.radiance, t.albedo, t.normal, t.has_albedo, t.has_normal, t.clipped)
    with torch.autocast("cpu", torch.bfloat16, enabled=bf16):
        heads = net.trunk(codes)
    return apply_filter(heads, t.radiance, t.albedo, t.has_albedo)


def loss_of(out: Tensor, target: Tensor) -> Tensor:
    """L1 of PU codes and half the L1 of their differences along x and y."""
    a, b = (color.pu_forward(v.clamp(LOWEST, color.HDR_MAX)) for v in (out, target))
    d = a - b
    steps = (d[..., 1:] - d[..., :-1]).abs().mean() + (d[..., 1:, :] - d[..., :-1, :]).abs().mean()
    return d.abs().mean() + 0.5 * steps


def rate(config: Config, done: float) -> float:
    """Learning rate when the share `done` of the time is over: up and down along cosines."""
    if done < config.warmup:
        return config.learning_rate * (0.04 + 0.48 * (1 - math.cos(math.pi * done / config.warmup)))
    fall = (done - config.warmup) / (1 - config.warmup)
    return config.learning_rate * max(0.5 * (1 + math.cos(math.pi * fall)), config.floor)


def train(net: KernelNet, batches: Batches, config: Config, seconds: float) -> tuple[dict, int]:
    """Trains for a time; returns the averaged weights and the number of steps."""
    optimizer = torch.optim.Adam(net.parameters(), config.learning_rate, betas=(0.9, 0.99))
    average = [p.detach().clone() for p in net.parameters()]
    rng = np.random.default_rng(config.seed + 6)
    run(net, mutate(*batches[0], config, np.random.default_rng(0)))  # compiles the operation
    start, step, smooth = time.monotonic(), 0, 0.0
    while (done := (time.monotonic() - start) / seconds) < 1:
        for group in optimizer.param_groups:
            group["lr"] = rate(config, done)
        tiles = mutate(*batches[step], config, rng)
        loss = loss_of(run(net, tiles, config.bf16), tiles.target)
        optimizer.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(net.parameters(), 1.0)
        optimizer.step()
        step += 1
        torch._foreach_lerp_(average, [p.detach() for p in net.parameters()],
                             1 - min(0.999, (step + 1) / (step + 10)))
        smooth += (loss.item() - smooth) * max(0.002, 1 / step)
        if step % 200 == 0:
            print(f"{step} steps, {done:.0%} of the time, loss {smooth:.5f}", flush=True)
    names = [name for name, _ in net.named_parameters()]
    return dict(zip(names, average, strict=True)), step


def main(argv: list[str]) -> None:
    parser = argparse.ArgumentParser(prog="train_kernel", description=__doc__.split("\n")[0])
    parser.add_argument("config", type=Path)
    parser.add_argument("-D", "--data_dir", type=Path, default=Path("data"))
    parser.add_argument("-t", "--train_data", nargs="+", default=["train"], metavar="NAME")
    parser.add_argument("--minutes", type=float, required=True)
    parser.add_argument("--threads", type=int, default=0, help="of PyTorch (all)")
    parser.add_argument("--init", type=Path, help="checkpoint (.pt) to start from")
    parser.add_argument("-o", "--output", type=Path, required=True, help="fp16 TZA to write")
    args = parser.parse_args(argv)
    if not args.output.parent.is_dir():
        raise ToolError(f"{args.output.parent}: no such folder", OUTPUT)
    if args.threads:
        torch.set_num_threads(args.threads)
    config = read_config(args.config)
    pictures = []
    for name in args.train_data:
        found = scan(args.data_dir / name, FEATURES)
        print("\n".join(found.summary()))
        pictures += from_raw(found, FEATURES, "hdr", "pu", log=print)
    if not pictures:
        raise ToolError(f"{args.data_dir}: no training images", DATA)
    torch.manual_seed(config.seed)
    net = make_net(config)
    if args.init:
        net.load_state_dict(torch.load(args.init, weights_only=True))
    augment = Augment(config.exposure_jitter, config.average_inputs, config.blend_target,
                      config.mix_clean_aux, config.normal_signs)
    batches = Batches(pictures, FEATURES, "hdr", "pu", config.batch_size, config.tile_size,
                      config.seed, augment)
    weights, steps = train(net, batches, config, args.minutes * 60)
    temporary = args.output.with_name(f".{args.output.name}.{os.getpid()}.tmp")
    torch.save(weights, temporary)
    os.replace(temporary, args.output.with_suffix(".pt"))
    write_weights(temporary, {k: v.numpy() for k, v in weights.items()})
    os.replace(temporary, args.output)
    print(f"{steps} steps; wrote {args.output}")


if __name__ == "__main__":
    errors.run(main)
