"""The figures' part of the report: how much they shadow themselves, by pose and garment, and which were drawn anew."""

import re
from collections import Counter

from relight.evaluation.occlusion import Group, by_garment, by_pose, group, read_occlusions
from relight.evaluation.page import fold, grid, picture, prose
from relight.evaluation.paper import IMPLIED_AO, IMPLIED_LOST
from relight.evaluation.report.results import Results

HEADS = ["figures", "mean AO", "range", "AO < .5", "rms lost"]
PAPER = ["the paper, implied", "", IMPLIED_AO, "", "", IMPLIED_LOST]


def occlusion(results: Results) -> str:
    """Means over the figures, the histogram, and tables per pose, per garment and per figure."""
    found = read_occlusions(results.report / "occlusion.csv")
    every = group(found, "all")
    text = (
        f"Over a figure's pixels the mean ambient occlusion is **{every.ao:.3f}** ({every.least:.2f} to "
        f"{every.most:.2f}), **{every.dark:.1%}** lie under .5, and occlusion takes **{every.lost:.2f}** from the "
        "transport (root mean square of |T - T unoccluded|, nine-vectors); means over figures. The paper prints "
        f"neither; its tables imply about {IMPLIED_AO:g} and {IMPLIED_LOST:g} for its scans."
    )
    each = [[one.name, one.pose, ", ".join(one.garments), one.ao, one.dark, one.lost] for one in found]
    return "\n".join(
        [
            prose(text),
            picture(results.report / "occlusion.png", "Ambient occlusion of pixels, and what it takes from figures."),
            fold("Occlusion by pose", table("pose", by_pose(found), every)),
            fold("Occlusion by garment (a figure counts for each)", table("garment", by_garment(found), every)),
            fold(
                "Occlusion of each figure",
                grid(["figure", "pose", "garments", "mean AO", "AO < .5", "rms lost"], each),
            ),
        ]
    )


def table(head: str, groups: list[Group], every: Group) -> str:
    """Groups, darkest first, with all figures and the paper at the end."""
    rows = [
        [one.name, one.figures, one.ao, f"{one.least:.2f} to {one.most:.2f}", one.dark, one.lost]
        for one in [*groups, every]
    ]
    return grid([head, *HEADS], [*rows, PAPER])


def redraws(infos: dict[str, dict]) -> str:
    """How many figures were drawn anew and why, from their infos; nothing where none are generated."""
    drawn = [info for info in infos.values() if "redrawn" in info]
    if not drawn:
        return ""
    again = sum(info["redrawn"] > 0 for info in drawn)
    reasons = [reason for info in drawn for reason in info["redrawn_because"]]
    if not reasons:
        return prose(f"All {len(drawn)} generated figures passed the gates at the first draw.")
    text = (
        f"**{again} of {len(drawn)}** generated figures failed a gate and were dressed anew with the next sub-seed, "
        f"{len(reasons)} draws in all."
    )
    draws, garments = Counter(), {}
    for reason in reasons:
        garment, _, why = reason.rpartition(": ")
        why = re.sub(r"\d+(\.\d+)?", "…", why)
        draws[why] += 1
        garments.setdefault(why, Counter())[garment] += bool(garment)
    rows = [
        [why, count, ", ".join(f"{name} {n}" for name, n in garments[why].most_common() if n)]
        for why, count in draws.most_common()
    ]
    return prose(text) + fold("Why figures were drawn anew", grid(["gate", "draws", "garments"], rows))
