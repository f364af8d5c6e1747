"""Coverage-guided damage: `python tests/reliability/guided.py READER [libFuzzer options]`, such as -runs=100000.

READER is a function of readers.py. It needs atheris (`pip install atheris`), which is no dependency of relight. What
breaks a reader is left as a crash-* file: put it into found/ as READER-<what it is>, and it is tested for ever.
"""

import sys
import tempfile
from pathlib import Path

import atheris
import readers

from relight.core.errors import UserError


def main() -> None:
    reader, *options = sys.argv[1:]
    read = getattr(readers, reader)
    with tempfile.TemporaryDirectory() as folder:
        with atheris.instrument_imports(include=["relight", "readers"]):
            whole = readers.write_whole(Path(folder))[reader]
            for path in whole:
                read(str(path))  # imports what it needs
        corpus = Path(folder) / "corpus"
        corpus.mkdir()
        for path in whole:
            (corpus / path.name).write_bytes(path.read_bytes())
        place = Path(folder) / f"fuzzed{whole[0].suffix}"

        def one(data: bytes) -> None:
            place.write_bytes(data)
            try:
                read(str(place))
            except UserError as error:
                assert "\n" not in str(error)

        atheris.Setup([sys.argv[0], *options, str(corpus)], one)
        atheris.Fuzz()


if __name__ == "__main__":
    main()
