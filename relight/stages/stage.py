"""Makes functions stages: commands of Hydra with the settings that they read, and `io.` paths."""

import os
import platform
import shlex
import sys
import tempfile
from collections.abc import Callable
from contextlib import nullcontext, suppress
from dataclasses import asdict, field, is_dataclass, make_dataclass
from datetime import datetime
from functools import partial
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import hydra
import yaml
from hydra.core.config_store import ConfigStore
from hydra.errors import HydraException
from omegaconf import MISSING, DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from relight import __version__
from relight.config import CONF, READS, Config, check, composed, presets, resolved
from relight.config.errors import explain
from relight.config.help import listing
from relight.errors import UserError, out_of_memory
from relight.processes import STARTED_BY, end_with_snakemake

VERSIONS = ("numpy", "scipy", "torch", "hydra-core", "snakemake", "mlflow", "open3d-cpu", "warp-lang")
FLAGS = """
  --cfg job          print the settings, and do nothing
  --multirun, -m     each of several values: train.lr=1e-4,2e-4
  --hydra-help       more of Hydra"""


class Stage:
    """A function with the command line of a stage.

    The function is called with the settings in READS[name] (the dataclass of a group, or the value of a single setting
    under its last name) and one Path per port, or one str if the function's parameter is a str. If ports are lists, it
    is called for each position of the lists.

    Attributes:
        name: name of the stage.
        ports: name -> description of each file that it reads or writes, and of each name that it is given.
    """

    def __init__(self, name: str, ports: dict[str, str], function: Callable[..., None]):
        """Makes a function a stage; see the attributes. Parameters of the function have the names of the ports."""
        self.name, self.ports, self._function = name, ports, function
        self._kinds = {port: function.__annotations__[port] for port in ports}  # Path or str

    def __call__(self, *args: Any, **settings: Any) -> None:
        self._function(*args, **settings)

    def cli(self) -> None:
        """Runs the stage with the settings and ports of the command line.

        What a user can cause ends the program with one line and exit code 1.
        """
        # One thread per job, since several jobs run at the same time.
        for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
            os.environ.setdefault(variable, "1")
        end_with_snakemake()
        if {"-h", "--help"} & set(sys.argv[1:]):
            return print(self.usage())
        os.environ["HYDRA_FULL_ERROR"] = "1"  # Hydra raises errors instead of printing a traceback
        io = make_dataclass("Files", [(port, Any, MISSING) for port in self.ports])
        schema = make_dataclass("StageConfig", [("io", io, field(default_factory=io))], bases=(Config,))
        ConfigStore.instance().store(name="schema", node=schema)
        multirun = {"-m", "--multirun"} & set(sys.argv)
        try:
            with tempfile.TemporaryDirectory() if multirun else nullcontext(".") as scratch:
                os.environ["RELIGHT_SCRATCH"] = scratch  # the folder of Hydra's file multirun.yaml
                hydra.main(config_path=str(CONF), config_name="config", version_base="1.3")(self._run)()
        except (HydraException, OmegaConfBaseException, yaml.YAMLError) as error:
            sys.exit(f"relight {self.name}: {explain(error, presets())}")

    def usage(self) -> str:
        """Returns the help: what the stage does, its files, and the settings that it reads."""
        words = {port: f"io.{port}={'NAME' if kind is str else 'FILE'}" for port, kind in self._kinds.items()}
        files = "\n".join(f"    {words[port]:34s}  {what}" for port, what in self.ports.items())
        about = (sys.modules[self._function.__module__].__doc__ or "").strip()
        settings = listing(composed(), READS[self.name])
        read = f"Settings that it reads, as key=value:\n{settings}" if settings else "It reads no settings."
        return f"{about}\n\nFiles:\n{files}\n\n{read}\n{FLAGS}"

    def _run(self, cfg: DictConfig) -> None:
        """Runs the stage with composed settings. Errors end here, since Hydra would print more lines."""
        try:
            self._call(cfg)
        except UserError as error:
            sys.exit(f"relight {self.name}: {error}")
        except OmegaConfBaseException as error:
            sys.exit(f"relight {self.name}: {explain(error, presets())}")
        except MemoryError as error:
            sys.exit(f"relight {self.name}: {out_of_memory(error)}")

    def _call(self, cfg: DictConfig) -> None:
        """Calls the function with the settings that it reads, once for each position of the lists of files.

        `cfg` has the ports under `io`. Raises UserError if a port is missing, lists differ in length, a setting is
        invalid, or the function raises it.
        """
        ports = self.ports
        missing = [f"io.{port}=<{what}>" for port, what in ports.items() if OmegaConf.is_missing(cfg.io, port)]
        if missing:
            raise UserError(f"missing: {' '.join(missing)}")
        check(resolved(cfg))
        settings = {key.rpartition(".")[2]: unwrap(OmegaConf.select(cfg, key)) for key in READS[self.name]}
        files = {port: [str(path) for path in as_list(cfg.io[port])] for port in ports}
        if len({len(paths) for paths in files.values()}) > 1:
            raise UserError(f"lists of files must be equally long: {', '.join(f'io.{port}' for port in ports)}")
        if STARTED_BY in os.environ:
            print(log_header(settings), flush=True)
        for paths in zip(*files.values()):
            self(**settings, **{port: self._kinds[port](path) for port, path in zip(ports, paths)})


def stage(name: str, **ports: str) -> Callable[[Callable[..., None]], Stage]:
    """Returns a decorator that makes a function the stage `name` with these ports."""
    return partial(Stage, name, ports)


def unwrap(part: Any) -> Any:
    """Converts a group of settings to its dataclass; a single value is returned as it is."""
    return OmegaConf.to_object(part) if OmegaConf.is_config(part) else part


def as_list(value: Any) -> list:
    """Returns a list unchanged, and any other value as a list of one."""
    return list(value) if OmegaConf.is_list(value) else [value]


def log_header(settings: dict[str, Any]) -> str:
    """Returns the header of a job's log: time, versions, command, and the settings that it reads.

    Args:
        settings: by name; dataclasses or values. Those of MLflow are omitted.

    Returns:
        Comment lines.
    """
    packages = [f"relight {__version__}", f"Python {platform.python_version()}"]
    for package in VERSIONS:
        with suppress(PackageNotFoundError):
            packages.append(f"{package} {version(package)}")
    values = {
        name: asdict(part) if is_dataclass(part) and not isinstance(part, type) else part
        for name, part in settings.items()
        if name != "track"
    }
    lines = [
        f"{datetime.now().astimezone().isoformat(timespec='seconds')} on {platform.node()}",
        ", ".join(packages),
        shlex.join([Path(sys.executable).name, *sys.orig_argv[1:]]),
        *yaml.safe_dump(values, sort_keys=False).splitlines(),
    ]
    return "\n".join(f"# {line}" for line in lines)
