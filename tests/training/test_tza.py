"""TZA files: what is written is read again, sizes, damage."""

import numpy as np
import pytest

from export.tza import Reader, TzaError, Writer, write_weights
from training import nets


def test_tza_round_trip_and_layout(tmp_path):
    rng = np.random.default_rng(0)
    arrays = {"a": rng.random((3, 2, 3, 3), np.float32), "b": rng.random(5).astype(np.float16),
              "c": rng.integers(-9, 9, (2, 2, 3, 3), np.int8), "d": np.arange(7, dtype=np.uint8)}
    with Writer(tmp_path / "x.tza") as w:
        for name, array in arrays.items():
            w.write(name, array)
    file = Reader(tmp_path / "x.tza")
    assert list(file) == list(arrays)
    for name, array in arrays.items():
        assert np.array_equal(file[name], array) and file[name].dtype == array.dtype
    data = (tmp_path / "x.tza").read_bytes()
    assert data[:4] == b"\xd7\x41\x02\x00" and int.from_bytes(data[4:12], "little") % 64 == 0
    assert data[64:64 + 4] == arrays["a"].tobytes()[:4]


def test_size_of_a_known_file(tmp_path):
    """The base and small networks of OIDN have these sizes to the byte."""
    for model, inputs, size in (("unet_small", 9, 641480), ("unet", 3, 1830792)):
        tensors = {k: v.numpy() for k, v in nets.build(model, inputs).state_dict().items()}
        write_weights(tmp_path / "x.tza", tensors)
        assert (tmp_path / "x.tza").stat().st_size == size


def test_broken_tza_files_are_refused(tmp_path):
    path = tmp_path / "x.tza"
    write_weights(path, {"a.weight": np.zeros((2, 2, 3, 3)), "a.bias": np.zeros(2)})
    good = path.read_bytes()
    table = int.from_bytes(good[4:12], "little")
    broken = [good[:n] for n in range(0, len(good), 7)] + [
        b"XX" + good[2:], good[:2] + b"\3" + good[3:],
        good[:4] + (1 << 60).to_bytes(8, "little") + good[12:],
        good[:table] + b"\xff\xff\xff\xff" + good[table + 4:], good.replace(b"h@", b"q@")]
    for data in broken:
        path.write_bytes(data)
        with pytest.raises(TzaError):
            Reader(path)
    with pytest.raises(TzaError, match="twice"), Writer(path) as w:
        w.write("a", np.zeros(1, np.float32))
        w.write("a", np.zeros(1, np.float32))
