"""Scores folders of answers (docs/benchmark.md)."""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from relight.benchmark.files import PICTURES, Answer, BenchmarkSet, Entry, read_answer, square_mask, to_intrinsics
from relight.benchmark.measures import INVARIANCES, LEAKS, errors, invariances, leaks
from relight.core.errors import UserError
from relight.core.files import write_text
from relight.core.progress import progress
from relight.core.srgb import LINEAR, encode
from relight.evaluation.scoring.metrics import MaskBox, best_scale, psnr, rmse
from relight.evaluation.scoring.scores import read_table
from relight.photos.person import OPAQUE

KEYS = ["set", "picture", "figure"]
# Of relit pictures: ending of the column -> its head.
READINGS = {"": "RMSE", "_factor": "RMSE*", "_psnr": "PSNR", "_ssim": "SSIM"}
PICTURE_HEADS = {f"{mode}{key}": f"{mode}: {head}" for mode in PICTURES for key, head in READINGS.items()}
MAP_COLUMNS = (
    "albedo", "albedo_factor", "albedo_ssim", "shading", "shading_factor", "shading_ssim",
    "transport", "light", "light_factor",
)  # fmt: skip
COLUMNS = (*PICTURE_HEADS, *MAP_COLUMNS, *INVARIANCES, *LEAKS)
SCORES = "scores.csv"


def score(folder: Path | str, answers: Path | str) -> Path:
    """Scores a folder of answers, and writes scores.csv there.

    Args:
        folder: folder of the benchmark's set.
        answers: folder of the answers.

    Returns:
        The file of the scores.

    Raises:
        UserError: if the set has changed, or an answer is missing, for another picture, or of a wrong size.
    """
    benchmark, answers = BenchmarkSet(folder), Path(answers)
    if not answers.is_dir():
        raise UserError(f"{answers}: there is no such folder of answers")
    benchmark.verify()
    names_of_set = {entry.name for entry in benchmark.entries}
    if strange := sorted(path for path in answers.glob("[!.]*.npz") if path.stem not in names_of_set):
        raise UserError(f"{strange[0]} answers no picture of the set: files have the names of pictures and variants")
    pictures = [entry for entry in benchmark.entries if not entry.of]
    has_variants = any((answers / f"{entry.name}.npz").is_file() for entry in benchmark.entries if entry.of)
    rows: list[dict[str, Any]] = []
    names: set[str] = set()
    for entry in progress(pictures, "pictures scored"):
        variants = [variant for variant in benchmark.entries if variant.of == entry.name] if has_variants else []
        answered = {picture: read_answer(answers, picture) for picture in (entry, *variants)}
        names = names or set(answered[entry])
        for picture, arrays in answered.items():
            required = names.difference(PICTURES) if picture.of else names
            if set(arrays) != required:
                raise UserError(
                    f"{answers / picture.name}.npz holds {', '.join(arrays)}, but that of the first picture "
                    f"{', '.join(sorted(required))}: all answers of a folder must hold the same arrays"
                )
        keys = dict(zip(KEYS, (benchmark.hash[:16], entry.name, entry.figure)))
        rows.append(keys | score_answers(benchmark, entry, answered))
    frame = pd.DataFrame(rows, columns=[*KEYS, *COLUMNS])
    write_text(answers / SCORES, frame.to_csv(index=False, float_format="%.6g", lineterminator="\n"))
    return answers / SCORES


def score_answers(benchmark: BenchmarkSet, entry: Entry, answered: dict[Entry, Answer]) -> dict[str, float]:
    """Returns those of COLUMNS that the answers to a picture and to each of its variants allow."""
    true, pictures = benchmark.truth(entry)
    # By variant; that of the picture itself is "".
    inferred = {picture.variant: to_intrinsics(arrays, square_mask(picture)) for picture, arrays in answered.items()}
    scores = errors(inferred[""], true) | leaks(inferred[""])
    opaque = entry.shot().mask >= OPAQUE
    for mode in PICTURES:  # columns such as ratio_psnr: how the picture was relit, and the measure
        if mode in answered[entry]:
            by_light = [relit_errors(*pair, opaque) for pair in zip(answered[entry][mode], pictures)]
            scores |= {f"{mode}{key}": float(np.mean([of_light[key] for of_light in by_light])) for key in by_light[0]}
    if len(inferred) > 1:
        scores |= invariances(inferred)
    return scores


def relit_errors(relit: np.ndarray, true: np.ndarray, opaque: np.ndarray) -> dict[str, float]:
    """Returns the errors of a relit picture, of sRGB codes in [0,1].

    Args:
        relit: (H,W,3) uint8.
        true: (H,W,3) uint8.
        opaque: (H,W) bool, where the figure covers the pixel.

    Returns:
        READINGS. The factor of "_factor" is on linear values. PSNR and SSIM are in the convention of HumanOLAT's league
        table: over the foreground mask, without rescaling.
    """
    codes, true_codes = (x[opaque] / 255 for x in (relit, true))
    linear = LINEAR[relit[opaque]].astype(np.float64)
    return {
        "": float(rmse(codes, true_codes)),
        "_factor": float(rmse(encode(linear * best_scale(linear, LINEAR[true[opaque]])), true_codes)),
        "_psnr": float(psnr(codes, true_codes)),
        "_ssim": MaskBox.of(opaque).ssim(codes, true_codes),
    }


def read_scores(answers: Path | str) -> pd.DataFrame:
    """Reads the scores in a folder of answers.

    Returns:
        Indexed by KEYS, with COLUMNS, which are NaN where the method did not answer, and the folder's name as
        `attrs["method"]`.

    Raises:
        UserError: if `score` did not write them, or an answer is newer.
    """
    path = Path(answers) / SCORES
    frame = read_table(path, "scores", [*KEYS, *COLUMNS], "relight benchmark score")
    if any(answer.stat().st_mtime > path.stat().st_mtime for answer in path.parent.glob("*.npz")):
        raise UserError(f"{path} is older than the answers beside it: run relight benchmark score again")
    frame = frame.set_index(KEYS)[list(COLUMNS)]
    frame.attrs["method"] = Path(answers).resolve().name
    return frame
