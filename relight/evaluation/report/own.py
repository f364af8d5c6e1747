"""Computes the numbers of light transfer, which is not a table of trainings, and writes its table."""

from relight.evaluation.experiments import transfer
from relight.evaluation.report.formats import TextTable, comparison_grid, write_tables
from relight.evaluation.report.page import text
from relight.evaluation.report.results import Results
from relight.evaluation.report.sections import Numbers
from relight.evaluation.scoring.comparisons import compare_estimates, correct
from relight.evaluation.scoring.labels import label
from relight.evaluation.scoring.tables import estimates

# What light transfer compares for each network: two predictors, whose names follow that of the network.
SWAPS = {
    "against the picture as it is": ("", "as_it_is"),
    "against its own maps under the mean light": ("", ":mean_light"),
    "with the true light against with the true maps": (":true_light", ":true_maps"),
}


def light_transfer(results: Results, name: str) -> Numbers:
    """Compares relit pictures of figures that swap lights with the unchanged pictures, and with parts of the truth.

    Returns:
        The context of templates/sections/experiment.md.
    """
    rows = results.gather([f"{name}/scores.csv"])
    networks = {row: trainings for row, trainings in rows.items() if ":" not in row and row not in transfer.BASELINES}
    heads = {"reconstruction_rmse": "relit, RMSE", "reconstruction_ssim": "relit, SSIM", "light_rmse": "light, RMSE"}
    by_column = {column: estimates(rows, column, networks, transfer.BASELINES) for column in heads}
    errors = by_column["reconstruction_rmse"]
    words = {
        f"{row}:{variant}" if variant else row: f"{label(row)}: {words}"
        for row in networks
        for variant, words in transfer.VARIANTS.items()
    } | transfer.BASELINES
    lines = [[said, *(by_column[column][predictor] for column in heads)] for predictor, said in words.items()]
    grid = TextTable.of(
        ["", *heads.values()], lines, kinds=["network" if row in networks else "baseline" for row in words]
    )
    comparisons = {}
    for row in networks:
        for what, pair in SWAPS.items():
            first, second = (errors[end if end in errors else f"{row}{end}"] for end in pair)
            comparisons[f"{label(row)} {what}"] = {"": compare_estimates("reconstruction_rmse", first, second)}
    correct([comparison for by_pair in comparisons.values() for comparison in by_pair.values()])
    any_scores = next(iter(rows.values()))[0]
    note = text("notes/light_transfer.md", pairs=len(any_scores.figures), swaps=len(any_scores.lights))
    write_tables(results.report / name, results.title(name), note, grid)
    plate = results.folder / name / "plate.png", "Test figures under other lights, and the errors."
    return {
        "experiment": results.experiments[name],
        "note": note,
        "tables": {name: grid},
        "plates": [plate],
        "comparisons": comparison_grid(comparisons),
    }
