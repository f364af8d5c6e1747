import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from samples import lights_of

from relight.core.errors import UserError
from relight.lab import page
from relight.lights import write_light_set
from relight.maps import write_maps
from relight.viewer import build
from relight.viewer.build import build_viewer
from relight.viewer.figure import QUALITIES, Figure, embed, pack, smaller


def test_page_is_one_file_that_asks_the_network_for_nothing(tmp_path, maps, lights):
    title = "A & B </script><b>"
    build_viewer(tmp_path / "a.html", [Figure(title, maps)], lights, title=title)
    text = (tmp_path / "a.html").read_text()
    assert not re.search(r"""(src|href)\s*=\s*["'](?!data:)|@import|url\((?!data:)|https?://""", text)
    assert "<title>A &amp; B &lt;/script&gt;&lt;b&gt;</title>" in text
    assert text.count("</script>") == text.count("<script")
    assert not re.search(r"%(title|style|page|figures|fragment|script)%", text)
    assert json.loads(re.search(r'class="figure"[^>]*>(.*?)</script>', text, re.S)[1])["title"] == "A & B </script><b>"
    assert list(tmp_path.iterdir()) == [tmp_path / "a.html"]


@pytest.mark.parametrize("part", ["page/template.html", "studio/panel.html", "studio/stage.html"])
def test_a_label_has_one_control(part):
    """HTML allows one; `output` is one, too. The page and what a site adds to it, as they are read by a browser."""
    for label in re.findall(r"<label\b.*?</label>", (Path(build.__file__).parent / "web" / part).read_text(), re.S):
        assert len(re.findall(r"<(?:input|output|select|meter|progress|textarea|button)\b", label)) == 1, label


def test_refusals_name_what_is_wrong(tmp_path, maps, lights):
    out = tmp_path / "a.html"
    for message, change in {
        "at least one figure": {"figures": []},
        "at least one figure and one light": {"lights": {}},
        r"light 'a' is not \(9, 3\)": {"lights": {"a": np.zeros((16, 3))}},
        "finite": {"lights": {"a": np.full((9, 3), np.nan)}},
        "background 'sea'": {"background": "sea"},
    }.items():
        with pytest.raises(UserError, match=message):
            build_viewer(**{"out": out, "figures": [Figure("a", maps)], "lights": lights} | change)
    for message, change in (
        ("mask is empty", {"mask": 0 * maps.mask}),
        ("4 coeff", {"transport": np.ones((96, 96, 4))}),
    ):
        with pytest.raises(UserError, match=message):
            Figure("a", replace(maps, **change))
    assert not out.exists()


def test_a_network_that_has_not_learned_has_a_page(maps):
    wild = np.random.default_rng(0).normal(0, 1e4, maps.transport.shape).astype(np.float32)
    header, data = pack(Figure("wild", replace(maps, transport=wild)), QUALITIES[0])
    assert header["planes"][0]["name"] == "transport" and len(data) > header["planes"][0]["bytes"]


def test_a_tight_limit_costs_precision_and_then_pixels(tmp_path, maps, lights):
    figure = Figure("a", maps, np.clip(maps.albedo * 0.8, 0, 1), lights["Window"])
    sizes = [len(pack(figure, steps)[1]) for steps in (8192, 2048, 512)]
    assert sizes == sorted(sizes, reverse=True) and sizes[2] < 0.8 * sizes[0]
    build_viewer(tmp_path / "fine.html", [figure], lights)
    fine = (tmp_path / "fine.html").stat().st_size
    build_viewer(tmp_path / "coarse.html", [figure], lights, limit=fine - 1)
    assert (tmp_path / "coarse.html").stat().st_size < fine
    text = embed(figure, sizes[2])
    assert 0.6 * sizes[2] < len(text) <= sizes[2] and json.loads(text)["width"] < maps.mask.shape[1]
    half, layers = smaller(figure, 0.5).maps, np.dstack([maps.transport * maps.mask[..., None], maps.mask])
    *transport, count = np.moveaxis(layers.reshape(len(maps.mask) // 2, 2, -1, 2, 10).sum((1, 3)), -1, 0)
    expected = np.stack(transport, -1) / np.maximum(count, 1)[..., None]
    np.testing.assert_allclose(half.transport[half.mask], expected[half.mask], atol=1e-5)
    np.testing.assert_array_equal(half.mask, count >= 2)


@pytest.mark.slow
def test_the_page_of_a_run_shows_some_test_figures(tmp_path, maps):
    names = [f"g{i:04d}" for i in range(40)]
    files = [tmp_path / f"{name}.exr" for name in names]
    for name, file in zip(names, files):
        write_maps(file, replace(maps, info={"name": name, "order": 2}))
    (tmp_path / "split.json").write_text(json.dumps({"train": [], "test": names}))
    write_light_set(lights_of(["test"]), tmp_path)
    given = tmp_path / "split.json", files, tmp_path / "lights.npz", tmp_path / "a.html"
    page.viewer("a", {}, tmp_path / "packed", *given)  # no network: nothing but the truth
    few = re.findall(r'data-title="(g\d+)"', (tmp_path / "a.html").read_text())
    assert len(few) == page.MAX_FIGURES and few[0] == names[0] and few[-1] == names[-1] and few == sorted(set(few))
