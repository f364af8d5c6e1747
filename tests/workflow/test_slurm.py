"""The workflow with the profile slurm, on a Slurm of one node: the same bytes as without, also when it is disturbed."""

import subprocess
import sys
import time

import pytest
from cluster import Cluster, missing
from repo import OUT, WORDS, at_work, check_mlflow, copy, hashes, start

LACKING = missing()
STAGE = "-m relight.stages."
PATIENCE = 1800  # seconds that a busy machine is given for any part of the workflow

pytestmark = [pytest.mark.slow, pytest.mark.skipif(bool(LACKING), reason=f"there is no {LACKING}")]


def test_a_killed_job_and_a_node_that_was_lost_are_repeated(done, tmp_path):
    """A training is killed between two epochs, and the power of the node is cut while it scores a network.

    What Snakemake is told then, by `retries` of the profile and by Slurm, which puts jobs of a lost node back into its
    queue, suffices: nobody calls it again.
    """
    repo = copy(tmp_path)
    command = [sys.executable, "-m", "relight.cli", "run", *WORDS, "--snakemake", "--profile workflow/profiles/slurm"]
    with Cluster(tmp_path / "slurm") as cluster, open(tmp_path / "log", "w") as log:
        flow = start(repo, command, cluster.environment, stdout=log, stderr=subprocess.STDOUT)

        def wait_for(condition):
            deadline = time.monotonic() + PATIENCE
            while not (found := condition()):
                assert flow.poll() is None and time.monotonic() < deadline, (tmp_path / "log").read_text()
                time.sleep(0.05)
            return found

        def stages(name: str) -> list:
            words = f"{STAGE}{name}"
            return [process for process in at_work(repo) if words in " ".join(process.info["cmdline"] or [])]

        wait_for(lambda: list((repo / OUT / "train" / "state").glob("*/*")))
        for training in stages("train"):
            training.kill()
        wait_for(lambda: stages("evaluate"))
        cluster.kill_node()
        assert not stages("")
        cluster.start_node()
        assert cluster.hasten()
        assert flow.wait(PATIENCE) == 0, (tmp_path / "log").read_text()
    assert "train failed" in (tmp_path / "log").read_text()
    assert hashes(repo) == hashes(done)
    check_mlflow(repo)
