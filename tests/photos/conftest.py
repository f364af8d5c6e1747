"""A photo and its soft mask, and the commands."""

import flatbuffers
import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

from relight.photos.mask import selfie


@pytest.fixture(scope="session")
def relighter(weights):
    from relight.photos.api import load

    return load(weights, threads=1)


@pytest.fixture(scope="session")
def run():
    """The function that runs a command and returns its output, or raises what the command raised."""
    from relight.cli import app

    def run(*words):
        result = CliRunner().invoke(app, [str(word) for word in words])
        if result.exception and not isinstance(result.exception, SystemExit):
            raise result.exception
        assert result.exit_code == 0, result.output
        return result.output

    return run


@pytest.fixture(scope="session", name="draw")
def drawing():
    """The function that draws a photo and its mask."""
    return draw


@pytest.fixture(autouse=True)
def own_data(tmp_path, monkeypatch):
    """No test sees or changes the networks that the user has set up."""
    monkeypatch.setenv("RELIGHT_DATA", str(tmp_path / "data"))
    selfie.load_network.cache_clear()


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
    """me.png, me_mask.png and their arrays."""
    pixels, mask = draw()
    Image.fromarray(pixels).save(tmp_path / "me.png")
    Image.fromarray(mask).save(tmp_path / "me_mask.png")
    return tmp_path / "me.png", tmp_path / "me_mask.png", pixels, mask


TENSORS = {np.dtype(np.float32): 0, np.dtype(np.float16): 1, np.dtype(np.int32): 2}  # types, as in schema.fbs
CUSTOM = 32


@pytest.fixture(name="tflite")
def writer():
    """The class that writes TensorFlow Lite files."""
    return Writer


class Writer:
    """Gathers tensors and operations; `bytes` is the file."""

    def __init__(self):
        self.tensors, self.operations, self.codes = [], [], []

    def tensor(self, values=None, shape=None):
        self.tensors.append((None if values is None else np.ascontiguousarray(values), shape))
        return len(self.tensors) - 1

    def operation(self, code, inputs, options=()):
        """options: (field, "Int8" | "Int32", value); code: a number, or the name of a custom operation."""
        out = self.tensor(shape=[1])
        if code not in self.codes:
            self.codes.append(code)
        self.operations.append((self.codes.index(code), inputs, [out], options))
        return out

    def bytes(self, first, last):
        b = flatbuffers.Builder(1024)

        def offsets(values):
            b.StartVector(4, len(values), 4)
            for value in reversed(values):
                b.PrependUOffsetTRelative(value)
            return b.EndVector()

        def table(count, fields):
            b.StartObject(count)
            for field, kind, value in fields:
                getattr(b, f"Prepend{kind}Slot")(field, value, 0)
            return b.EndObject()

        def numbers(values):
            return b.CreateNumpyVector(np.asarray(values, np.int32))

        def reference(field, value):
            return field, "UOffsetTRelative", value

        buffers, tensors = [table(1, [])], []
        for values, shape in self.tensors:
            stored = 0
            if values is not None:
                data = b.CreateByteVector(values.tobytes())
                buffers.append(table(1, [reference(0, data)]))
                stored = len(buffers) - 1
            sizes = numbers(values.shape if values is not None else shape)
            kind = TENSORS[values.dtype] if values is not None else 0
            tensors.append(table(4, [reference(0, sizes), (1, "Int8", kind), (2, "Uint32", stored)]))
        codes = []
        for code in self.codes:
            if isinstance(code, str):
                name = b.CreateString(code)
                codes.append(table(4, [(0, "Int8", CUSTOM), reference(1, name), (3, "Int32", CUSTOM)]))
            else:
                codes.append(table(4, [(0, "Int8", code), (3, "Int32", code)]))
        operations = []
        for code, inputs, outputs, options in self.operations:
            fields = [(0, "Uint32", code), reference(1, numbers(inputs)), reference(2, numbers(outputs))]
            if options:
                fields += [(3, "Uint8", 1), reference(4, table(8, options))]
            operations.append(table(7, fields))
        lists = offsets(tensors), numbers([first]), numbers([last]), offsets(operations)
        graph = table(5, [reference(field, value) for field, value in enumerate(lists)])
        lists = offsets(codes), offsets([graph]), offsets(buffers)
        model = table(5, [reference(1, lists[0]), reference(2, lists[1]), reference(4, lists[2])])
        b.Finish(model, file_identifier=b"TFL3")
        return bytes(b.Output())
