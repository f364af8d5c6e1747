"""A Slurm of one node on this machine, for tests: slurmctld, and slurmd in a PID namespace that dies as a node does."""

import getpass
import os
import shutil
import socket
import subprocess
import time
from collections.abc import Callable
from functools import partial
from importlib.util import find_spec
from pathlib import Path

from relight.processes import end_with_parent

PROGRAMS = ("slurmctld", "slurmd", "sbatch", "srun", "squeue", "sinfo", "scontrol", "unshare")
PLUGIN = "snakemake_executor_plugin_slurm"
PATIENCE = 300.0  # seconds that a busy machine is given for what Slurm does in a few
# Seconds that a node stays off. One that is back within BatchStartTimeout and ten seconds of the last sign of a job is
# not asked for it then, and Slurm asks again only rarely (slurm.conf).
AWAY = 15.0
# No keys (auth/none, cred/none); more memory than the machine may have, since Slurm only counts it; a node that was
# away is asked for its jobs at once.
CONF = """\
ClusterName=relight
SlurmctldHost=localhost(127.0.0.1)
SlurmctldPort={ports[0]}
SlurmdPort={ports[1]}
SlurmUser={user}
SlurmdUser={user}
AuthType=auth/none
CredType=cred/none
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd.pid
SlurmctldLogFile={folder}/slurmctld.log
SlurmdLogFile={folder}/slurmd.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU_Memory
MpiDefault=none
SwitchType=switch/none
BatchStartTimeout=1
ReturnToService=2
SlurmdParameters=config_overrides
NodeName=localhost NodeAddr=127.0.0.1 CPUs={cores} RealMemory=64000 State=UNKNOWN
PartitionName=main Nodes=ALL Default=YES MaxTime=INFINITE State=UP
"""


def missing() -> str:
    """What a test of Slurm lacks here, in words; empty where it can run."""
    lacking = [program for program in PROGRAMS if not shutil.which(program, path=search_path())]
    lacking += [] if find_spec(PLUGIN) else [PLUGIN]
    if not lacking and subprocess.run([*namespace(), "true"], capture_output=True).returncode:
        lacking = ["the right to make a namespace"]
    return ", ".join(lacking)


def search_path() -> str:
    """The folders of programs, with those of daemons, which users' paths may lack."""
    return os.pathsep.join([os.environ.get("PATH", ""), "/usr/sbin", "/sbin"])


def namespace() -> list[str]:
    """The words that start a program as the first one of a PID namespace, whose processes all end with it."""
    own = [] if os.getuid() == 0 else ["--user", "--map-current-user"]
    return ["unshare", *own, "--pid", "--fork", "--kill-child", "--mount-proc"]


def free_ports(count: int) -> list[int]:
    """Ports of this machine that nothing listens on."""
    sockets = [socket.socket() for _ in range(count)]
    for one in sockets:
        one.bind(("127.0.0.1", 0))
    found = [one.getsockname()[1] for one in sockets]
    for one in sockets:
        one.close()
    return found


class Cluster:
    """slurmctld and one node; a context that ends both."""

    def __init__(self, folder: Path, cores: int = 2):
        """
        Args:
            folder: a new folder, for the daemons' files.
            cores: of the node.
        """
        for name in ("state", "spool", "bin"):
            (folder / name).mkdir(parents=True)
        self.conf = folder / "slurm.conf"
        ports = free_ports(2)
        self.conf.write_text(CONF.format(folder=folder, user=getpass.getuser(), ports=ports, cores=cores))
        # Snakemake's jobs lose SLURM_CONF on their way to the node, where a real cluster has a file in /etc.
        srun = folder / "bin" / "srun"
        srun.write_text(f'#!/bin/sh\nSLURM_CONF={self.conf} exec {shutil.which("srun")} "$@"\n')
        srun.chmod(0o755)
        path = os.pathsep.join([str(srun.parent), search_path()])
        self.environment = {"SLURM_CONF": str(self.conf), "PATH": path}

    def __enter__(self) -> "Cluster":
        self.controller = self._start("slurmctld", "-D", "-c")
        self.start_node()
        return self

    def __exit__(self, *_) -> None:
        for daemon in (self.node, self.controller):
            daemon.kill()
            daemon.wait()

    def start_node(self) -> None:
        """Starts slurmd, and waits until it takes jobs."""
        self.node = self._start(*namespace(), "slurmd", "-D", "-N", "localhost")
        self._wait_for(lambda: {"idle", "mixed", "allocated"} & set(self.tell("sinfo", "-h", "-o", "%T")))

    def kill_node(self) -> None:
        """Ends slurmd and all that it started, as a power cut does, and returns when the node may be started again."""
        self.node.kill()
        self.node.wait()
        time.sleep(AWAY)

    def hasten(self) -> int:
        """Waits until Slurm has put the jobs that the node lost back into the queue, and lets them begin at once.

        Returns:
            How many there are. Slurm would wait for two minutes.
        """
        delayed = ("squeue", "-h", "-t", "PENDING", "-o", "%i:%r")
        self._wait_for(lambda: any("BeginTime" in job for job in self.tell(*delayed)))
        jobs = [job.split(":")[0] for job in self.tell(*delayed) if "BeginTime" in job]
        for job in jobs:
            self.tell("scontrol", "update", f"JobId={job}", "StartTime=now")
        return len(jobs)

    def tell(self, *words: str) -> list[str]:
        """The words that a program of Slurm's prints; none while the controller does not answer."""
        done = subprocess.run(words, env={**os.environ, **self.environment}, capture_output=True, text=True)
        return done.stdout.split()

    def _start(self, *words: str) -> subprocess.Popen:
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        begin = partial(end_with_parent, os.getpid())
        return subprocess.Popen(words, env={**os.environ, **self.environment}, preexec_fn=begin, **quiet)

    def _wait_for(self, condition: Callable[[], object]) -> None:
        deadline = time.monotonic() + PATIENCE
        while not condition():
            log = self.conf.with_name("slurmctld.log")
            assert time.monotonic() < deadline, log.read_text() if log.exists() else "slurmctld did not start"
            time.sleep(0.2)
