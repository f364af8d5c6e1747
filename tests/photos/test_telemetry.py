"""onnxruntime from 1.31 on keeps an id of the machine and events to send, unless it is told before its import."""

import os
import subprocess
import sys
from pathlib import Path

from PIL import Image

WEB = Path(__file__).parents[2] / "relight/viewer/web"


def test_nothing_is_kept_to_be_sent(tmp_path):
    for picture in ("astronaut.jpg", "astronaut_mask.png"):
        small = Image.open(WEB / picture).resize((96, 96))
        small.save(tmp_path / picture.replace("astronaut", "me").replace("jpg", "png"))
    environment = {key: value for key, value in os.environ.items() if not key.startswith("ORT_")}
    for variable in ("HOME", "XDG_CACHE_HOME", "XDG_DATA_HOME", "TMPDIR", "LOCALAPPDATA"):
        environment[variable] = str(tmp_path / variable)
        (tmp_path / variable).mkdir()
    program = "import relight; relight.load().relight('me.png', light='room:7')"
    subprocess.run([sys.executable, "-c", program], env=environment, cwd=tmp_path, check=True, capture_output=True)
    kept = {str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*") if path.is_file()}
    assert kept == {"me.png", "me_mask.png"}
