#!/usr/bin/env python3
"""Turn a raw data set into network codes, once, for any number of trainings.

    python -m training.preprocess hdr alb nrm -f RT -D data -t train -v valid
    python -m training.preprocess hdr alb nrm -t train --shard 2/8     (part 2 of 0..7, resumable)
"""
from __future__ import annotations

if __name__ == "__main__" and not __package__:  # run as a file: go on as a module
    import runpy
    import sys
    sys.path[0] = __file__.rpartition("training")[0] or ".."
    sys.exit(runpy.run_module("training.preprocess", run_name="__main__", alter_sys=True))

import hashlib
import json
import os
import shutil
from pathlib import Path

from export.tza import Writer
from training import errors, parallel
from training.auxiliary import Prefilter, load_prefilters, prefiltered
from training.data import load_group
from training.errors import DATA, OUTPUT, ToolError
from training.pictures import scan_set
from training.scan import CHANNELS, Scan
from training.settings import Settings, parse, unique_id


def main(argv: list[str]) -> None:
    settings = parse("preprocess", argv, __doc__)
    names = [n for n in (settings.train_data, settings.valid_data) if n]
    parallel.configure(settings)
    prefilters = load_prefilters(settings, parallel.open_device(settings))
    done = 0
    for name in names:
        root = Path(settings.data_dir) / name
        if not root.is_dir():
            print(f"{root}: not found, left out")
            continue
        done += preprocess(settings, name, prefilters) is not None
    if not done:
        raise ToolError(f"no data set found in {settings.data_dir} ({' '.join(names)})", DATA)


def preprocess(settings: Settings, name: str, prefilters: list[Prefilter]) -> Path | None:
    """Write one data set; returns its folder."""
    found = scan_set(settings, name)
    print("\n".join(found.summary()))
    folder = Path(settings.preproc_dir) / f"{name}.{_suffix(settings, name, found)}"
    if (folder / "config.json").exists():
        print(f"{folder}: done already")
        return folder
    groups = found.groups
    if settings.shard:
        groups = groups[settings.shard[0]::settings.shard[1]]
    work = folder.with_name(f".{folder.name}.{os.getpid()}")
    try:
        work.mkdir(parents=True)
    except OSError as e:
        raise ToolError(f"{work.parent}: cannot write ({e.strerror})", OUTPUT) from e
    try:
        count, left_out = _write(settings, groups, work, prefilters)
        if not count and not settings.shard:
            wanted = " ".join(settings.features)
            raise ToolError(f"{found.root}: no usable group for {wanted}", DATA)
        (work / "config.json").write_text(json.dumps(
            {**settings.to_dict(), "script": "preprocess", "data": name, "left_out": left_out},
            indent=2) + "\n")
        os.rename(work, folder)
    except OSError as e:
        if (folder / "config.json").exists():  # another process had the same part to do
            print(f"{folder}: done already")
            return folder
        raise ToolError(f"{folder}: cannot write ({e.strerror or e})", OUTPUT) from e
    finally:
        shutil.rmtree(work, ignore_errors=True)
    print(f"{folder}: {count} pairs")
    return folder


def _suffix(settings: Settings, name: str, found: Scan) -> str:
    """A new id per run; for shards one that all parts of the same work agree on: of the settings,
    and of the names, sizes and times of all files, so that changed renders are new work."""
    if not settings.shard:
        uid, count = unique_id(), 0
        while (Path(settings.preproc_dir) / f"{name}.{uid}").exists():
            count += 1  # a second set within a second, in one process
            uid = f"{unique_id()}.{count}"
        return uid
    keys = ("features", "transfer", "clean_aux", "aux_results", "layers")
    files = sorted(f for g in found.groups for v in (g.target, *g.inputs) for f in v.files.values())
    text = json.dumps([settings.get(k) for k in keys]
                      + [(f.relative_to(found.root).as_posix(), *_stamp(f)) for f in files])
    digest = hashlib.sha256(text.encode()).hexdigest()[:8]
    return f"{digest}.{settings.shard[0]}of{settings.shard[1]}"


def _stamp(path: Path) -> tuple[int, int]:
    """Size in bytes and time of the last change in ns; 0, 0 of what cannot be read."""
    try:
        stat = path.stat()
    except OSError:
        return 0, 0
    return stat.st_size, stat.st_mtime_ns


def _write(settings: Settings, groups: list, work: Path,
           prefilters: list[Prefilter]) -> tuple[int, list[str]]:
    """Write the images; returns the number of pairs, and the groups that could not be read."""
    samples, left_out = [], []
    with Writer(work / "images.tza") as out:
        for i, group in enumerate(groups):
            try:
                picture = load_group(group, settings.features, settings.main_feature,
                                     settings.transfer, settings.clean_aux, settings.layers, print)
            except ToolError as e:
                print(f"left out {group.name}: {e}")
                left_out.append(group.name)
                continue
            target_name = group.target.name
            print(f"[{i + 1}/{len(groups)}] {target_name}: {len(picture.inputs)} inputs",
                  flush=True)
            target = picture.target
            if not settings.clean_aux:
                target = target[..., :CHANNELS[settings.main_feature]]
            out.write(target_name, target, "hwc")
            for name, image in zip(picture.names, picture.inputs):
                out.write(name, prefiltered(image, settings.features, prefilters), "hwc")
                samples.append([name, target_name])
    (work / "samples.json").write_text(json.dumps(samples, indent=1) + "\n")
    return len(samples), left_out


if __name__ == "__main__":
    errors.run(main)
