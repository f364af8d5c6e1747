"""Experiments on what a network is shown: the mask alone, pictures without truth, people that it has seen before."""

from relight.evaluation.formats import count, number
from relight.evaluation.report.results import Results
from relight.evaluation.report.words import compared, outcome, paired, row, signed, told
from relight.evaluation.statistics import compare
from relight.evaluation.tables import ALPHA

MAPS = ("transport_rmse", "shading_true_light_rmse")
ALL = ("shading_rmse", "shading_true_light_rmse", "transport_rmse", "light_rmse", "albedo_rmse")


def silhouette(results: Results, name: str) -> str:
    """How far the mask alone goes from the mean figure toward what the picture tells."""
    table = results.table(name)
    mask, mean, open_ = (row(table, one) for one in ("silhouette", "mean_figure", "no_occlusion"))
    parts = [
        "The paper infers the transport from the mask alone and finds, by eye, a strong shape prior. Here two networks "
        "are trained on the transport's own losses, one shown the mask and one the picture; shadings are under the "
        "true light.",
    ]
    if mask:
        found = paired(mask, mean, MAPS, compare)
        better = outcome(found)["transport_rmse"] == "better"
        parts.append(
            f"**Against the mean training figure**, the mask gives {told(found)}: "
            + ("the silhouette does tell shape." if better else "that the silhouette tells shape cannot be seen here.")
            + f" Against true normals without occlusion: {told(paired(mask, open_, MAPS, compare))}."
        )
    if mask and (image := row(table, "transport_only")):
        low, middle, high = (one.cells["transport_rmse"].estimate.mean for one in (mean, mask, image))
        seen = outcome(paired(image, mean, MAPS, compare))["transport_rmse"] == "better"
        share = (
            f" In transport it goes {100 * (low - middle) / (low - high):.0f} % of the way from the mean figure to it."
        )
        parts.append(
            f"**Against the picture**, the mask gives {told(paired(mask, image, MAPS, compare))}.{share * seen}"
        )
    return "\n\n".join(parts)


def self_supervised(results: Results, name: str) -> str:
    """Whether fine-tuning on pictures without truth bleaches the shading and makes the albedo the picture."""
    table, names = results.table(name), results.experiments[name]["rows"]
    base = row(table, names[0])
    contrast, share = (results.estimates(name, column) for column in ("shading_contrast", "albedo_share"))
    true = share["nearest_light"].mean  # the baseline is given the true albedo
    parts = [
        "The paper fine-tunes on unlabelled photographs, on the reconstruction alone, and sees a collapse: bleached "
        "shading, albedo close to the input. Here the unlabelled pictures are those of the test, their truth not used. "
        "Bleaching is measured by the contrast of the shading (standard deviation over mean, true contrast = 1), the "
        "other by the share of the picture's variation that the albedo explains alone, one factor per channel "
        f"({true:.0%} for the true albedo). {base.label}: contrast {number(contrast[base.name].mean)}, share "
        f"{share[base.name].mean:.0%}."
    ]
    for one in (r for r in table.rows if not r.baseline and r is not base):
        flat = compared(contrast[one.name], contrast[base.name], compare)[2]
        grown = compared(share[one.name], share[base.name], compare)[2]
        flatter = flat.p < ALPHA / 2 and flat.mean < 0 and contrast[one.name].mean < 1
        fuller = grown.p < ALPHA / 2 and grown.mean > 0 and share[one.name].mean > true
        said = {2: "**it collapses as in the paper**", 1: "**half of the collapse is there**", 0: "**no collapse**"}
        parts.append(
            f"**{one.label}**: contrast {number(contrast[one.name].mean)}, {signed(flat)} from that; share "
            f"{share[one.name].mean:.0%}, {100 * grown.low:.0f} to {100 * grown.high:.0f} points from that: "
            f"{said[flatter + fuller]}. Against {base.label}: {told(paired(one, base, ALL, compare))}."
        )
    return "\n\n".join(parts)


def splits(results: Results, name: str) -> str:
    """What it is worth to have seen the person of the test in training."""
    table = results.table(name)
    seen, unseen = row(table, "ours_siblings"), row(table, "ours_disjoint")
    text = (
        "The paper splits its figures at random, so that frames of one person may be on both sides. Here two networks "
        f"are tested on the same {count(table.figures, 'figure')} and trained on as many figures each; one has other "
        "figures of the test's people among them, in the same clothes and other poses."
    )
    if not (seen and unseen):
        return text
    found = paired(seen, unseen, ALL, compare)
    better = [verdict for verdict in outcome(found).values() if verdict == "better"]
    end = (
        f"A random split flatters {len(better)} of these errors."
        if better
        else "That a random split flatters cannot be seen here."
    )
    return f"{text}\n\n**Person seen against not seen**: {told(found)}. {end}"
