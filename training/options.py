"""The options of all scripts, in one table. Names and defaults are Open Image Denoise's where it
has the option; what follows from other options is derived in settings.py."""
from __future__ import annotations

import math
import sys
from dataclasses import dataclass
from typing import Any

from export.kernel import LAST_STEPS
from training.loss import LOSSES
from training.optimizer import KINDS as OPTIMIZERS
from training.scan import FEATURES

SCRIPTS = {"preprocess": "P", "train": "T", "find_lr": "L", "infer": "I", "export": "X",
           "visualize": "V", "convert_image": "C", "compare_image": "Q", "split_exr": "Z",
           "doctor": "D"}
MODEL_BY_QUALITY = {"high": "unet_large", "balanced": "unet", "fast": "unet_small"}
MODEL_BY_NET = {"kernel5": "k16", "unet": "unet", "unet_large": "unet_large"}
LR_PER_SAMPLE = {"unet_large": 2.679e-6, "unet_xl": 2.679e-6}  # of a batch; others:
LR_PER_SAMPLE_DEFAULT = 3.125e-6
# Defaults that follow from the family of the model; U's are Open Image Denoise's.
BY_FAMILY = {
    "U": {"batch_size": 16, "tile_size": 256, "loss": "l1_msssim", "learning_rate_warmup": 0.15,
          "grad_clip": 0.0, "drop_features": 0.0, "clip": 0.0, "optimizer": "adam"},
    "K": {"batch_size": 4, "tile_size": 128, "loss": "l1_grad", "learning_rate_warmup": 0.05,
          "grad_clip": 1.0, "drop_features": 0.3, "clip": 0.12, "optimizer": "muon"}}
KERNEL_LR = 1e-3  # family K's largest learning rate, times the root of the batch size
METRICS = ("psnr", "mse", "ssim", "msssim", "flip")
POSITIONAL = {"features": 0, "target": 0, "input": 1, "images": 2}  # 0: may be missing


@dataclass(frozen=True)
class Range:
    """Numbers from least to most, in words."""

    least: float
    most: float
    text: str


@dataclass(frozen=True)
class Option:
    """One row: spellings, the scripts that take it, its default (or one per script), argparse's,
    and the types and numbers that it takes, in a list if it is one."""

    names: str
    scripts: str
    default: Any
    text: str
    kind: dict
    types: tuple[type, ...]
    range: Range | None

    @property
    def key(self) -> str:
        first = self.names.split()[0]
        return first.lstrip("-").replace("-", "_")

    def default_for(self, script: str) -> Any:
        return self.default.get(script) if isinstance(self.default, dict) else self.default

    @property
    def is_list(self) -> bool:
        return self.kind.get("nargs") in ("*", 2)

    def takes(self, value: Any) -> bool:
        """Whether it may have a value, or have it in its list."""
        if not isinstance(value, self.types) or isinstance(value, bool) != (bool in self.types):
            return False
        if "choices" in self.kind:
            return value in self.kind["choices"]
        return not self.range or self.range.least <= value <= self.range.most

    @property
    def taken(self) -> str:
        """What it takes, in words."""
        if "choices" in self.kind:
            return f"one of {', '.join(map(str, self.kind['choices']))}"
        if self.range:
            return self.range.text
        return "true or false" if bool in self.types else "text"


TYPES = {int: (int,), float: (int, float), None: (str,)}  # of values, by argparse's


def _o(names: str, scripts: str, default: Any, text: str, types: tuple[type, ...] = (),
       range: Range | None = None, **kind) -> Option:
    types = types or ((bool,) if "action" in kind else TYPES[kind.get("type")])
    return Option(names, scripts, default, text, kind, types, range)


def _whole(least: int, most: int = 2**31 - 1) -> dict:
    return {"type": int, "range": Range(least, most, f"a whole number from {least} to {most}")}


def _number(least: float, most: float, text: str) -> dict:
    return {"type": float, "range": Range(least, most, f"a number{text}")}


FLAG = {"action": "store_true"}
MANY = {"nargs": "*"}
LARGEST = sys.float_info.max  # what is above is infinite
INT, COUNT = _whole(-2**31), _whole(0)
FLOAT = _number(-LARGEST, LARGEST, "")
FROM_0 = _number(0, LARGEST, " from 0")
ABOVE_0 = _number(math.nextafter(0, 1), LARGEST, " above 0")
SHARE = _number(0, 1, " from 0 to 1")

