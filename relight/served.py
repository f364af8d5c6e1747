"""The network as a model of MLflow: `mlflow.pyfunc.load_model` returns what infers maps from pictures.

The model is the network's safetensors file and this module's name, so nothing that is unpickled can run code.
"""

import tempfile
from pathlib import Path

import numpy as np

from relight import __version__

FINEST = 64  # values of the input example are multiples of 1/64, which are short as text
LARGEST = 256  # pixels of a network whose input example is kept


class Served:
    """A network behind MLflow's interface."""

    def __init__(self, network):
        self.network = network

    def predict(self, model_input: dict[str, np.ndarray], params: dict | None = None) -> dict[str, np.ndarray]:
        """Maps of images (B,S,S,3), linear, with masks (B,S,S), as `relight.learning.predict.predict` says."""
        from relight.learning.predict import predict

        return predict(self.network, model_input["image"], model_input["mask"])


def _load_pyfunc(path: str) -> Served:
    """What MLflow calls with the place of the data of a model."""
    from relight.learning.checkpoint import load_network

    return Served(load_network(path)[0])


def log_network(client, run: str, path: Path) -> None:
    """Adds a network (.safetensors) to a run as a model, once.

    Args:
        client: an `MlflowClient`.
        run: the id of the run.
        path: the network's file.
    """
    import mlflow.pyfunc
    from mlflow.entities import LoggedModelOutput
    from mlflow.models import Model

    found = client.get_run(run)
    if found.outputs and found.outputs.model_outputs:
        return
    served = _load_pyfunc(str(path))
    model = client.create_logged_model(
        found.info.experiment_id, path.stem.replace(".", "-"), run, params=found.data.params, model_type="relighting"
    )
    with tempfile.TemporaryDirectory() as folder:
        mlflow.pyfunc.save_model(
            f"{folder}/model",
            loader_module=__name__,
            data_path=str(path),
            signature=signature(served.network),
            input_example=example(served.network.size) if served.network.size <= LARGEST else None,
            pip_requirements=[f"relight=={__version__}"],
            mlflow_model=Model(artifact_path=model.artifact_location, run_id=run, model_id=model.model_id),
        )
        client.log_model_artifacts(model.model_id, f"{folder}/model")
    client.finalize_logged_model(model.model_id, "READY")
    client.log_outputs(run, [LoggedModelOutput(model.model_id, step=0)])


def signature(network):
    """What goes in and what comes out, as MLflow's signature: float32, any number of pictures."""
    from mlflow.models import ModelSignature
    from mlflow.types import Schema, TensorSpec

    size, bands = network.size, (network.order + 1) ** 2
    shapes = {
        "albedo": (size, size, 3),
        "transport": (size, size, bands),
        "light": (bands, 3),
        "shading": (size, size, 3),
    }

    def schema(named: dict[str, tuple[int, ...]]) -> Schema:
        return Schema([TensorSpec(np.dtype(np.float32), (-1, *shape), name) for name, shape in named.items()])

    return ModelSignature(schema({"image": (size, size, 3), "mask": (size, size)}), schema(shapes))


def example(size: int) -> dict[str, np.ndarray]:
    """A lit ball on black, as an input: image (1,S,S,3) and mask (1,S,S), float32."""
    y, x = (1 - 2 * (np.mgrid[:size, :size] + 0.5) / size) * [[[1]], [[-1]]]
    inside = np.hypot(x, y) < 0.5
    lit = np.clip(0.5 + 0.5 * (x + y), 0, 1) * inside
    image = np.round(lit[..., None] * [0.9, 0.7, 0.6] * FINEST) / FINEST
    return {"image": image[None].astype(np.float32), "mask": inside[None].astype(np.float32)}
