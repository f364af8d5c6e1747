import subprocess
from pathlib import Path

import pytest
from samples import node

from relight.viewer.build import PAGE
from relight.viewer.bundle import bundle
from relight.viewer.site import STUDIO


def write(folder, **modules):
    for name, text in modules.items():
        (folder / f"{name}.js").write_text(text)
    return folder / "main.js"


def test_each_module_runs_once_before_those_that_import_it_and_keeps_its_names(tmp_path):
    main = write(
        tmp_path,
        base="const hidden = 1, log = [];\nexport function note(text) { log.push(text); return log; }\n",
        left='import { note } from "./base.js";\nconst hidden = "left";\nnote(hidden);\nexport const one = 1;\n',
        right='import { note } from "./base.js";\nconst hidden = "right", two = 2;\nnote(hidden);\nexport { two };\n',
        main='import { one } from "./left.js";\nimport { two } from "./right.js";\nimport { note } from "./base.js";\n'
        "console.log(JSON.stringify([...note(one + two), typeof hidden]));\n",
    )
    done = subprocess.run([node(), "-e", bundle(main)], capture_output=True, text=True, check=True)
    assert done.stdout == '["left","right",3,"undefined"]\n'


def test_what_cannot_be_bundled_is_refused(tmp_path):
    base = "export const one = 1;\n"
    for message, modules in {
        "imports two, which base.js does not export": {"main": 'import { two } from "./base.js";\n', "base": base},
        "not supported: export default": {"main": "export default 1;\n"},
        "not supported: import": {"main": 'import * as base from "./base.js";\n', "base": base},
    }.items():
        with pytest.raises(ValueError, match=message):
            bundle(write(tmp_path, **modules))


def test_pages_use_all_of_their_modules():
    page, site, worker = (bundle(path) for path in (PAGE / "main.js", STUDIO / "studio.js", STUDIO / "worker.js"))
    for path in PAGE.glob("*.js"):
        assert page.count(f"const ${path.stem} = ") == site.count(f"const ${path.stem} = ") == 1, path.name
    for path in STUDIO.glob("*.js"):
        if path.name != "sw.js":
            assert (site + worker).count(f"const ${path.stem} = ") == 1, path.name


def test_javascript_passes_its_own_tests():
    tests = Path(__file__).parent / "web"
    words = [node(), "--test", *map(str, sorted(tests.glob("*.test.js")))]
    done = subprocess.run(words, cwd=tests, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout[-4000:] + done.stderr[-2000:]
