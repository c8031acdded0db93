"""Devices and processes: opening them, averaging over them, loaders, mixed precision.

Under torchrun its environment decides (one machine or many). Else --num_devices n starts n
processes here. gloo connects CPU processes, NCCL those on CUDA devices.

Requests to end (Ctrl-C, SIGTERM) reach all processes: the one that started others passes them on
and waits, those of a training agree after which step they stop, and loaders follow them.
"""
from __future__ import annotations

import contextlib
import ctypes
import functools
import importlib
import multiprocessing.popen_fork
import multiprocessing.queues
import os
import signal
import socket
import sys
import time
from collections.abc import Callable, Iterable
from datetime import timedelta
from multiprocessing.context import ForkContext, ForkProcess

import torch
import torch.distributed as dist
from torch import Tensor

from training.errors import INTERRUPTED, STATE, USAGE, ToolError, set_up_output
from training.interrupt import Interrupted, Interrupts, forget_loaders, watched_loaders
from training.optimizer import Optimizer
from training.settings import Settings

# How long processes wait for another: validations and the integer stage are the first one's alone,
# and last as long as they do. Of one that died those hear that started it.
PATIENCE = timedelta(days=7)
PAUSE = 3.0  # seconds before others fail, too: of the first to fail the rest are ended meanwhile


class Team:
    """The processes of a training as one of them sees them."""

    def __init__(self, rank: int, world: int, device: torch.device):
        self.rank, self.world, self.device = rank, world, device

    def average(self, grads: list[Tensor]) -> None:
        """Replace gradients by their mean over the processes, in one message."""
        if self.world == 1:
            return
        flat = torch.cat([g.reshape(-1) for g in grads])
        dist.all_reduce(flat)
        flat /= self.world
        at = 0
        for g in grads:
            g.copy_(flat[at:at + g.numel()].view_as(g))
            at += g.numel()

    def mean(self, value: Tensor) -> Tensor:
        if self.world > 1:
            value = value.clone()
            dist.all_reduce(value)
            value = value / self.world
        return value

    def same(self, value: float) -> float:
        """Rank 0's value, for decisions that all must take alike."""
        if self.world == 1:
            return value
        t = torch.tensor(value, dtype=torch.float64, device=self.device)
        dist.broadcast(t, 0)
        return float(t)

    def any(self, value: bool) -> bool:
        """Whether it holds in one of the processes."""
        if self.world == 1:
            return value
        t = torch.tensor(float(value))  # on the CPU: devices go on with what they do
        dist.all_reduce(t)
        return bool(t)

    def wait(self) -> None:
        """Until all processes have come here."""
        if self.world > 1:
            dist.barrier()


def open_device(settings: Settings, index: int = 0) -> torch.device:
    """The device that was asked for, else the first of cuda, mps, cpu that is there."""
    there = {"cuda": torch.cuda.is_available(), "mps": torch.backends.mps.is_available(),
             "cpu": True}
    kind = settings.device or next(k for k, v in there.items() if v)
    if not there[kind]:
        raise ToolError(f"device '{kind}' is not available", USAGE)
    if kind == "cuda":
        number = settings.device_id + index
        if number >= torch.cuda.device_count():
            raise ToolError(f"there is no cuda device {number}", USAGE)
        torch.cuda.set_device(number)
        return torch.device("cuda", number)
    return torch.device(kind)


def configure(settings: Settings) -> None:
    """Threads and determinism of this process."""
    if settings.threads > 0:
        torch.set_num_threads(settings.threads)
    torch.backends.cudnn.benchmark = not settings.deterministic
    torch.backends.cudnn.deterministic = bool(settings.deterministic)
    keep_memory()


HEAP = 512 << 20  # bytes of the heap that are asked for in large pages


