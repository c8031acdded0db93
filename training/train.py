#!/usr/bin/env python3
"""Train a denoising network.

    python -m training.train hdr alb nrm -f RT -r my_result            (preprocessed data)
    python -m training.train hdr alb nrm --raw -D . -t renders --hold_out 12 -m w16 \\
        -l l1_grad -b 8 --ts 64 --max_lr 5e-3 --time-budget 30m        (raw folder, in memory)
    python -m training.train -c training/configs/k16.json -D data -t train -r k16 \\
        --time-budget 30m --quantize_aware 500                         (kernel prediction, int8)
    torchrun --nproc_per_node=4 -m training.train ...                  (data parallel, any device)

Running the same command again resumes: batch k depends only on the seed and k, the learning rate
only on the settings and k, and checkpoints hold the rest, so a resumed run equals an uninterrupted
one.
"""
from __future__ import annotations

if __name__ == "__main__" and not __package__:  # run as a file: go on as a module
    import runpy
    import sys
    sys.path[0] = __file__.rpartition("training")[0] or ".."
    sys.exit(runpy.run_module("training.train", run_name="__main__", alter_sys=True))

import math
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, nullcontext

import torch

from export.kernel import ALONE
from training import errors, parallel
from training.console import Bar, duration
from training.dead import REVIVED_UNTIL, Channels, report, revive
from training.errors import INTERRUPTED, STATE, ToolError
from training.integer_stage import quantize_aware
from training.interrupt import Interrupted, Interrupts
from training.loss import balance, loss_of_settings
from training.nets import convolutions
from training.optimizer import Optimizer
from training.pictures import make_batches, open_data
from training.result import Result, last_steps_of, load_tensors, make_model, weights_of
from training.schedule import Plan, one_cycle
from training.settings import Settings, parse, unique_id
from training.teacher import Teacher
from training.validate import Board, Scores, require_tiles, validate
from training.widths import fitted

# Settings that a resumed training may change; all others must be as they were.
FREE = {"config", "num_epochs", "num_valid_epochs", "num_save_epochs", "learning_rate",
        "max_learning_rate", "learning_rate_warmup", "num_loaders", "device", "device_id",
        "num_devices", "threads", "compile", "preproc_dir", "data_dir", "results_dir", "result",
        "valid_data", "time_budget", "init", "precision", "deterministic", "quality", "filter",
        "quantize_aware", "quantize_rate"}


def main(argv: list[str]) -> None:
    settings = parse("train", argv, __doc__)
    settings = settings.replace(result=settings.result or unique_id())
    parallel.launch(worker, settings)


@contextmanager
def flushed_denormals() -> Iterator[None]:
    """Numbers too small to be normal count as 0 meanwhile: momenta of dead channels end among them,
    and products with them take far longer."""
    before = float(torch.tensor(1e-38) * 0.01) == 0
    torch.set_flush_denormal(True)
    try:
        yield
    finally:
        torch.set_flush_denormal(before)


@flushed_denormals()
def worker(settings: Settings, team: parallel.Team) -> None:
    """One process of a training; `team` knows its rank, its device and how to average."""
    result = Result(settings.results_dir, settings.result)
    try:
        run_training(settings, team, result)
    finally:
        result.release()


