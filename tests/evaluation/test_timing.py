import pytest
import torch
from omegaconf import OmegaConf

from relight.config import Timing, composed
from relight.errors import UserError
from relight.evaluation.experiments.timing import read_times, time_networks
from relight.learning.networks import build


def model(*words):
    return OmegaConf.to_object(composed(words)).model


@pytest.mark.slow
def test_time_networks_of_small_networks(tmp_path):
    words = ("scale=smoke", "model.width=0.03125")
    small = {"ours_full": model(*words), "ours_plus": model(*words, "model=ours_plus")}
    before = torch.get_num_threads()
    time_networks(small, Timing([64, 128]), tmp_path / "times.csv")
    assert torch.get_num_threads() == before
    times = read_times(tmp_path / "times.csv")
    times = times[times.device == "cpu"]
    assert set(zip(times["row"], times["size"])) == {(row, size) for row in small for size in (64, 128)}
    for one in times.itertuples():
        assert one.wall > 0 and one.cpu > 0 and one.width == 0.03125
        assert one.parameters == sum(weight.numel() for weight in build(small[one.row], one.size).parameters())
    (tmp_path / "other.csv").write_text("a,b\n1,2\n")
    with pytest.raises(UserError, match="not a table of times"):
        read_times(tmp_path / "other.csv")
