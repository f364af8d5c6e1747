"""A section of the report for each experiment: what the paper says, what came out here, table, plot and pictures."""

from collections.abc import Callable

from relight.evaluation.formats import legend, to_html
from relight.evaluation.metrics import COLUMNS
from relight.evaluation.page import Section, fold, picture, prose
from relight.evaluation.plots import plot_axis
from relight.evaluation.report import axes, conditions, inputs
from relight.evaluation.report.own import SECTIONS
from relight.evaluation.report.results import Results
from relight.evaluation.tables import Table, titled

# What an experiment's numbers mean, in words (Markdown); its table has rows.
PARAGRAPHS: dict[str, Callable[[Results, str], str]] = {
    "silhouette": inputs.silhouette,
    "self_supervised": inputs.self_supervised,
    "sitting": conditions.sitting,
    "unusual_lights": conditions.unusual_lights,
    "splits": inputs.splits,
    "order": axes.order,
    "data_size": axes.along,
    "width": axes.along,
}
ONCE = "One training a row: what follows speaks of these networks on other figures, not of another training."


def section(results: Results, name: str) -> Section:
    """The section of the experiment `name`; its plot, if it has one, is written beside the report."""
    if not results.experiments[name]["table"]:
        return SECTIONS[name](results, name)
    table = results.table(name)
    if not table.rows:
        return Section(titled(name)[0], prose(legend(table)))
    parts = [prose(PARAGRAPHS[name](results, name))] if name in PARAGRAPHS else []
    if results.experiments[name]["axis"]:
        parts.append(plot(results, name))
    parts.append(words(table))
    if results.experiments[name]["plates"]:
        parts.append(
            picture(results.report / f"{name}_plates.png", "Figures unseen in training, as each network sees them.")
        )
    once = name in PARAGRAPHS and all(row.trainings == 1 for row in table.rows)
    return Section(table.title, "\n".join(parts), ONCE if once else "")


def words(table: Table) -> str:
    """A table with its legend; the readings that the paper does not print are folded away."""
    other = tuple(c for c in COLUMNS if c not in table.columns and any(c in row.cells for row in table.rows))
    return prose(legend(table)) + to_html(table) + fold("Other readings of the same scores", to_html(table, other))


def plot(results: Results, name: str) -> str:
    """Errors against the experiment's axis."""
    table, out = results.table(name), results.report / f"{name}.png"
    columns = tuple(column for column in table.columns if column.endswith("rmse"))
    label = axes.label(results.experiments[name]["axis"])
    plot_axis(axes.points(results, name), [row for row in table.rows if row.baseline], columns, label, out)
    return picture(out, f"Errors against the {label}, with 95 % intervals; grey: what looks at no picture.")
