"""The reader of Radiance pictures that the viewer's page has."""

import json
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest
from samples import node

PAGE = Path(__file__).parents[2] / "relight/viewer/web/page/hdr.js"
SCRIPT = """import { readFileSync } from "node:fs";
    const { readHDR } = await import(process.argv[1]), found = [];
    for (let i = 0; i < Number(process.argv[3]); i++) {
      const { buffer, byteOffset, length } = readFileSync(`${process.argv[2]}/${i}.hdr`);
      try {
        const { pixels, width, height, note } = readHDR(buffer.slice(byteOffset, byteOffset + length));
        found.push([[...pixels], [height, width, 3], note]);
      } catch (error) { found.push([null, null, error.message]); }
    }
    console.log(JSON.stringify(found));"""


@pytest.fixture
def on_the_page(tmp_path) -> Callable[[list[bytes]], list]:
    """The function that returns pixels, shape and note of each file by the page's JavaScript; without pixels, the
    note is the error. The files are 0.hdr, 1.hdr and so on in `tmp_path`."""
    program = node()

    def read(files: list[bytes]) -> list:
        for number, data in enumerate(files):
            (tmp_path / f"{number}.hdr").write_bytes(data)
        command = [program, "--input-type=module", "-e", SCRIPT, PAGE.as_uri(), str(tmp_path), str(len(files))]
        return json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)

    return read
