"""Logs networks as models in MLflow: `mlflow.pyfunc.load_model` returns a predictor of maps from pictures.

A model is the network's safetensors file and the name of this module, so loading it does not unpickle anything.
"""

import warnings
from pathlib import Path

import numpy as np

from relight import __version__


class Predictor:
    """A network with the interface that MLflow expects."""

    def __init__(self, network):  # a relight.learning.networks.Network, whose import would load torch
        self.network = network

    def predict(self, model_input: dict[str, np.ndarray], params: dict | None = None) -> dict[str, np.ndarray]:
        """Infers maps.

        Args:
            model_input: `image` (B,S,S,3), linear, and `mask` (B,S,S), float32.
            params: unused; MLflow passes it.

        Returns:
            The maps by name, as from `relight.learning.predict.predict`.
        """
        from relight.learning.predict import predict

        return predict(self.network, model_input["image"], model_input["mask"])


def _load_pyfunc(path: str) -> Predictor:
    """Loads a predictor for MLflow from the path of the model's data, which is the network's file."""
    from relight.learning.checkpoint import load_network

    return Predictor(load_network(path)[0])


def log_network(path: Path) -> None:
    """Adds the network of a file to MLflow's active run as a model, with the names and shapes of its maps."""
    import mlflow.pyfunc
    from mlflow.models import infer_signature

    predictor = _load_pyfunc(str(path))
    size = predictor.network.size
    inputs = {"image": np.ones((1, size, size, 3), np.float32), "mask": np.ones((1, size, size), np.float32)}
    with warnings.catch_warnings(action="ignore"):  # there is no example: as text it is larger than many networks
        mlflow.pyfunc.log_model(
            name=path.stem.replace(".", "-"),
            loader_module=__name__,
            data_path=str(path),
            signature=infer_signature(inputs, predictor.predict(inputs)),
            pip_requirements=[f"relight=={__version__}"],
        )
