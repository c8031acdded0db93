"""Results: a folder with config.json, checkpoints/ and log/, as Open Image Denoise's toolkit makes.

    results/<name>/config.json                      settings of the training
                   checkpoints/checkpoint_<n>.pth   after n epochs
                   checkpoints/best.pth             best validation so far
                   checkpoints/latest               ASCII epoch of the newest checkpoint
                   log/                             TensorBoard
                   lock                             while a training writes to it
Checkpoints hold epoch, step, model_state, optimizer_state (these are theirs too), ema_state,
elapsed and best, and `ending`: whether the validation after these steps is still to be made. With
the settings they decide everything that follows.
"""
from __future__ import annotations

import errno
import json
from contextlib import suppress
from pathlib import Path
from typing import IO, Any

import torch

from export.kernel import BILATERAL
from training import nets
from training.errors import OUTPUT, STATE, USAGE, ToolError
from training.features import main_feature
from training.imageio import replacing
from training.settings import Settings, input_channels, output_channels

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None


class Result:
    """A result by folder and name, which may have folders itself (files are called after the last
    part); nothing is created before the first save."""

    def __init__(self, results_dir: str | Path, name: str):
        self.name = name
        self.folder = Path(results_dir) / name
        self.checkpoints = self.folder / "checkpoints"
        self.lock: IO | None = None

    def exists(self) -> bool:
        """True if there is something to resume: a failed start without checkpoints is not."""
        return (self.checkpoints / "latest").exists() and (self.folder / "config.json").exists()

    def require(self) -> None:
        if not self.folder.is_dir():
            raise ToolError(f"result '{self.name}' does not exist in {self.folder.parent}", STATE)
        if not self.exists():
            raise ToolError(f"{self.folder}: no checkpoints found", STATE)

    def config(self) -> Settings:
        path = self.folder / "config.json"
        try:
            values = json.loads(path.read_text())
        except (OSError, ValueError) as e:
            raise ToolError(f"{path}: cannot read ({e})", STATE) from e
        if not isinstance(values, dict) or "features" not in values:
            raise ToolError(f"{path}: not the settings of a training", STATE)
        main = main_feature(values["features"])
        aux = [f for f in values["features"] if f != main]
        return Settings({"main_feature": main, "aux_features": aux, "aux_results": [], **values})

    def save_config(self, settings: Settings) -> None:
        with replacing(self.folder / "config.json") as tmp:
            tmp.write_text(json.dumps(settings.to_dict(), indent=2) + "\n")

    def claim(self) -> None:
        """ToolError if another process has claimed the result: checkpoints of both would be mixed.
        It ends with the process, or with `release`."""
        path = self.folder / "lock"
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self.lock = open(path, "w")
            if fcntl:
                fcntl.lockf(self.lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as e:
            if e.errno in (errno.EACCES, errno.EAGAIN) and self.lock:
                self.lock = None
                raise ToolError(f"result '{self.name}': another training writes to {self.folder}",
                                STATE) from e
            if e.errno not in (errno.ENOLCK, errno.ENOTSUP):  # file systems without locks
                raise ToolError(f"{path}: cannot write ({e.strerror})", OUTPUT) from e

    def release(self) -> None:
        if self.lock:
            with suppress(OSError):
                (self.folder / "lock").unlink()
            self.lock.close()
            self.lock = None

    def save(self, epoch: int, state: dict[str, Any]) -> None:
        save_state(self.checkpoints / f"checkpoint_{epoch}.pth", {"epoch": epoch, **state})
        with replacing(self.checkpoints / "latest") as tmp:
            tmp.write_text(f"{epoch}\n")

    def save_best(self, epoch: int, state: dict[str, Any]) -> None:
        save_state(self.checkpoints / "best.pth", {"epoch": epoch, **state})

    def latest_epoch(self) -> int:
        self.require()
        try:
            return int((self.checkpoints / "latest").read_text())
        except ValueError as e:
            raise ToolError(f"{self.checkpoints / 'latest'}: not a number", STATE) from e

    def load(self, epoch: int | None = None, best: bool = False,
             device: str | torch.device = "cpu") -> dict[str, Any]:
        """The checkpoint of an epoch (none or <= 0: the latest), or of the best validation."""
        self.require()
        if best:
            path = self.checkpoints / "best.pth"
        else:
            epoch = self.latest_epoch() if epoch is None or epoch <= 0 else epoch
            path = self.checkpoints / f"checkpoint_{epoch}.pth"
        if not path.exists():
            raise ToolError(f"checkpoint does not exist: {path}", STATE)
        try:
            state = torch.load(path, map_location=device, weights_only=True)
        except Exception as e:  # a damaged file shows as one of many kinds of exception
            raise ToolError(f"{path}: damaged checkpoint ({type(e).__name__})", STATE) from e
        if not best and state["epoch"] != epoch:
            raise ToolError(f"{path}: checkpoint epoch mismatch ({state['epoch']})", STATE)
        return state


def save_state(path: Path, state: dict[str, Any]) -> None:
    """A file of torch.load, written whole or not at all."""
    with replacing(path) as tmp:
        try:
            with open(tmp, "wb") as f:  # a path would hide the reason
                torch.save(state, f)
        except RuntimeError as e:  # what PyTorch makes of a full disk
            if isinstance(e.__context__, OSError):
                raise e.__context__ from e
            raise OSError(str(e).splitlines()[0]) from e


def load_model(result: Result, epoch: int | None = None, best: bool = False,
               weights: str = "ema") -> tuple[torch.nn.Module, Settings, int]:
    """(model in evaluation mode, settings of its training, epoch) of a result.

    weights: `ema` takes the averaged weights where the checkpoint has them.
    """
    result.require()
    settings = result.config()
    state = result.load(epoch, best)
    model = make_model(settings)
    tensors = state["model_state"]
    if weights == "ema" and state.get("ema_state"):
        tensors = state["ema_state"]
    load_tensors(model, tensors, result.name)
    return model.eval(), settings, state["epoch"]


def load_tensors(model: torch.nn.Module, tensors: dict, where: str) -> None:
    try:
        model.load_state_dict(tensors)
    except RuntimeError as e:
        raise ToolError(f"{where}: the checkpoint is of another model ({str(e).splitlines()[0]})",
                        STATE) from e


def make_model(settings: Settings) -> torch.nn.Module:
    """A fresh model for the settings of a training."""
    main = settings.get("main_feature") or settings.features[0]
    try:
        model = nets.build(settings.model, input_channels(settings.features), output_channels(main))
    except ValueError as e:
        raise ToolError(str(e), 2) from e
    if model.net.family == "K":
        model.transfer = settings.transfer
        model.bilateral, model.learns_last_steps = settings.get("bilateral") or 0, True
    return model


def weights_of(name: str, results_dir: str) -> dict[str, torch.Tensor]:
    """Tensors of a .tza or .pt file, or the averaged ones of a result; without last_steps_of."""
    if name.endswith((".tza", ".pt")):
        return {k: v for k, v in read_weights(Path(name)).items() if k != BILATERAL}
    return load_model(Result(results_dir, name))[0].state_dict()


def last_steps_of(name: str, results_dir: str) -> int:
    """What sources of weights_of have beside weights: export.kernel.BILATERAL, 0 for none."""
    from export.tza import Reader
    if name.endswith((".tza", ".pt")):
        tensors = Reader(Path(name)) if name.endswith(".tza") else read_weights(Path(name))
        return int(tensors[BILATERAL][0]) if BILATERAL in tensors else 0
    return getattr(load_model(Result(results_dir, name))[0], "bilateral", 0)


def read_network(path: Path) -> torch.nn.Module:
    """The network of a .tza or .pt file in floating point, with what follows it (last_steps_of), in
    evaluation mode. ToolError if the file cannot be read, or holds no network of ours."""
    tensors = read_weights(path)
    if steps := last_steps_of(str(path), ""):  # integer models keep it apart
        tensors[BILATERAL] = torch.tensor([float(steps)])
    try:
        return nets.from_tensors(tensors).eval()
    except (KeyError, ValueError) as e:
        raise ToolError(f"{path}: not the weights of a network ({e})", USAGE) from e


def read_weights(path: Path) -> dict[str, torch.Tensor]:
    """Tensors of a .tza weights file (integers as floats), or of a .pt file with a state dict."""
    from export.dequantize import as_floats
    from export.tza import Reader
    if path.suffix == ".pt":
        try:
            return {k: v.float() for k, v in torch.load(path, weights_only=True).items()}
        except Exception as e:  # a damaged file shows as one of many kinds of exception
            raise ToolError(f"{path}: no state dict ({type(e).__name__})", STATE) from e
    try:
        tensors = as_floats(Reader(path), path.name)
        return {k: torch.tensor(v).float() for k, v in tensors.items()}
    except (ValueError, OSError) as e:  # TzaError and ModelError are of the former
        raise ToolError(f"{path}: {e}", STATE) from e
