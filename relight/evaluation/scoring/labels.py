"""Labels of rows, columns and quantities in tables and text."""

from relight.evaluation.scoring.truth import COLUMNS
from relight.settings.schema import READINGS

LABELS = {
    "sfsnet": "SfSNet",
    "sfsnet_ao": "SfSNet-AO",
    "ours_min": "Ours (min)",
    "ours_full": "Ours (full)",
    "ours_plus": "Ours plus",
    "no_tv": "w/o TV",
    "no_shading": "w/o shading",
    "no_reconstruction": "w/o reconstruction",
    "sfsnet_ao_full": "SfSNet-AO, all losses",
    "sfsnet_ao_plus": "SfSNet-AO plus",
    "plus_no_weight": "plus w/o weight of the transport",
    "plus_no_relit": "plus w/o losses under another light",
    "plus_no_refinement": "plus w/o refined light",
    "plus_no_mirror": "plus w/o mirroring",
    "plus_no_average": "plus w/o averaged weights",
    "silhouette": "Mask alone",
    "transport_only": "Picture, same losses",
    "self_encoder": "Encoder fine-tuned",
    "self_all": "Everything fine-tuned",
    "ours_rich": "Ours, richer lights",
    "mean_figure": "mean training figure, mean light",
    "mean_light": "true maps, mean training light",
    "nearest_light": "true maps, nearest training light",
    "no_occlusion": "true light, true normals without occlusion",
    "ao_occlusion": "true light, true normals and AO",
    "as_it_is": "the picture as it is",
}
# Quantities whose label is not their capitalized name.
QUANTITIES = {"shading_true_light": "Shading, true light", "transport_with_ao": "Transport × AO", "ao": "AO"}


def label(row: str) -> str:
    """Returns the label of a row, which is its name if it has none."""
    return LABELS.get(row, row)


def quantity_label(column: str) -> str:
    """Returns the label of the quantity of a column of scores: shading_rmse -> Shading."""
    quantity, _ = COLUMNS[column]
    return QUANTITIES.get(quantity, quantity.capitalize())


def title(column: str) -> str:
    """Returns the label of a column of scores: shading_rmse -> Shading RMSE."""
    return f"{quantity_label(column)} {READINGS[COLUMNS[column][1]][0]}"


def column_label(column: str) -> str:
    """Returns the label of a column within a sentence: shading_rmse -> shading RMSE, ao_rmse -> AO RMSE."""
    words = title(column)
    return words if words.split()[0].isupper() else words[0].lower() + words[1:]
