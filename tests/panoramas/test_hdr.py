import itertools

import numpy as np
import OpenImageIO
import pytest
from samples import rgbe

from relight.core.errors import UserError
from relight.panoramas.hdr import read_hdr


def decoded(stored):
    return np.where(stored[..., 3:] > 0, stored[..., :3] * 2.0 ** (stored[..., 3:].astype(float) - 136), 0)


def old_runs(line):
    """A scanline in old run-length coding: (1, 1, 1, n) repeats, counts over 255 in two steps."""
    out = b""
    for pixel, run in itertools.groupby(map(bytes, line)):
        more = len(list(run)) - 1
        counts = [more & 255, more >> 8][: (more > 0) + (more > 255)]
        out += pixel + b"".join(bytes([1, 1, 1, count]) for count in counts)
    return out


def new_runs(path, stored):
    height, width = stored.shape[:2]
    file = OpenImageIO.ImageOutput.create(str(path))
    assert file.open(str(path), OpenImageIO.ImageSpec(width, height, 3, "float"))
    assert file.write_image(decoded(stored).astype(np.float32)) and file.close()
    return path.read_bytes().partition(b"+X %d\n" % width)[2]


CODINGS = ("flat", "old", "new")


def picture(path, stored, coding="new", resolution=None, header=b"FORMAT=32-bit_rle_rgbe\n", newline=b"\n"):
    h, w = stored.shape[:2]
    resolution = resolution or f"-Y {h} +X {w}"
    body = stored.tobytes() if coding == "flat" else b"".join(map(old_runs, stored))
    body = new_runs(path, stored) if coding == "new" else body
    text = (b"#?RADIANCE\n" + header).replace(b"\n", newline) + newline
    path.write_bytes(text + resolution.encode() + b"\n" + body)
    return path


def scene(h=12, w=700, seed=0):
    """Noise, long runs, black, and runs over 255 pixels: all that the codings know."""
    rng = np.random.default_rng(seed)
    pixels = rng.random((h, w, 3)) * 10.0 ** rng.uniform(-3, 4, (h, w, 1))
    pixels[:, 100:500] = pixels[:, 100:101]
    pixels[h // 2, 20:60] = 0
    return rgbe(pixels)


@pytest.mark.parametrize("coding", CODINGS)
@pytest.mark.parametrize("width", [1, 7, 8, 129, 700, 40000])
def test_every_coding_is_read_to_the_last_bit_at_the_widths_at_its_edges(tmp_path, coding, width):
    stored = scene(4, max(width, 600))[:, :width]
    coding = "flat" if coding == "new" and not 8 <= width < 32768 else coding
    pixels, notes = read_hdr(picture(tmp_path / "a.hdr", stored, coding))
    np.testing.assert_array_equal(pixels, decoded(stored).astype(np.float32))
    assert pixels.dtype == np.float32 and notes == []


@pytest.mark.parametrize("sy, sx, order", list(itertools.product("+-", "+-", ("YX", "XY"))))
def test_all_eight_orientations(tmp_path, sy, sx, order):
    """-Y: rows go down; +X: columns go right; the axis named first is the slow one. All show the same picture."""
    upright = scene(6, 20)
    stored = upright[::-1] if sy == "+" else upright
    stored = stored[:, ::-1] if sx == "-" else stored
    if order == "XY":
        stored = stored.transpose(1, 0, 2)
    resolution = f"{sy}Y 6 {sx}X 20" if order == "YX" else f"{sx}X 20 {sy}Y 6"
    pixels, _ = read_hdr(picture(tmp_path / "a.hdr", stored, "flat", resolution))
    np.testing.assert_array_equal(pixels, decoded(upright).astype(np.float32))


def test_xyz_is_converted(tmp_path):
    stored = rgbe(np.full((2, 8, 3), (0.9505, 1.0, 1.0891)))
    pixels, notes = read_hdr(picture(tmp_path / "a.hdr", stored, header=b"FORMAT=32-bit_rle_xyze\n"))
    np.testing.assert_allclose(pixels, 1, atol=0.02)  # the white of Rec. 709; eight-bit mantissas
    assert notes == ["converted from XYZ"]


WRONG = {
    "no end of header": b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n" + b"x" * 100,
    "same axis twice": b"#?RADIANCE\n\n-Y 2 +Y 2\n" + bytes(16),
    "no size": b"#?RADIANCE\n\n-Y +X 2\n" + bytes(16),
    "no pixels": b"#?RADIANCE\n\n-Y 0 +X 2\n" + bytes(16),
    "absurd size": b"#?RADIANCE\n\n-Y 999999999 +X 999999999\n" + bytes(16),
    "size that overflows": b"#?RADIANCE\n\n-Y 4294967552 +X 256\n" + bytes(16),
    "too short for its size": b"#?RADIANCE\n\n-Y 4096 +X 8192\n" + bytes(16),
    "cut in a flat line": b"#?RADIANCE\n\n-Y 2 +X 4\n" + bytes(31),
    "literal of nothing": b"#?RADIANCE\n\n-Y 1 +X 8\n\2\2\0\10" + bytes([0] + [128 + 8, 1] * 4),
    "run over the edge": b"#?RADIANCE\n\n-Y 1 +X 8\n\2\2\0\10" + bytes([128 + 9, 1] * 4),
    "another width": b"#?RADIANCE\n\n-Y 1 +X 8\n\2\2\0\11" + bytes([128 + 8, 1] * 4),
    "old run of nothing before it": b"#?RADIANCE\n\n-Y 1 +X 8\n\1\1\1\7" + bytes(28),
    "old run over the edge": b"#?RADIANCE\n\n-Y 1 +X 8\n\5\5\5\200\1\1\1\10" + bytes(28),
}  # fmt: skip


@pytest.mark.parametrize("what", WRONG)
def test_what_is_not_whole_is_refused(tmp_path, what):
    path = tmp_path / "a.hdr"
    path.write_bytes(WRONG[what])
    with pytest.raises(UserError, match=r"not a whole|8192|has pixels"):
        read_hdr(path)


def test_the_page_reads_what_is_read_here_and_refuses_the_rest(on_the_page, tmp_path):
    """The viewer's reader in JavaScript, to the last bit: every coding, widths at its edges, orientations."""
    whole = [(scene(6, 600)[:, :width], coding, None) for width in (8, 129, 600) for coding in CODINGS]
    whole += [(scene(2, 600)[:, :7], coding, None) for coding in ("flat", "old")]
    for sy, sx in itertools.product("+-", repeat=2):
        whole += [(scene(6, 20), "flat", resolution) for resolution in (f"{sy}Y 6 {sx}X 20", f"{sx}X 6 {sy}Y 20")]
    files = [picture(tmp_path / "a.hdr", *each).read_bytes() for each in whole]
    answers = on_the_page([*files, *WRONG.values()])
    assert all(pixels is None for pixels, *_ in answers[len(files) :])
    for number, (pixels, shape, _) in enumerate(answers[: len(files)]):
        np.testing.assert_array_equal(np.float32(pixels).reshape(shape), read_hdr(tmp_path / f"{number}.hdr")[0])
