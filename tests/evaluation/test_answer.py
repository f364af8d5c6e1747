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


def answer(bar: Verdict, constant: Verdict = Verdict.BETTER, over_ao: Comparison | None = None) -> str:
    told = {"bar": Comparison(bar), "constant": Comparison(constant, 0.4, (0.3, 0.5)), "over_ao": over_ao}
    scored = SimpleNamespace(trainings_range=(1, 1))
    return str(page.section("answer.md", name="claim", scored=scored, **told)).replace("\xa0", " ")


@pytest.mark.parametrize(("bar", "says"), [
    (Verdict.BETTER, "Yes, knowing occlusion pays."),
    (Verdict.WORSE, "has not learned enough to tell"),
    (Verdict.OPEN, "This run is too small to decide."),
    (Verdict.EQUIVALENT, "This run is too small to decide."),
])  # fmt: skip
def test_answer_says_what_the_comparison_with_true_normals_says(bar, says):
    text = answer(bar)
    assert says in text and "25 % (interval 15 to 35 %)" in text and "ambient-occlusion" not in text
    assert "a constant, it has 40 % (interval 30 to 50 %) less." in text


def test_answer_compares_transport_with_a_constant_and_with_ambient_occlusion():
    assert "It is no better than the mean training figure, a constant" in answer(Verdict.OPEN, Verdict.OPEN)
    undecided = answer(Verdict.BETTER, over_ao=Comparison(Verdict.OPEN, 0.03, (-0.004, 0.07)))
    assert "gains 3 % (interval 0 to 7 %), which this run does not decide." in undecided
    equal = answer(Verdict.BETTER, over_ao=Comparison(Verdict.EQUIVALENT, 0.01, (-0.01, 0.02)))
    assert "1 % (interval −1 to 2 %), too small to matter." in equal
    decided = answer(Verdict.BETTER, over_ao=Comparison(Verdict.BETTER, 0.12, (0.05, 0.2)))
    assert "gains 12 % (interval 5 to 20 %)." in decided