@functools.cache
def keep_memory() -> None:
    """Has glibc keep what is freed, and Linux back it with large pages. Else each step's tensors
    come as fresh small pages, which costs a fifth of a step."""
    if sys.platform != "linux":
        return
    with contextlib.suppress(OSError, AttributeError):
        libc = ctypes.CDLL(None)
        for parameter, value in ((-1, 2**31 - 1), (-2, 2**26), (-3, 2**25)):  # trim, pad, mmap
            libc.mallopt(parameter, value)
        size, page = 31 << 20, 2 << 20  # below the bound for mmap
        libc.malloc.argtypes, libc.malloc.restype = [ctypes.c_size_t], ctypes.c_void_p
        libc.free.argtypes = [ctypes.c_void_p]
        libc.madvise.argtypes = [ctypes.c_void_p, ctypes.c_size_t, ctypes.c_int]
        blocks = [libc.malloc(size) for _ in range(HEAP // size)]
        for block in blocks:
            if block:
                first, last = -(-block // page), (block + size) // page
                libc.madvise(first * page, (last - first) * page, 14)  # MADV_HUGEPAGE
        for block in blocks:
            libc.free(block)


def launch(work: Callable[[Settings, Team], None], settings: Settings) -> None:
    """Run `work` in every process of the training; returns when all are done."""
    if "WORLD_SIZE" in os.environ and "RANK" in os.environ:  # torchrun
        _member(int(os.environ["RANK"]), work, settings, int(os.environ["WORLD_SIZE"]),
                int(os.environ.get("LOCAL_RANK", 0)))
    elif settings.num_devices > 1:
        with socket.socket() as s:  # a free port, so that two trainings do not collide
            s.bind(("127.0.0.1", 0))
            port = s.getsockname()[1]
        os.environ |= {"MASTER_ADDR": "127.0.0.1", "MASTER_PORT": str(port)}
        _spawn(work, settings)
    else:
        configure(settings)
        with watched_loaders():
            work(settings, Team(0, 1, open_device(settings)))


def _spawn(work, settings: Settings) -> None:
    """Start the processes and wait for them; if interrupted, for what they save."""
    with Interrupts() as interrupts:
        started = torch.multiprocessing.spawn(_spawned, (work, settings), settings.num_devices,
                                              join=False)
        try:
            with interrupts.at_once():
                while not started.join():
                    pass
        except Interrupted:
            _end(started.processes)
            sys.exit(INTERRUPTED)
        except torch.multiprocessing.ProcessExitedException as e:
            if e.exit_code == INTERRUPTED:
                sys.exit(INTERRUPTED)
            raise ToolError("a training process failed (see above)", e.exit_code or STATE) from e


def _end(processes: list) -> None:
    """Ask processes to end, and wait until they have; interrupted once more, kill them."""
    try:
        for process in processes:
            process.terminate()
        for process in processes:
            process.join()
    except KeyboardInterrupt:
        for process in processes:
            process.kill()
        raise


def _spawned(rank: int, work, settings: Settings) -> None:
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    set_up_output()
    try:
        _member(rank, work, settings, settings.num_devices, rank)
    except (ToolError, KeyboardInterrupt) as e:
        code = e.code if isinstance(e, ToolError) else INTERRUPTED
        if rank and code != INTERRUPTED:
            time.sleep(PAUSE)
        if rank == 0 or code != INTERRUPTED:
            print(f"Error: {str(e) or 'interrupted'}", file=sys.stderr)
        sys.exit(code)
    except Exception:  # of the connection, if another has failed
        time.sleep(2 * PAUSE)
        raise


def _member(rank: int, work, settings: Settings, world: int, local: int) -> None:
    if settings.batch_size % world:
        raise ToolError(f"--batch_size {settings.batch_size} does not divide by {world} processes",
                        USAGE)
    if settings.get("large_tiles") and settings.batch_size % (4 * world):
        raise ToolError(f"--large_tiles: a quarter of --batch_size {settings.batch_size} does not "
                        f"divide by {world} processes", USAGE)
    configure(settings)
    device = open_device(settings, local)
    # Its functions keep the group that is open when an optimiser first imports them, with its
    # threads; a thread that lives on while the interpreter ends may abort it.
    importlib.import_module("torch.distributed.nn.functional")
    dist.init_process_group("cpu:gloo,cuda:nccl" if device.type == "cuda" else "gloo", rank=rank,
                            world_size=world, timeout=PATIENCE)
    team = Team(rank, world, device)
    try:
        seed = torch.tensor(settings.seed)  # on the CPU
        dist.broadcast(seed, 0)  # where none was given torchrun's processes took their clocks'
        with watched_loaders():
            work(settings.replace(seed=int(seed)), team)
        team.wait()  # nobody leaves while another may still need it
    finally:
        dist.destroy_process_group()


def loader(batches, steps: range, settings: Settings, team: Team) -> Iterable:
    """Batches number `steps`, made by --num_loaders processes ahead of time, or here if 0."""
    workers = min(settings.num_loaders, len(steps))
    forks = workers > 0 and sys.platform == "linux"
    return torch.utils.data.DataLoader(
        batches, batch_size=None, sampler=steps, num_workers=workers,
        multiprocessing_context=_LoaderContext() if forks else None,
        worker_init_fn=_set_up_loader if forks else None,
        pin_memory=team.device.type == "cuda")


class _LoaderPopen(multiprocessing.popen_fork.Popen):
    def terminate(self) -> None:
        forget_loaders()
        self.kill()


class _LoaderProcess(ForkProcess):
    _Popen = _LoaderPopen


class _LoaderContext(ForkContext):
    """Of loaders: they ignore what is sent to all processes of a training, which needs their
    batches to end a step, and so have to be killed if they hang."""
    Process = _LoaderProcess


def _set_up_loader(_: int) -> None:
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)
    sys.excepthook = lambda *_: None  # of the thread that is left alone while it hands over a batch
    # One that it cannot hand over, it would drop, and the training wait for it without end.
    multiprocessing.queues.Queue._on_queue_feeder_error = lambda *_: os._exit(1)


def uses_graphs(settings: Settings, team: Team) -> bool:
    """Whether what is repeated is recorded as CUDA graphs."""
    return settings.get("compile") in (None, "graphs") and team.device.type == "cuda"


def compiled(model: torch.nn.Module, settings: Settings, team: Team) -> Callable:
    mode = settings.get("compile") or "disable"
    if mode == "graphs" or uses_graphs(settings, team):
        return Graphs(model, settings, team)
    return model if mode == "disable" else torch.compile(model, mode=mode)


class Graphs:
    """A model whose forward and backward passes are recorded as CUDA graphs, one pair for each size
    of its input: a step of small networks is a thousand kernels, which take longer to launch than
    to run."""

    class Part(torch.nn.Module):
        """What is recorded has to be a module of its own, or the model's forward is replaced."""

        def __init__(self, model: torch.nn.Module):
            super().__init__()
            self.model = model

        def forward(self, x: Tensor) -> Tensor:
            return self.model(x)

    def __init__(self, model: torch.nn.Module, settings: Settings, team: Team):
        if team.device.type != "cuda":
            raise ToolError("--compile graphs needs a cuda device", USAGE)
        self.model, self.type, self.parts = model, precision(settings, "cuda"), {}

    def __call__(self, x: Tensor) -> Tensor:
        if x.shape not in self.parts:
            # Weights in lower precision must be made anew in every step: nothing is cached.
            with torch.autocast("cuda", self.type, self.type is not None, cache_enabled=False):
                self.parts[x.shape] = torch.cuda.make_graphed_callables(
                    self.Part(self.model), (torch.rand_like(x),))
        return self.parts[x.shape](x)


def precision(settings: Settings, device: str) -> torch.dtype | None:
    """In which convolutions are computed, if not in fp32."""
    wanted = settings.precision or ("mixed" if device == "cuda" else "fp32")
    if wanted == "mixed" and device != "cuda":
        raise ToolError("--precision mixed needs a cuda device; bf16 does not", USAGE)
    return {"mixed": torch.float16, "bf16": torch.bfloat16}.get(wanted)


class Mixed:
    """Autocast: fp16 with a gradient scaler on CUDA, bf16 anywhere, or none."""

    def __init__(self, settings: Settings, team: Team):
        self.device = team.device.type
        self.type = precision(settings, self.device)
        self.scaler = torch.amp.GradScaler("cuda") if self.type == torch.float16 else None

    def autocast(self):
        if self.type is None:
            return contextlib.nullcontext()
        return torch.autocast(self.device, self.type)

    def backward(self, loss: Tensor) -> None:
        (loss if self.scaler is None else self.scaler.scale(loss)).backward()

    def step(self, optimizer: Optimizer, clip: float = 0.0) -> None:
        """A step of the optimiser; clip: largest norm of the gradient, 0: any."""
        optimizer.take_gradients()
        for part in optimizer.parts if self.scaler is not None and clip > 0 else ():
            self.scaler.unscale_(part)
        if clip > 0:
            torch.nn.utils.clip_grad_norm_(
                [p for part in optimizer.parts for g in part.param_groups for p in g["params"]],
                clip)
        for part in optimizer.parts:
            part.step() if self.scaler is None else self.scaler.step(part)
        if self.scaler is not None:
            self.scaler.update()

    def state(self) -> dict | None:
        return None if self.scaler is None else self.scaler.state_dict()

    def load(self, state: dict | None) -> None:
        if self.scaler is not None and state:
            self.scaler.load_state_dict(state)
