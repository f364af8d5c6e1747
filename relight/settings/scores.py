"""What is scored: the quantities, their readings, and the labels that settings, scores, tables and charts share."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Quantity:
    """What is compared with the truth: its label, and its data range for SSIM, rounded to a whole number."""

    label: str
    span: float = 1.0


@dataclass(frozen=True)
class Reading:
    """What is read of a quantity, and its sign: 1 if less is better, -1 if more is, 0 if the truth's value is best."""

    label: str
    sign: int
    of: str | None = None  # the only quantity that has it


QUANTITIES = {  # in the order of tables; the first six are those of the paper's Table 1
    "shading": Quantity("Shading"),
    "transport": Quantity("Transport", 2.0),
    "normal": Quantity("Normal", 2.0),
    "ao": Quantity("AO"),
    "light": Quantity("Light", 2.0),
    "albedo": Quantity("Albedo"),
    "shading_true_light": Quantity("Shading, true light"),
    "transport_with_ao": Quantity("Transport × AO", 2.0),
    "reconstruction": Quantity("Reconstruction"),
    "relit": Quantity("Relit"),
    "sphere": Quantity("Sphere"),
}
PRINTED = tuple(QUANTITIES)[:6]
# As the albedo takes up the shading in a collapse, contrast falls and share rises.
READINGS = {
    "rmse": Reading("RMSE", 1),
    "rmse_element": Reading("RMSE per element", 1),
    "ssim": Reading("SSIM", -1),
    "ssim_range2": Reading("SSIM, range 2", -1),
    "contrast": Reading("contrast", 0, "shading"),
    "share": Reading("share of the picture", 0, "albedo"),
}
# The columns that scores may have -> their quantity and reading.
COLUMNS = {
    f"{quantity}_{name}": (quantity, name)
    for quantity in QUANTITIES
    for name, reading in READINGS.items()
    if reading.of in (None, quantity)
}
BASELINES = {
    "mean_figure": "mean training figure, mean light",
    "mean_light": "true maps, mean training light",
    "nearest_light": "true maps, nearest training light",
    "no_occlusion": "true light, true normals without occlusion",
    "mean_occlusion": "true light, true normals and mean AO",
    "ao_occlusion": "true light, true normals and AO",
    "as_it_is": "the picture as it is",
}
ROWS = {  # of several experiments; `labels` of an experiment has those of its own
    "sfsnet": "SfSNet",
    "sfsnet_ao": "SfSNet-AO",
    "ours_min": "Ours (min)",
    "ours_full": "Ours (full)",
    "ours_plus": "Ours plus",
}


def label(row: str, experiments: Iterable[Mapping[str, Any]] = ()) -> str:
    """Returns the label of a row or baseline: that of an experiment's settings, or of ROWS, or else its name."""
    own = (experiment["labels"][row] for experiment in experiments if row in experiment["labels"])
    return next(own, {**ROWS, **BASELINES}.get(row, row))


def columns_of(*quantities: str) -> tuple[str, ...]:
    """Returns the columns of scores of quantities: first the RMSE of each, such as light_rmse, then the SSIM."""
    return tuple(f"{quantity}_{reading}" for reading in ("rmse", "ssim") for quantity in quantities)


def title(column: str) -> str:
    """Returns the label of a column of scores: shading_rmse -> Shading RMSE."""
    quantity, reading = COLUMNS[column]
    return f"{QUANTITIES[quantity].label} {READINGS[reading].label}"


def column_label(column: str) -> str:
    """Returns the label of a column within a sentence: shading_rmse -> shading RMSE, ao_rmse -> AO RMSE."""
    words = title(column)
    return words if words.split()[0].isupper() else words[0].lower() + words[1:]


def sign(column: str) -> int:
    """Returns 1 for columns where less is better, -1 where more is, and 0 where the truth's value is best."""
    return READINGS[COLUMNS[column][1]].sign
