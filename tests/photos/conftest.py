"""A photo and its soft mask, and the commands."""

import flatbuffers
import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

from relight.photos.mask import networks


@pytest.fixture(scope="session")
def relighter(weights):
    from relight.photos.api import load

    return load(weights, threads=1)


@pytest.fixture(scope="session")
def run():
    from relight.cli import app

    def run(*words):
        result = CliRunner().invoke(app, [str(word) for word in words], catch_exceptions=False)
        assert result.exit_code == 0, result.output
        return result.output

    return run


@pytest.fixture(scope="session", name="draw")
def drawing():
    return draw


@pytest.fixture(autouse=True)
def own_data(tmp_path, monkeypatch):
    """No test sees or changes the networks that the user has set up."""
    monkeypatch.setenv("RELIGHT_DATA", str(tmp_path / "data"))
    networks.load_network.cache_clear()


def draw(height=180, width=140, seed=0):
    """A photo (H,W,3) uint8 full of detail and of all 256 codes, and a soft mask (H,W) uint8 of an upright figure."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[:height, :width]
    photo = np.stack([x * 255 // width, y * 255 // height, (x + y) * 255 // (height + width)], -1)
    photo = np.clip(photo + rng.integers(-20, 20, photo.shape), 0, 255).astype(np.uint8)
    reach = np.hypot((x - width * 0.45) / (0.2 * width), (y - height * 0.55) / (0.4 * height))
    return photo, np.clip((1.05 - reach) * 255 / 0.1, 0, 255).astype(np.uint8)


@pytest.fixture
def photo_files(tmp_path):
    pixels, mask = draw()
    Image.fromarray(pixels).save(tmp_path / "me.png")
    Image.fromarray(mask).save(tmp_path / "me_mask.png")
    return tmp_path / "me.png", tmp_path / "me_mask.png", pixels, mask


TENSORS = {np.dtype(np.float32): 0, np.dtype(np.float16): 1, np.dtype(np.int32): 2}  # types, as in schema.fbs
CUSTOM = 32


@pytest.fixture(name="tflite")
def writer():
    return Writer


class Writer:
    """Gathers tensors and operations; `bytes` is the file."""

    def __init__(self):
        self.tensors, self.operations, self.codes = [], [], []

    def tensor(self, values=None, shape=None, sparsity=None):
        """values: held by the file, of that shape if `sparsity`, the fields of a table, says which are left out."""
        self.tensors.append((None if values is None else np.ascontiguousarray(values), shape, sparsity))
        return len(self.tensors) - 1

    def sparse(self, values):
        """A tensor whose rows along its last axis hold their numbers that are not 0, with their columns."""
        rows = values.reshape(-1, values.shape[-1])
        ends = np.concatenate([[0], np.cumsum((rows != 0).sum(1))]).astype(np.uint16)
        columns = {2: ("Uint8", 2), 3: {0: ends}, 4: ("Uint8", 3), 5: {0: np.nonzero(rows)[1].astype(np.uint8)}}
        dense = [{1: ("Int32", n)} for n in values.shape[:-1]]
        return self.tensor(rows[rows != 0], values.shape, {2: [*dense, {0: ("Int8", 1)} | columns]})

    def operation(self, code, inputs, options=()):
        """options: (field, "Int8" | "Int32", value); code: a number, or the name of a custom operation."""
        out = self.tensor(shape=[1])
        if code not in self.codes:
            self.codes.append(code)
        self.operations.append((self.codes.index(code), inputs, [out], options))
        return out

    def bytes(self, first, *lasts):
        tensors, buffers = [], [{}]
        for values, shape, sparsity in self.tensors:
            if values is None:
                tensors.append({0: np.array(shape, np.int32)})
            else:
                kind, place = ("Int8", TENSORS[values.dtype]), ("Uint32", len(buffers))
                fields = {0: np.array(shape or values.shape, np.int32), 1: kind, 2: place}
                tensors.append(fields | ({6: sparsity} if sparsity else {}))
                buffers.append({0: values.tobytes()})
        codes, operations = [], []
        for code in self.codes:
            number = CUSTOM if isinstance(code, str) else code
            codes.append({0: ("Int8", number), 3: ("Int32", number)} | ({1: code} if number is CUSTOM else {}))
        for code, inputs, outputs, options in self.operations:
            fields = {0: ("Uint32", code), 1: np.array(inputs, np.int32), 2: np.array(outputs, np.int32)}
            chosen = {field: (kind, value) for field, kind, value in options}
            operations.append(fields | ({3: ("Uint8", 1), 4: chosen} if options else {}))
        ends = {1: np.array([first], np.int32), 2: np.array(lasts, np.int32)}
        b = flatbuffers.Builder(1024)
        b.Finish(put(b, {1: codes, 2: [{0: tensors, **ends, 3: operations}], 4: buffers}), file_identifier=b"TFL3")
        return bytes(b.Output())


def put(b, value):
    """The place of a table (its fields by number, plain ones with their kinds), a list of tables, numbers or a text."""
    if isinstance(value, dict):
        refers = "UOffsetTRelative"
        fields = {n: each if isinstance(each, tuple) else (refers, put(b, each)) for n, each in value.items()}
        b.StartObject(max(fields, default=0) + 1)
        for field, (kind, number) in fields.items():
            getattr(b, f"Prepend{kind}Slot")(field, number, 0)
        return b.EndObject()
    if isinstance(value, list):
        places = [put(b, each) for each in value]
        b.StartVector(4, len(places), 4)
        for place in reversed(places):
            b.PrependUOffsetTRelative(place)
        return b.EndVector()
    return {str: b.CreateString, bytes: b.CreateByteVector, np.ndarray: b.CreateNumpyVector}[type(value)](value)
