"""The report's answer to "does knowing occlusion pay?": the sentence says what the comparisons say."""

from dataclasses import dataclass
from types import SimpleNamespace

import pytest

from relight.evaluation.report import page
from relight.evaluation.scoring.comparisons import Verdict


@dataclass
class Comparison:
    verdict: Verdict
    gain: float = 0.25
    interval: tuple[float, float] = (0.15, 0.35)


def answer(shading: Verdict, relit: Verdict, over_ao: Comparison | None = None) -> str:
    claims = {"shading_true_light_rmse": Comparison(shading), "relit_rmse": Comparison(relit, -0.09, (-0.12, -0.06))}
    scored = SimpleNamespace(trainings_range=(1, 1))
    return str(page.section("answer.md", name="claim", claims=claims, over_ao=over_ao, scored=scored))


@pytest.mark.parametrize(
    ("shading", "relit", "says"),
    [
        (Verdict.BETTER, Verdict.BETTER, "Yes, knowing occlusion pays."),
        (Verdict.BETTER, Verdict.OPEN, "for relit pictures this run is too small to decide"),
        (Verdict.BETTER, Verdict.EQUIVALENT, "relit pictures are equal"),
        (Verdict.BETTER, Verdict.WORSE, "but relit pictures worse in this run"),
        (Verdict.WORSE, Verdict.BETTER, "a network that infers normals shades better"),
        (Verdict.OPEN, Verdict.BETTER, "This run is too small to decide."),
        (Verdict.EQUIVALENT, Verdict.OPEN, "This run is too small to decide."),
    ],
)
def test_answer_says_what_the_comparisons_say(shading, relit, says):
    text = answer(shading, relit)
    assert says in text and "25 % (interval 15 to 35 %)" in text and "ambient-occlusion" not in text
    assert ("−9 % (interval −12 to −6 %)" in text) == (shading is Verdict.BETTER and relit is not Verdict.OPEN)


def test_answer_compares_transport_with_ambient_occlusion():
    undecided = answer(Verdict.BETTER, Verdict.OPEN, Comparison(Verdict.OPEN, 0.03, (-0.004, 0.07)))
    assert "the gain of transport is 3 % (interval 0 to 7 %), which this run does not decide." in undecided
    equal = answer(Verdict.BETTER, Verdict.OPEN, Comparison(Verdict.EQUIVALENT, 0.01, (-0.01, 0.02)))
    assert "is 1 % (interval −1 to 2 %), too small to matter." in equal
    decided = answer(Verdict.BETTER, Verdict.OPEN, Comparison(Verdict.BETTER, 0.12, (0.05, 0.2)))
    assert "the gain of transport is 12 % (interval 5 to 20 %)." in decided
