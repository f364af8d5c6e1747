import pytest
import torch
from omegaconf import OmegaConf

from relight.config import Timing, composed
from relight.evaluation.experiments.timing import multiply_adds, read_times, time_networks
from relight.files import UserError


def model(*words):
    return OmegaConf.to_object(composed(words)).model


def test_multiply_adds_of_the_papers_network():
    assert 2 * multiply_adds(model("scale=paper"), 1024) == pytest.approx(328e9, rel=0.01)


@pytest.mark.parametrize("words", [("model=ours_plus",), ("model=unet",), ("model=ours_plus", "model.width=1.0")])
def test_multiply_adds_of_every_network(words):
    """Heads that leave autocast, too: fake tensors have a device, meta tensors have one that autocast refuses."""
    assert multiply_adds(model("scale=smoke", *words), 64) > 1e6


def test_time_networks_of_small_networks(tmp_path):
    small = {"ours_full": model("scale=smoke"), "ours_plus": model("scale=smoke", "model=ours_plus")}
    before = torch.get_num_threads()
    time_networks(small, Timing([64, 128], 0.0, 1), tmp_path / "times.csv")
    assert torch.get_num_threads() == before
    times = read_times(tmp_path / "times.csv")
    times = times[times.device == "cpu"]
    assert set(zip(times["row"], times["size"])) == {(row, size) for row in small for size in (64, 128)}
    for one in times.itertuples():
        assert one.wall > 0 and one.cpu > 0 and 0 < one.share < 2 and one.width == 0.125
        assert one.gflop == pytest.approx(2e-9 * multiply_adds(small[one.row], one.size), rel=1e-5)
        assert one.share == pytest.approx(one.gflop / one.wall / one.rate)
    smaller, larger = (times[times["size"] == size].gflop.min() for size in (64, 128))
    assert larger > 3 * smaller
    (tmp_path / "other.csv").write_text("a,b\n1,2\n")
    with pytest.raises(UserError, match="not a table of times"):
        read_times(tmp_path / "other.csv")