OPTIONS = (
    _o("features", "PTLD", [], f"input features: {' '.join(FEATURES)}", **MANY),
    _o("target", "X", "weights", "what to export", nargs="?",
       choices=("weights", "package", "onnx", "onnx_noparams")),
    _o("input", "Z", None, "EXR image to split"),
    _o("images", "CQ", None, "two images", nargs=2),
    _o("--config -c", "PTLIXVCQZD", None, "JSON file with settings (the command line wins)"),
    _o("--clean_aux", "PTL", False, "take auxiliary features from the reference", **FLAG),
    _o("--filter -f", "PTL", None, "filter to train for: picks defaults",
       choices=("RT", "RTLightmap")),
    _o("--quality -q", "PTL", "high", "picks the default model", choices=tuple(MODEL_BY_QUALITY)),
    _o("--preproc_dir -P", "PTL", "preproc", "folder of preprocessed data sets"),
    _o("--train_data -t", "PTL", None, "training data set (default: train)"),
    _o("--valid_data -v", "PT", None, "validation data set (default: valid)"),
    _o("--hold_out", "T", 0, "validate on this many groups of the training data set", **COUNT),
    _o("--raw", "TL", False, "train on the raw data set in memory, without preprocessing", **FLAG),
    _o("--layers", "PTLID", [], "layers of multichannel EXR files: feature=prefix", **MANY),
    _o("--shard", "P", None, "work on part i of n of the groups: i/n, i from 0"),
    _o("--transfer -x", "PTL", None, "transfer function of the main feature",
       choices=("linear", "srgb", "pu", "log")),
    _o("--data_dir -D", "PTLID", "data", "folder of raw data sets"),
    _o("--results_dir -R", "PTLIXV", "results", "folder of results"),
    _o("--result -r", "TLIXV", None, "name of the result"),
    _o("--aux_results -a", "PTLI", [], "results that prefilter auxiliary features", **MANY),
    _o("--num_epochs --epochs -e", "PTIX", {"T": 2000}, "epochs to train, or checkpoint", **INT),
    _o("--num_valid_epochs --valid_epochs", "T", 10, "validate every n epochs", **INT),
    _o("--num_save_epochs --save_epochs", "T", 10, "save a checkpoint every n epochs", **INT),
    _o("--optimizer", "TL", None, "adam, or muon, which needs fewer steps",
       choices=OPTIMIZERS),
    _o("--learning_rate --lr", "TL", {"L": 1e-8}, "initial learning rate", **ABOVE_0),
    _o("--max_learning_rate --max_lr", "TL", {"L": 0.1}, "largest learning rate", **ABOVE_0),
    _o("--learning_rate_warmup --lr_warmup", "T", None, "share of the cycle that rises",
       **_number(0, math.nextafter(1, 0), " from 0, below 1")),
    _o("--compile", "T", None, "torch.compile mode, or CUDA graphs (default on cuda)",
       choices=("disable", "graphs", "default", "reduce-overhead", "max-autotune")),
    _o("--batch_size --bs -b", "TL", None, "batch size over all devices", **_whole(1)),
    _o("--num_loaders --loaders -j", "TL", 4, "loader processes per device, or 0", **COUNT),
    _o("--precision -p", "TL", None, "training precision", choices=("fp32", "mixed", "bf16")),
    _o("--net", "TL", None, "topology of lib/nets.def: picks the default model",
       choices=tuple(MODEL_BY_NET)),
    _o("--model -m", "TL", None, "model of configs/models.json, or topology:width,width,..."),
    _o("--loss -l", "TL", None, "loss function", choices=LOSSES),
    _o("--balance", "T", 0.0, "tiles weigh 1 / (noise of their input) to this power", **FLOAT),
    _o("--ssim_weight", "TL", 1.0, "log_mse_ssim: weight of what SSIM lacks to 1", **FROM_0),
    _o("--msssim_weights", "TL", None, "MS-SSIM exponents, finest scale first", nargs="*",
       **FROM_0),
    _o("--tile_size --ts", "TL", None, "side of the training tiles", **INT),
    _o("--large_tiles", "T", 0, "every n-th batch: a quarter as many tiles, twice as wide",
       **COUNT),
    _o("--seed -s", "TL", None, "seed of the random numbers (default: from the clock)",
       **_whole(0, 2**63 - 1)),
    _o("--num_steps", "L", None, "steps of the sweep (default: one epoch, at least 100)",
       **_whole(2)),
    _o("--time_budget --time-budget", "T", None, "end after this time, e.g. 30m, 2h, 90s",
       types=(str, int, float)),
    _o("--ema", "T", 0.999, "decay of the averaged weights; 0: none", **SHARE),
    _o("--grad_clip", "T", None, "largest norm of the gradient; 0: any",
       **_number(0, math.inf, " from 0")),
    _o("--init", "T", None, "start from the weights of a result, or of a .pt or .tza (or int8)"),
    _o("--freeze", "T", [], "layers that stay as --init has them", nargs="*"),
    _o("--teacher", "T", None, "a result, or a .pt or .tza (or int8), whose results are learnt"),
    _o("--teacher_share", "T", 0.8, "how far targets are moved to the teacher's results",
       **_number(math.nextafter(0, 1), 1, " above 0, to 1")),
    _o("--quantize_aware", "T", 0, "then train the integer model for this many steps", **COUNT),
    _o("--quantize_rate", "T", 0.02, "its learning rate, in steps of weights", **ABOVE_0),
    _o("--exposure_jitter", "TL", 0.0, "random exposure of hdr tiles, +- stops", **FROM_0),
    _o("--average_inputs", "TL", 0.0, "share of inputs averaged over the group", **SHARE),
    _o("--blend_target", "TL", 0.0, "share of inputs blended towards the target", **SHARE),
    _o("--mix_clean_aux", "TL", 0.0, "share of inputs with the target's features", **SHARE),
    _o("--normal_signs", "TL", 0.0, "share of tiles with random signs of normals", **SHARE),
    _o("--fireflies", "TL", 0.0, "share of hdr tiles with very bright single pixels", **SHARE),
    _o("--hits", "TL", 0.0, "share of hdr tiles with light found by chance", **SHARE),
    _o("--collage", "TL", 0.0, "share of hdr tiles that show two pictures", **SHARE),
    _o("--texture", "TL", 0.0, "share of hdr tiles multiplied by a random texture", **SHARE),
    _o("--zoom", "TL", 0.0, "share of hdr tiles enlarged, with noise at the new size", **SHARE),
    _o("--minify", "TL", 0.0, "share of hdr tiles of two to four pixels in one, where pictures are "
       "so large", **SHARE),
    _o("--pixel_filter", "TL", 0.0, "share of hdr tiles seen through a wide filter", **SHARE),
    _o("--defocus", "TL", 0.0, "share of hdr tiles of few samples out of focus", **SHARE),
    _o("--drop_features", "TL", None, "family K: share of tiles without all features", **SHARE),
    _o("--clip", "TL", None, "family K: share of tiles clipped like LDR images", **SHARE),
    _o("--bilateral", "T", 0, "family K: train through the last steps, see export.bilateral",
       choices=(0, *LAST_STEPS), **INT),
    _o("--metric -M", "IQ", ["psnr", "ssim"], "metrics", nargs="*", choices=METRICS),
    _o("--input_data -i", "ID", {"I": "test", "D": "train"}, "raw data set to read"),
    _o("--output_dir -O", "I", "infer", "folder of denoised images"),
    _o("--output_suffix -o", "I", None, "suffix of denoised images (default: the result's name)"),
    _o("--format -F", "I", ["exr"], "formats of denoised images", nargs="*"),
    _o("--save_all", "I", False, "save input and target as well", **FLAG),
    _o("--output -o", "X", None, "output file"),
    _o("--int8", "X", False, "weights: the integer model", **FLAG),
    _o("--prune", "X", 0, "with --int8: leave out channels that are silent in so many pictures of "
       "the training data", **COUNT),
    _o("--weights", "IX", "ema", "which weights of a checkpoint", choices=("ema", "raw")),
    _o("--best", "IX", False, "the checkpoint of the best validation", **FLAG),
    _o("--port", "V", 6006, "port of TensorBoard", **_whole(0, 65535)),
    _o("--exposure -E", "CQ", 1.0, "linear scale before tone mapping", **ABOVE_0),
    _o("--layer", "Z", None, "EXR layer to split"),
    _o("--device -d", "PTLIX", None, "device", choices=("cpu", "cuda", "mps")),
    _o("--device_id -k", "PTLIX", 0, "first device", **COUNT),
    _o("--num_devices -n", "PTLIX", 1, "processes for data parallel training", **_whole(1)),
    _o("--threads", "PTLI", 0, "CPU threads per process; 0: PyTorch's choice", **COUNT),
    _o("--deterministic --det", "PTLIX", {"P": True, "I": True, "X": True, "T": False, "L": False},
       "deterministic algorithms", **FLAG),
)
