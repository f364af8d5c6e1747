import pytest
import torch
from omegaconf import OmegaConf

from relight.config import Timing, composed
from relight.evaluation.timing import Time, multiply_adds, read_times, time_networks
from relight.files import UserError


def model(*words):
    return OmegaConf.to_object(composed(words)).model


def test_the_papers_network_at_its_size():
    assert 2 * multiply_adds(model("scale=paper"), 1024) == pytest.approx(328e9, rel=0.01)


def test_times_of_small_networks(tmp_path):
    small = {"ours_full": model("scale=smoke"), "sfsnet_ao": model("scale=smoke", "model=sfsnet_ao")}
    before = torch.get_num_threads()
    time_networks(small, Timing([64, 128], 0.0, 1), tmp_path / "times.csv")
    assert torch.get_num_threads() == before
    times = [one for one in read_times(tmp_path / "times.csv") if one.device == "cpu"]
    assert {(t.row, t.size) for t in times} == {(row, size) for row in small for size in (64, 128)}
    for one in times:
        assert one.wall > 0 and one.cpu > 0 and 0 < one.share < 2 and one.width == 0.125
        assert one.gflop == pytest.approx(2e-9 * multiply_adds(small[one.row], one.size), rel=1e-5)
    larger, smaller = (next(t for t in times if t.size == size) for size in (128, 64))
    assert larger.gflop > 3 * smaller.gflop and larger.threads == 1
    (tmp_path / "other.csv").write_text("a,b\n1,2\n")
    with pytest.raises(UserError, match="not a table of times"):
        read_times(tmp_path / "other.csv")


def test_share_is_of_the_matrix_rate():
    one = Time("ours", 1.0, 1, 64, "cpu", 1, wall=2.0, cpu=2.0, gflop=100.0, rate=200.0)
    assert one.share == 0.25
