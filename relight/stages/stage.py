"""What makes a function a stage: a Hydra command line over the settings that it reads, and typed `io.` paths."""

import os
import sys
import tempfile
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import field, make_dataclass
from pathlib import Path
from typing import Any

import hydra
import yaml
from hydra.core.config_store import ConfigStore
from hydra.errors import HydraException
from omegaconf import MISSING, DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from relight.config import CONF, READS, Config, check, explain, resolved
from relight.files import UserError, out_of_memory
from relight.processes import end_with_snakemake


def stage(name: str, **ports: str) -> Callable:
    """Gives a function the command line of stage `name`, as its attribute `cli`.

    The function is called with what READS[name] lists (the dataclass of a group, the value of a single setting under
    its last name) and with one Path per port; `ports` maps each port to the words that describe it. Errors of users
    end the program in one line, with exit code 1.
    """

    def wrap(function: Callable) -> Callable:
        def run(cfg: DictConfig) -> None:
            try:
                call(cfg)
            except UserError as error:  # told at once, since Hydra adds lines of its own to other exceptions
                sys.exit(f"relight {name}: {error}")
            except OmegaConfBaseException as error:
                sys.exit(f"relight {name}: {explain(error, sys.argv[1:])}")
            except MemoryError as error:
                sys.exit(f"relight {name}: {out_of_memory(error)}")

        def call(cfg: DictConfig) -> None:
            unset = [f"io.{port}=<{what}>" for port, what in ports.items() if OmegaConf.is_missing(cfg.io, port)]
            if unset:
                raise UserError(f"missing: {' '.join(unset)}")
            check(resolved(cfg))
            settings = {key.rpartition(".")[2]: plain(OmegaConf.select(cfg, key)) for key in READS[name]}
            function(**settings, **{port: Path(cfg.io[port]) for port in ports})

        def cli() -> None:
            # One thread a job: several jobs side by side use all cores, and spinning thread pools don't fight.
            for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
                os.environ.setdefault(variable, "1")
            end_with_snakemake()
            os.environ["HYDRA_FULL_ERROR"] = "1"  # errors reach us instead of being printed with a trace
            io = make_dataclass("Files", [(port, str, MISSING) for port in ports])
            schema = make_dataclass("StageConfig", [("io", io, field(default_factory=io))], bases=(Config,))
            ConfigStore.instance().store(name="schema", node=schema)
            several = {"-m", "--multirun"} & set(sys.argv)
            try:
                with tempfile.TemporaryDirectory() if several else nullcontext(".") as scratch:
                    os.environ["RELIGHT_SCRATCH"] = scratch  # Hydra leaves a file multirun.yaml in a folder
                    hydra.main(config_path=str(CONF), config_name="config", version_base="1.3")(run)()
            except (HydraException, OmegaConfBaseException, yaml.YAMLError) as error:
                sys.exit(f"relight {name}: {explain(error, sys.argv[1:])}")

        function.cli = cli
        return function

    return wrap


def plain(part: Any) -> Any:
    """A group of settings as its dataclass; a single value as it is."""
    return OmegaConf.to_object(part) if OmegaConf.is_config(part) else part
