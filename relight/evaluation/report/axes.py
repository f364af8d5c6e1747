"""Experiments along one setting: the number of training figures, the width of the network, the order of the bands."""

from itertools import pairwise

from relight.evaluation.formats import number
from relight.evaluation.report.results import Results
from relight.evaluation.report.words import named, outcome, paired, told
from relight.evaluation.statistics import compare
from relight.evaluation.tables import Row

ERRORS = ("shading_rmse", "transport_rmse", "light_rmse", "albedo_rmse")
LABELS = {
    "train.figures": "number of training figures",
    "model.width": "width of the network",
    "model.order": "order of the network",
}


def label(axis: str) -> str:
    return LABELS.get(axis, axis)


def points(results: Results, name: str) -> list[tuple[float, Row]]:
    """The rows of an experiment's table with their place on its axis, in its order."""
    axis = results.experiments[name]["axis"]
    found = [(place(results, name, one.name, axis), one) for one in results.table(name).rows if not one.baseline]
    return sorted(found, key=lambda point: point[0])


def place(results: Results, name: str, own: str, axis: str) -> float:
    """Where a row stands; of training figures, as many as there were."""
    value = results.setting(own, axis)
    if axis != "train.figures":
        return float(value)
    there = len(results.split(name, own)[results.setting(own, "train.part")])
    return float(min(value or there, there))


def along(results: Results, name: str) -> str:
    """From the least to the most, and the last step: whether more still helps."""
    found = points(results, name)
    axis = label(results.experiments[name]["axis"])
    if len(found) < 2:
        return f"At this scale there is one {axis} only ({found[0][0]:g}): nothing can be said of its effect."
    (low, first), (before, last_but_one), (high, last) = found[0], found[-2], found[-1]
    text = f"The paper has one {axis}. **From {low:g} to {high:g}**: {told(paired(last, first, ERRORS, compare))}."
    step = paired(last, last_but_one, ERRORS, compare)
    falling = [named(column) for column, verdict in outcome(step).items() if verdict == "better"]
    said = f"Still falling there: {', '.join(falling)}." if falling else "That more would help cannot be seen there."
    if len(found) > 2:
        text += f"\n\nThe last step, {before:g} to {high:g}: {told(step)}."
    return f"{text} {said}"


def order(results: Results, name: str) -> str:
    """What each order can show at best, and what its network shows."""
    table, found = results.table(name), points(results, name)
    floors = {one.name: one for one in table.rows if one.name.startswith("cut_")}
    costs = [f"{number(shading(one))} for {one.label}" for one in floors.values()]
    shares = [
        f"{100 * (shading(floors[f'cut_{place:.0f}']) / shading(one)) ** 2:.0f} % of the squared error of {one.label}"
        for place, one in found
        if f"cut_{place:.0f}" in floors
    ]
    parts = [
        "The paper keeps nine coefficients and names higher bands as a way to sharper shadows. Here pictures and the "
        "true shading have all bands of the data, whatever the network's order, so what is cut off counts as its "
        "error; transport and light are compared in the first nine coefficients. Cutting alone costs in shading RMSE: "
        f"{', '.join(costs) or 'nothing'}." + f" That is {' and '.join(shares)}." * bool(shares)
    ]
    for (low, first), (high, second) in pairwise(found):
        parts.append(
            f"**Order {high:g} against {low:g}** ({(high + 1) ** 2:.0f} coefficients against {(low + 1) ** 2:.0f}): "
            f"{told(paired(second, first, ERRORS, compare))}."
        )
    return "\n\n".join(parts)


def shading(one: Row) -> float:
    return one.cells["shading_rmse"].estimate.mean