def run_training(settings: Settings, team: parallel.Team, result: Result) -> None:
    """As worker; the first process claims the result."""
    say = print if team.rank == 0 else (lambda *a, **k: None)
    say(f"PyTorch: {torch.__version__}")
    say(f"Device: {team.device} x {team.world}")
    resuming = result.exists()
    if team.same(resuming) != resuming:
        raise ToolError(f"{result.folder}: not what the first process finds there; --results_dir "
                        "must be one folder for all machines", STATE)
    if resuming:
        settings = agree(settings, result.config(), say)

    # Data. Nothing is written before this has worked.
    pictures, valid, held_out = open_data(settings, say)
    require_tiles(valid, settings.tile_size)
    if resuming:
        agree_held_out(result, held_out)
    settings = settings.replace(held_out=held_out)
    batches = make_batches(pictures, settings, team)
    steps_per_epoch = batches.steps_per_epoch
    plan = Plan(settings.num_epochs * steps_per_epoch, settings.time_budget)

    # Model, averaged weights, optimiser, loss.
    torch.manual_seed(settings.seed)
    model = make_model(settings).to(team.device, memory_format=torch.channels_last)
    if settings.init and not resuming:
        weights, cut, added = fitted(model, weights_of(settings.init, settings.results_dir))
        load_tensors(model, weights, settings.init)
        steps = last_steps_of(settings.init, settings.results_dir)
        if steps not in (settings.bilateral, ALONE):
            say(f"{settings.init} has --bilateral {steps}, this training {settings.bilateral}")
        if cut:
            say(f"Channels of {settings.init} that weigh most: {', '.join(cut)}")
        if added:
            say(f"Channels that {settings.init} lacks: {', '.join(added)}")
    freeze(model, settings)
    weights = list(model.parameters())
    params = [p for p in weights if p.requires_grad]
    ema = [p.detach().clone() for p in weights] if settings.ema > 0 else []
    optimizer = Optimizer(params, settings.learning_rate, settings.optimizer,
                          as_graph=parallel.uses_graphs(settings, team))
    loss_of = loss_of_settings(settings)
    teacher = Teacher(settings, team.device) if settings.get("teacher") else None
    run = parallel.compiled(model, settings, team)
    mixed = parallel.Mixed(settings, team)
    channels = Channels(model)

    # State: the steps done, the seconds they took, the best validation, and whether the steps end
    # an epoch (or the training) whose validation is still to come.
    step, elapsed, best, ending = 0, 0.0, math.inf, False
    if resuming:
        state = result.load(device=team.device)
        load_tensors(model, state["model_state"], result.name)
        optimizer.load_state_dict(state["optimizer_state"])
        step = state.get("step", state["epoch"] * steps_per_epoch)
        elapsed, best = state.get("elapsed", 0.0), state.get("best", math.inf)
        ending = state.get("ending", False)
        if plan.budget and plan.budget == state.get("budget"):
            plan.planned, plan.since = state.get("planned"), state.get("since", (0, 0.0))
        if ema and state.get("ema_state"):
            ema = [state["ema_state"][k].clone() for k, _ in model.named_parameters()]
        mixed.load(state.get("scaler_state"))
        channels.load(state.get("channels", (None, 0)))
        say(f"Resuming result: {result.name} (epoch {step // steps_per_epoch})")
    else:
        say(f"Result: {result.name}")
    say(f"Training images: {len(batches.pairs)}")
    say(f"Validation images: {sum(len(p.inputs) for p in valid)}\n")
    if team.rank == 0:
        result.claim()
        if not (resuming and plan.over(step)):
            result.save_config(settings)

    def snapshot() -> dict:
        names = [k for k, _ in model.named_parameters()]
        return {"step": step, "elapsed": elapsed + time.monotonic() - start, "best": best,
                "ending": ending, "planned": plan.planned, "since": plan.since,
                "budget": plan.budget,
                "model_state": model.state_dict(), "optimizer_state": optimizer.state_dict(),
                "ema_state": dict(zip(names, ema)) if ema else None, "scaler_state": mixed.state(),
                "channels": channels.state()}

    def at_end() -> bool:
        return step % steps_per_epoch == 0 or plan.over(step)

    def end_epoch(pace: float | None = None) -> None:
        """What the end of an epoch or of the training brings; steps took `pace` seconds. Where a
        validation is interrupted, a resumed training does it again."""
        nonlocal best, ending
        epoch, finished = -(-step // steps_per_epoch), plan.over(step)
        judged = finished or due(epoch, settings.num_valid_epochs)
        dead = channels.dead()
        if dead is not None:
            if team.rank == 0:
                report(dead, board, epoch, aloud=judged)
            if plan.progress(step) < REVIVED_UNTIL:
                revive(model, dead, settings.seed + step)
        scores = judge() if valid and judged else None
        ending = False
        if scores:
            board.validation(epoch, scores)
            if scores.loss < best:
                best = scores.loss
                if team.rank == 0:
                    result.save_best(epoch, snapshot())
        if pace and plan.budget and plan.planned and not finished:
            remain = team.same(plan.budget - elapsed - (time.monotonic() - start))
            if plan.revise(step, remain, team.same(pace)):
                say(f"{plan.planned} steps fit now")
        if team.rank == 0 and (finished or due(epoch, settings.num_save_epochs)):
            result.save(epoch, snapshot())

    def judge() -> Scores:
        return validate(model, ema, valid, settings, loss_of, team, bar, interrupts.check)

    board = Board(result.folder / "log", settings, enabled=team.rank == 0)
    steps = range(step, step if plan.over(step) else plan.total)
    loader = parallel.loader(batches, steps, settings, team)
    bar, start = Bar(enabled=team.rank == 0), time.monotonic()
    loss_sum, loss_count, epoch_start = torch.zeros((), device=team.device), 0, start
    step_start, interrupts = start, Interrupts()
    try:
        if ending and at_end():
            end_epoch()
        for x, y in until_asked(loader, interrupts, team):
            # Learning rate and momentum: one cycle over the steps.
            rate, beta1 = one_cycle(plan.progress(step), settings)
            optimizer.schedule(rate, beta1)

            # One step.
            x = x.to(team.device, non_blocking=True)
            y = y.to(team.device, non_blocking=True)
            factor = balance(x, y, settings.balance) if settings.balance else None
            with mixed.autocast():
                if teacher:
                    y = teacher.target(x, y, step)
                out = run(x)
                if factor is not None:
                    out, y = out * factor, y * factor
                loss = loss_of(out, y)
            optimizer.zero_grad()
            mixed.backward(loss)
            team.average([p.grad for p in params])
            mixed.step(optimizer, settings.grad_clip)
            channels.watch()
            if ema:
                decay = min(settings.ema, (step + 1) / (step + 10))
                torch._foreach_lerp_(ema, [p.detach() for p in weights], 1 - decay)
            step += 1
            ending = at_end()
            loss_sum += loss.detach()
            loss_count += 1

            # A time budget: how many steps fit, once the first of them are timed.
            if plan.planned is None:
                now = time.monotonic()
                if team.same(plan.timed(now - step_start)):
                    if valid:
                        judge()
                    every = settings.num_valid_epochs * steps_per_epoch if valid else 0
                    left = plan.budget - elapsed - (time.monotonic() - start)
                    validation = team.same(time.monotonic() - now)
                    plan.planned = int(team.same(plan.estimate(
                        step, left, validation, max(every, 0))))
                    bar.end(f"{plan.planned} steps fit into {duration(plan.budget)}")
                step_start = time.monotonic()

            # Progress, and what happens at the end of an epoch or of the training.
            epoch, index = divmod(step - 1, steps_per_epoch)
            epoch += 1
            bar.show(f"Train {epoch:>4}/{settings.num_epochs}", (index + 1) / steps_per_epoch)
            if not ending:
                continue
            mean_loss = float(team.mean(loss_sum / loss_count))
            if not math.isfinite(mean_loss):
                raise ToolError(f"the loss is {mean_loss} in epoch {epoch}: lower --max_lr", STATE)
            now = time.monotonic()
            rate_images = loss_count * settings.batch_size / max(now - epoch_start, 1e-9)
            left = (elapsed + now - start) / step * ((plan.planned or plan.total) - step)
            bar.end(f"loss={mean_loss:.6f}, lr={rate:.3g} ({rate_images:.1f} images/s, "
                    f"{duration(now - epoch_start)}, eta {duration(left)})")
            board.scalars(epoch, loss=mean_loss, learning_rate=rate)
            end_epoch((now - epoch_start) / loss_count)
            loss_sum, loss_count, epoch_start = torch.zeros_like(loss_sum), 0, time.monotonic()
            if plan.over(step):
                break
        if team.any(interrupts.asked):
            raise Interrupted
    except Interrupted:
        if team.rank == 0 and step:
            result.save(step // steps_per_epoch, snapshot())
        team.wait()
        raise ToolError(f"interrupted after {step} steps; the same command resumes",
                        INTERRUPTED) from None
    finally:
        board.close()
        interrupts.close()
    say(f"Finished ({duration(time.monotonic() - start)})")
    if settings.quantize_aware and team.rank == 0:
        try:
            quantize_aware(result, settings, pictures, say)
        except KeyboardInterrupt:
            raise ToolError("interrupted in the integer stage; the same command resumes",
                            INTERRUPTED) from None


def freeze(model: torch.nn.Module, settings: Settings) -> None:
    """Makes the layers of --freeze constants. ToolError unless --init says what they are."""
    names = [x.name for x in convolutions(model)]
    for name in settings.freeze:
        if not settings.init:
            raise ToolError(f"--freeze {name}: without --init it would stay random", errors.USAGE)
        if name not in names:
            raise ToolError(f"--freeze {name}: no layer of the model ({', '.join(names)})",
                            errors.USAGE)
        getattr(model, name).requires_grad_(False)
    if not any(p.requires_grad for p in model.parameters()):
        raise ToolError("--freeze: nothing is left to train", errors.USAGE)


def until_asked(loader: Iterable, interrupts: Interrupts, team: parallel.Team) -> Iterator:
    """Batches of a loader; Interrupted before the one that follows a request in any process. While
    one process waits for a batch by itself, at once."""
    batches = iter(loader)
    while not team.any(interrupts.asked):
        with interrupts.at_once() if team.world == 1 else nullcontext():
            batch = next(batches, None)
        if batch is None:
            return
        yield batch
    raise Interrupted


def due(epoch: int, every: int) -> bool:
    return every > 0 and epoch % every == 0


def agree(settings: Settings, old: Settings, say) -> Settings:
    """Settings for resuming: what decides the result must be as it was; the rest may change."""
    changed = [k for k in settings if k in old and old.get(k) != settings.get(k)]
    if "seed" in changed:  # not given: the clock's
        settings = settings.replace(seed=old.seed)
        changed.remove("seed")
    fixed = [k for k in changed if k not in FREE]
    if fixed:
        text = ", ".join(f"{k} was {old.get(k)}, is {settings.get(k)}" for k in fixed)
        raise ToolError(f"result {settings.result} was started with other settings ({text}); "
                        "choose another --result", STATE)
    for k in changed:
        if k not in ("config", "result", "results_dir"):
            say(f"Changed setting: {k} was {old.get(k)}, is {settings.get(k)}")
    return settings


def agree_held_out(result: Result, held_out: list[str]) -> None:
    """Refuses to resume where other groups were held out: the data set is another one, and what the
    model has learnt might judge it."""
    before = result.config().get("held_out", held_out)  # older results do not say
    if before != held_out:
        raise ToolError(f"result {result.name} held out {', '.join(before)}; of the data set as it "
                        f"is now that would be {', '.join(held_out)}; choose another --result",
                        STATE)


if __name__ == "__main__":
    errors.run(main)

