"""Tracks trainings and workflows in MLflow. Its failures are warnings, and never end a training.

store: connection and SQLite database; run: the run of a training; workflow: the parent run of a workflow; model: the
network as a model in MLflow; server: `relight ui`.
"""
