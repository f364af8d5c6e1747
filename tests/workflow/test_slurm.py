"""The workflow with the profile slurm, on a Slurm of one node: the same bytes as without, also when it is disturbed."""

import subprocess
import sys
import time

import pytest
from cluster import Cluster, missing
from repo import OUT, WORDS, at_work, check_mlflow, copy, hashes, start

LACKING = missing()
SCRIPT = ".snakemake/scripts/"
PATIENCE = 1800  # seconds that a busy machine is given for any part of the workflow

pytestmark = [pytest.mark.slow, pytest.mark.skipif(bool(LACKING), reason=f"there is no {LACKING}")]


def test_a_killed_job_and_a_node_that_was_lost_are_repeated(done, tmp_path):
    """A training is killed between two epochs, and the power of the node is cut while it scores a network.

    What Snakemake is told then, by `retries` of the profile and by Slurm, which puts jobs of a lost node back into its
    queue, suffices: nobody calls it again.
    """
    repo = copy(tmp_path)
    command = [sys.executable, "-m", "relight.cli", "run", *WORDS, "--snakemake", "--profile profiles/slurm"]
    with Cluster(tmp_path / "slurm") as cluster, open(tmp_path / "log", "w") as log:
        flow = start(repo, command, cluster.environment, stdout=log, stderr=subprocess.STDOUT)

        def wait_for(condition):
            deadline = time.monotonic() + PATIENCE
            while not (found := condition()):
                assert flow.poll() is None and time.monotonic() < deadline, (tmp_path / "log").read_text()
                time.sleep(0.05)
            return found

        def jobs(name: str) -> list:
            lines = [(process, " ".join(process.info["cmdline"] or [])) for process in at_work(repo)]
            return [process for process, line in lines if SCRIPT in line and name in line]

        wait_for(lambda: list((repo / OUT / "train" / "state").glob("*/*")))
        for training in jobs("train"):
            training.kill()
        wait_for(lambda: jobs("evaluate"))
        cluster.kill_node()
        assert not jobs("")
        cluster.start_node()
        assert cluster.hasten()
        assert flow.wait(PATIENCE) == 0, (tmp_path / "log").read_text()
    assert "train failed" in (tmp_path / "log").read_text()
    assert hashes(repo) == hashes(done)
    check_mlflow(repo)
