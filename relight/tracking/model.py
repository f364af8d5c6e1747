"""Logs networks as models in MLflow: `mlflow.pyfunc.load_model` returns a predictor of maps from pictures.

A model is the network's safetensors file and the name of this module, so loading it does not unpickle anything.
"""

import tempfile
from pathlib import Path

import numpy as np

from relight import __version__

EXAMPLE_LEVELS = 64  # the input example has multiples of 1/64, which are short as text
MAX_EXAMPLE_SIZE = 256  # pixels, largest side of an input example that is stored


class Predictor:
    """A network with the interface that MLflow expects."""

    def __init__(self, network):
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


def log_network(client, run: str, path: Path) -> None:
    """Adds a network to a run as a model, unless the run has one.

    Args:
        client: an `MlflowClient`.
        run: the id of the run.
        path: the network's file.
    """
    found = client.get_run(run)
    if found.outputs and found.outputs.model_outputs:
        return
    import mlflow.pyfunc
    from mlflow.entities import LoggedModelOutput
    from mlflow.models import Model

    predictor = _load_pyfunc(str(path))
    model = client.create_logged_model(
        found.info.experiment_id, path.stem.replace(".", "-"), run, params=found.data.params, model_type="relighting"
    )
    with tempfile.TemporaryDirectory() as folder:
        mlflow.pyfunc.save_model(
            f"{folder}/model",
            loader_module=__name__,
            data_path=str(path),
            signature=signature(predictor.network),
            input_example=example(predictor.network.size) if predictor.network.size <= MAX_EXAMPLE_SIZE else None,
            pip_requirements=[f"relight=={__version__}"],
            mlflow_model=Model(artifact_path=model.artifact_location, run_id=run, model_id=model.model_id),
        )
        client.log_model_artifacts(model.model_id, f"{folder}/model")
    client.finalize_logged_model(model.model_id, "READY")
    client.log_outputs(run, [LoggedModelOutput(model.model_id, step=0)])


def signature(network):
    """Returns MLflow's signature of a network: names and shapes of inputs and outputs, float32, for any batch size."""
    from mlflow.models import ModelSignature
    from mlflow.types import Schema, TensorSpec

    from relight.learning.predict import predict

    def schema(arrays: dict[str, np.ndarray]) -> Schema:
        return Schema([TensorSpec(np.dtype(np.float32), (-1, *one.shape[1:]), name) for name, one in arrays.items()])

    inputs = example(network.size)
    return ModelSignature(schema(inputs), schema(predict(network, inputs["image"], inputs["mask"])))


def example(size: int) -> dict[str, np.ndarray]:
    """Returns an example of an input, a lit ball on black: image (1,S,S,3) and mask (1,S,S), float32."""
    y, x = (1 - 2 * (np.mgrid[:size, :size] + 0.5) / size) * [[[1]], [[-1]]]
    inside = np.hypot(x, y) < 0.5
    lit = np.clip(0.5 + 0.5 * (x + y), 0, 1) * inside
    image = np.round(lit[..., None] * [0.9, 0.7, 0.6] * EXAMPLE_LEVELS) / EXAMPLE_LEVELS
    return {"image": image[None].astype(np.float32), "mask": inside[None].astype(np.float32)}
