"""Experiments on figures or lights of another kind than those that were trained on."""

from relight.evaluation.formats import count
from relight.evaluation.report.results import Results
from relight.evaluation.report.words import outcome, paired, row, told
from relight.evaluation.statistics import compare, compare_apart

MAPS = ("shading_rmse", "transport_rmse", "albedo_rmse")
ALL = (*MAPS, "light_rmse")


def sitting(results: Results, name: str) -> str:
    """Sitting against standing test figures, and against what looks at no picture."""
    table, standing = results.table(name), results.table(name, usual=True)
    parts = [
        "The paper finds that poses which were never trained on come out “unexpectedly well”, by eye. Compared: "
        f"{count(table.figures, 'sitting figure')} with {count(standing.figures, 'standing test figure')} under "
        "the same lights (other figures on each side, so by Welch's test)."
    ]
    for one in (r for r in table.rows if not r.baseline):
        found = paired(one, row(standing, one.name), ALL, compare_apart)
        parts.append(f"**{one.label}**, sitting against standing: {told(found)}.")
    best, trivial = row(table, results.experiments[name]["rows"][0]), row(table, "mean_figure")
    found = paired(best, trivial, MAPS, compare)
    better = [verdict for verdict in outcome(found).values() if verdict == "better"]
    parts.append(
        f"On sitting figures, {best.label} against the mean training figure: {told(found)}. "
        + (
            "It is better in all of these: the pictures are read, not the pose guessed."
            if len(better) == len(found)
            else f"It is better in {len(better) or 'none'} of these {len(found)}."
        )
    )
    return "\n\n".join(parts)


def unusual_lights(results: Results, name: str) -> str:
    """Unusual against usual lights; whether the light found is more than a training light; and the remedy."""
    table, usual = results.table(name), results.table(name, usual=True)
    first = row(table, results.experiments[name]["rows"][0])
    found = paired(first, row(usual, first.name), ALL, compare)
    parts = [
        "The paper finds that under lights quite unlike the training lights the network fails: it answers with "
        "something like the nearest training light, and puts what that leaves unexplained into the albedo. The same "
        f"test figures under {count(table.lights, 'unusual light')} against {count(usual.lights, 'usual one')}:",
        f"**{first.label}**: {told(found)}. " + absorbed(outcome(found)),
    ]
    nearest = row(table, "nearest_light")
    found = paired(first, nearest, ("light_rmse",), compare)
    meaning = {
        "better": "so it does find more than a training light",
        "worse": "so it does not even find the best of the training lights",
        "open": "so it finds no more than a training light, as the paper says",
    }
    parts.append(
        f"Against the best that picking one of the training lights could do, with the truth at hand: {told(found)}, "
        f"{meaning[outcome(found)['light_rmse']]}."
    )
    if rich := row(table, "ours_rich"):
        there = paired(rich, first, ALL, compare)
        here = paired(row(usual, rich.name), row(usual, first.name), ALL, compare)
        parts.append(
            f"**The remedy that the paper proposes, richer training lights** ({rich.label}: the same training, with "
            f"other unusual lights added): under unusual lights {told(there)}; under the usual ones {told(here)}."
        )
    return "\n\n".join(parts)


def absorbed(found: dict[str, str]) -> str:
    if found.get("light_rmse") == "worse" and found.get("albedo_rmse") == "worse":
        return "Light and albedo both fail, as in the paper."
    if found.get("light_rmse") == "worse":
        return "The light fails as in the paper; that albedo pays for it cannot be seen here."
    return "That the light fails, as in the paper, cannot be seen here."
