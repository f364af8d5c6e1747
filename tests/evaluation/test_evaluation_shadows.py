import csv
from types import SimpleNamespace

import pytest
from PIL import Image

from relight.evaluation.occlusion import BINS
from relight.evaluation.report.shadows import occlusion, redraws


@pytest.fixture
def results(tmp_path):
    rows = [("a", "sitting", "jeans; shirt", 0.7, 0.2, 0.5), ("b", "walking", "jeans", 0.9, 0.02, 0.3)]
    with open(tmp_path / "occlusion.csv", "w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["name", "pose", "garments", "pixels", "ao", "dark", "lost", *range(BINS)])
        writer.writerows([*names, 100, *numbers, *[0.05] * BINS] for *names, a, b, c in rows for numbers in [(a, b, c)])
    Image.new("RGB", (8, 8)).save(tmp_path / "occlusion.png")
    return SimpleNamespace(report=tmp_path)


def test_occlusion_is_told_per_pose_and_garment_beside_the_paper(results):
    html = occlusion(results)
    assert "<b>0.800</b> (0.70 to 0.90)" in html and "<b>11.0%</b>" in html and "<b>0.40</b>" in html
    pose, garment, each = html.split("<details>")[1:]
    for part, first in ((pose, "sitting"), (garment, "shirt")):
        rows = part.split("<tr>")[2:]
        assert first in rows[0] and "all" in rows[-2] and "paper" in rows[-1]
        assert "0.83" in rows[-1] and "0.25" in rows[-1]
    jeans = next(row for row in garment.split("<tr>") if "jeans" in row)
    assert ">2<" in jeans and ">0.8<" in jeans and "0.70 to 0.90" in jeans
    assert "jeans, shirt" in each


def test_redraws_are_counted_and_their_reasons_gathered():
    stretched = ["t-shirt: stretched to 1.41 of its pattern", "coat: stretched to 1.52 of its pattern"]
    infos = {
        "g0": {"redrawn": 0, "redrawn_because": []},
        "g1": {"redrawn": 2, "redrawn_because": stretched},
        "g2": {"redrawn": 1, "redrawn_because": ["77 pixels of a lower layer show through the cloth"]},
        "g3": {"left_out": "no figure of seed 3 passed"},
    }
    html = redraws(infos)
    assert "<b>2 of 3</b>" in html and "3 draws in all" in html
    first, second = html.split("<tr>")[2:]
    assert "stretched to … of its pattern" in first and ">2<" in first and "t-shirt 1, coat 1" in first
    assert "… pixels of a lower layer" in second and ">1<" in second
    assert "All 1 generated figures passed" in redraws({"g0": infos["g0"]})
    assert redraws({"scan": {"name": "scan"}}) == ""
