"""Records trainings in MLflow, by its public API. Its failures are warnings, and never end a training.

store: opens a store; run: the run of a training; server: `relight ui`.
"""
