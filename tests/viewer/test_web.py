import subprocess
from pathlib import Path

from samples import node

TESTS = Path(__file__).parent / "web"


def test_javascript_passes_its_own_tests():
    files = map(str, sorted(TESTS.glob("*.test.js")))
    done = subprocess.run([node(), "--test", *files], cwd=TESTS, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout[-4000:] + done.stderr[-2000:]
