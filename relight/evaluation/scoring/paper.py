"""Facts from the paper (Kanamori and Endo 2018): its reference, its tables, and the orderings that it argues with.

The values were measured by its authors, on scanned figures that are not public, at 1024 px, without intervals.
"""

from relight.settings.scores import PRINTED, columns_of

CITATION = {
    "authors": "Yoshihiro Kanamori and Yuki Endo",
    "title": "Relighting Humans: Occlusion-Aware Inverse Rendering for Full-Body Human Images",
    "venue": "ACM Transactions on Graphics 37(6), article 270, 2018 (SIGGRAPH Asia)",
    "doi": "10.1145/3272127.3275104",
}

# (better row by the paper's argument, worse row, the argument): section 7.1 and the discussion of Table 2.
ARGUMENTS = (
    ("ours_min", "sfsnet", "knowing occlusion helps"),
    ("ours_full", "sfsnet", "knowing occlusion helps"),
    ("ours_full", "sfsnet_ao", "transport beats ambient occlusion"),
    ("ours_full", "ours_min", "the fifteen losses beat four"),
    ("ours_full", "no_tv", "total variation matters"),
    ("ours_full", "no_shading", "the shading losses matter"),
    ("ours_full", "no_reconstruction", "the reconstruction losses matter"),
)

_PRINTED = {  # RMSE of the PRINTED quantities, then SSIM; None if the paper has N/A or no column
    "sfsnet": (0.299, 0.526, 0.346, None, 0.207, 0.135, 0.884, 0.755, 0.776, None, 0.446, 0.954),
    "sfsnet_ao": (0.293, 0.529, 0.347, 0.083, 0.207, 0.131, 0.890, 0.749, 0.772, 0.946, 0.475, 0.955),
    "ours_min": (0.237, 0.406, None, None, 0.205, 0.131, 0.909, 0.777, None, None, 0.473, 0.953),
    "ours_full": (0.219, 0.393, None, None, 0.199, 0.129, 0.927, 0.781, None, None, 0.500, 0.943),
    "no_tv": (0.226, 0.391, None, None, 0.202, 0.126, 0.923, 0.784, None, None, 0.471, 0.956),
    "no_shading": (0.227, 0.398, None, None, 0.201, 0.132, 0.922, 0.781, None, None, 0.496, 0.940),
    "no_reconstruction": (0.224, 0.394, None, None, 0.198, 0.144, 0.925, 0.782, None, None, 0.503, 0.907),
}


def printed(row: str) -> dict[str, float]:
    """Returns column -> printed value for a row of either table; empty for rows that the paper does not have."""
    values = zip(columns_of(*PRINTED), _PRINTED.get(row, ()))
    return {column: value for column, value in values if value is not None}
