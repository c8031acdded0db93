"""What a training sees: the pictures of its data sets, and batches of tiles of them."""
from __future__ import annotations

from pathlib import Path

from training import parallel
from training.augment import Augment
from training.auxiliary import load_prefilters, prefiltered
from training.data import Alternating, Batches, Picture, from_raw
from training.errors import DATA, ToolError
from training.scan import CHANNELS, Scan, hold_out, scan
from training.settings import Settings
from training.store import find_stored, read_pictures


def open_data(settings: Settings, say) -> tuple[list[Picture], list[Picture], list[str]]:
    """(training, validation) pictures, from preprocessed sets or, with --raw, from raw folders, and
    the names of the groups that --hold_out moves from the former to the latter."""
    if not settings.train_data:
        raise ToolError("no training images: --train_data is missing", DATA)
    pictures, names = open_set(settings, settings.train_data, say)
    if settings.mix_clean_aux and not any(p.target.shape[-1] > CHANNELS[settings.main_feature]
                                          for p in pictures):
        say("--mix_clean_aux: no reference has features"
            + ("" if settings.raw else " (preprocessed sets keep none; --raw does)"))
    valid = open_set(settings, settings.valid_data, say)[0] if settings.get("valid_data") else []
    count = settings.get("hold_out") or 0
    held_out = sorted(hold_out(names, count))
    held = [p for p in pictures if p.name in held_out]
    if len(held_out) < count:
        say(f"--hold_out {count}: only {len(held_out)} of so few are held out")
    if len(held) < len(held_out):
        say(f"--hold_out {count}: {len(held_out) - len(held)} of them cannot be read")
    return [p for p in pictures if p.name not in held_out], valid + held, held_out


def open_set(settings: Settings, name: str, say) -> tuple[list[Picture], list[str]]:
    """The pictures of a data set, and the names of all its groups, unreadable ones included."""
    if not settings.raw:
        stored = find_stored(settings, name)
        pictures = read_pictures(stored, settings.features, settings.main_feature,
                                 settings.clean_aux)
        return pictures, [*stored.left_out, *(p.name for p in pictures)]
    found = scan_set(settings, name)
    say("\n".join(found.summary()))
    return read_raw(found, settings, say), [g.name for g in found.groups]


def scan_set(settings: Settings, name: str) -> Scan:
    """A raw data set. With --clean_aux references have all features and inputs need none of them
    but the main one."""
    every, main = settings.features, [settings.main_feature]
    wanted = (main, every) if settings.clean_aux else (every, main)
    return scan(Path(settings.data_dir) / name, *wanted)


def read_raw(found: Scan, settings: Settings, say) -> list[Picture]:
    """The pictures of a raw data set, their inputs as preprocess would store them."""
    s, prefilters = settings, load_prefilters(settings)
    pictures = from_raw(found, s.features, s.main_feature, s.transfer, s.clean_aux, s.layers, say)
    for picture in pictures:
        picture.inputs = [prefiltered(x, s.features, prefilters) for x in picture.inputs]
    return pictures


def make_batches(pictures: list[Picture], settings: Settings,
                 team: parallel.Team) -> Batches | Alternating:
    s = settings

    def of(pictures: list[Picture], count: int, tile: int, seed: int) -> Batches:
        return Batches(pictures, s.features, s.main_feature, s.transfer, count, tile, seed,
                       Augment.of(s), s.clean_aux, team.rank, team.world, s.family)

    batches, every = of(pictures, s.batch_size, s.tile_size, s.seed), s.get("large_tiles")
    if not every:
        return batches
    side = 2 * s.tile_size
    large = [p for p in pictures if min(p.target.shape[:2]) >= side]
    if not large:
        raise ToolError(f"--large_tiles: no image is larger than {side - 1}x{side - 1}", DATA)
    return Alternating(batches, of(large, s.batch_size // 4, side, s.seed + 1), every)
