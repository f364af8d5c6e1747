"""What is printed where a terminal or a file cannot show every character; and how commands end."""

import os
import signal
import subprocess
import sys
import time

import pytest

from relight.cli import main
from relight.core.files import atomic_write
from relight.lights import load

C = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
# environment -> the bytes of a degree sign, and of the name of a file that is not UTF-8
TERMINALS = {
    "the C locale without UTF-8": (C, b"?", b"K?.hdr"),
    "Latin-1": ({"PYTHONIOENCODING": "latin-1"}, b"\xb0", b"K?.hdr"),
    "the C locale": ({"LC_ALL": "C"}, b"\xc2\xb0", b"K\xf6.hdr"),
    "UTF-8": ({"PYTHONIOENCODING": "utf-8"}, b"\xc2\xb0", b"K\xf6.hdr"),
}


@pytest.mark.parametrize("name", TERMINALS)
def test_a_light_is_printed_on_every_terminal(tmp_path, name):
    environment, degree, file = TERMINALS[name]
    path = os.fsencode(tmp_path) + b"/K\xf6.hdr"
    pixels = bytes([200, 100, 50, 128] * 4 + [9, 9, 9, 128] * 4)
    with open(path, "wb") as panorama:
        panorama.write(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 2 +X 4\n" + pixels)
    given = ("LC_", "LANG", "PYTHONUTF8", "PYTHONIO")
    kept = {key: value for key, value in os.environ.items() if not key.startswith(given)}
    command = [os.fsencode(sys.executable), b"-m", b"relight.cli", b"light", path]
    done = subprocess.run(command, capture_output=True, env={**kept, **environment, "COLUMNS": "300"})
    assert done.returncode == 0, done.stderr.decode(errors="replace")[-2000:]
    assert b"/" + file in done.stdout
    assert b"+90" + degree in done.stdout  # the light comes from above


def test_ctrl_c_ends_a_command_with_one_line(monkeypatch, capsys):
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(load, "load_light", interrupted)
    monkeypatch.setattr(sys, "argv", ["relight", "light", "room:7"])
    with pytest.raises(SystemExit) as ended:
        main()
    assert (ended.value.code, capsys.readouterr().err) == (130, "interrupted\n")


def test_a_command_that_is_ended_leaves_no_hidden_file(monkeypatch, tmp_path):
    def ended(*_, **__):
        with atomic_write(tmp_path / "light.json") as path:
            path.write_text("half of it")
            os.kill(os.getpid(), signal.SIGTERM)
            time.sleep(60)

    before = signal.getsignal(signal.SIGTERM)
    monkeypatch.setattr(load, "load_light", ended)
    monkeypatch.setattr(sys, "argv", ["relight", "light", "room:7"])
    try:
        with pytest.raises(SystemExit) as told:
            main()
    finally:
        signal.signal(signal.SIGTERM, before)
    assert told.value.code == 143 and not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "words, form", [("photo a.jpg --turn 90deg", "--turn 2"), ("movie a --size 9px", "--size 1080")]
)
def test_what_is_no_number_is_answered_with_the_right_form(monkeypatch, capsys, words, form):
    monkeypatch.setattr(sys, "argv", ["relight", *words.split()])
    with pytest.raises(SystemExit):
        main()
    said = " ".join(capsys.readouterr().err.replace("\u2502", " ").split())
    assert f"Invalid value for '{form.split()[0]}': give a number alone, without a unit, such as {form}" in said
